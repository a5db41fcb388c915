// The rays of a wave that goes through the lens in float64, as the passes in float32 see them: eight rows of `capacity`
// floats. The pass aim_rays writes film point x, y, aim x, y [mm] and wavelength [nm], and the depth of a moved film [mm]; trace_lens.cl puts in their place the
// point p and the direction d behind the lens, the status and what is left of the light.
#ifndef LENS_FLOAT64_H
#define LENS_FLOAT64_H
#include "camera/realistic.h"

static inline void store_aim(__global float *rays, uint capacity, uint slot, Underway ray, F wavelength)
{
    STORE_F(rays, slot, ray.aimed.fx);
    STORE_F(rays + capacity, slot, ray.aimed.fy);
    STORE_F(rays + 2 * capacity, slot, ray.aimed.at.x);
    STORE_F(rays + 3 * capacity, slot, ray.aimed.at.y);
    STORE_F(rays + 4 * capacity, slot, wavelength);
#if FILM_MOVED
    STORE_F(rays + 5 * capacity, slot, ray.aimed.depth);
#endif
}

static inline LensRay traced_ray(const __global float *rays, uint capacity, uint slot)
{
    LensRay ray;
    ray.p = f3(LOAD_F(rays, slot), LOAD_F(rays + capacity, slot), LOAD_F(rays + 2 * capacity, slot));
    ray.d = f3(LOAD_F(rays + 3 * capacity, slot), LOAD_F(rays + 4 * capacity, slot), LOAD_F(rays + 5 * capacity, slot));
    ray.status = TO_I(LOAD_F(rays + 6 * capacity, slot));
    ray.passed = ray.status == RAY_OK;
#if LENS_LOSSES
    ray.transmittance = LOAD_F(rays + 7 * capacity, slot);
#endif
    return ray;
}

#endif
