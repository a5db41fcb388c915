// Traces given rays through a lens with the code that renders: rays in, rays with status and surface out. A work item has
// two packets of lanes under way, since a surface is a long chain of roots and divisions that leaves room for another.
// Facts: LENS_FOLD, whether rays come by another axis than z, then from near the lens; LENS_DISPERSION and LENS_TINTED; with either, every ray brings its wavelength [nm] in the row of the status.
#include "lens/trace.h"

// A ray that starts far away is taken to the plane of the first vertex, since surfaces are met from near by.
static inline LensPath load_path(const __global real *rays, uint capacity, uint i, const __global Surface *first)
{
    F3 p = f3(LOAD_F(rays, i), LOAD_F(rays + capacity, i), LOAD_F(rays + 2 * capacity, i));
    F3 d = f3(LOAD_F(rays + 3 * capacity, i), LOAD_F(rays + 4 * capacity, i), LOAD_F(rays + 5 * capacity, i));
#if LENS_DISPERSION || LENS_TINTED
    LensPath path = enter_lens(p, d, LOAD_F(rays + 6 * capacity, i));
#else
    LensPath path = enter_lens(p, d, ONE);
#endif
#if !LENS_FOLD
    path.p = along(p, d, (first->gap - p.z) / d.z);
    path.p.z = (F)(first->gap);
#endif
    return path;
}

static void store_ray(__global real *rays, uint capacity, uint i, LensRay out)
{
    STORE_F(rays, i, out.p.x);
    STORE_F(rays + capacity, i, out.p.y);
    STORE_F(rays + 2 * capacity, i, out.p.z);
    STORE_F(rays + 3 * capacity, i, out.d.x);
    STORE_F(rays + 4 * capacity, i, out.d.y);
    STORE_F(rays + 5 * capacity, i, out.d.z);
    STORE_F(rays + 6 * capacity, i, TO_F(out.status));
    STORE_F(rays + 7 * capacity, i, TO_F(out.surface));
#if LENS_LOSSES
    STORE_F(rays + 8 * capacity, i, out.transmittance);
#endif
}

__kernel void trace_rays(const __global Surface *surfaces,   // in order of travel
                         int                     count,      // surfaces
                         const __global real    *stop,       // shape of the stop
                         __global real          *rays,       // [8][capacity]: p, d (both in and out), status, surface
                                                             // and with LENS_LOSSES a ninth row: what is left of the light
                         uint                    capacity)   // padded number of rays
{
    uint i = get_global_id(0) * (2 * VW);
    LensPath first = load_path(rays, capacity, i, surfaces);
    LensPath second = load_path(rays, capacity, i + VW, surfaces);
    for (int k = 0; k < count; ++k) {
        cross_surface(&first, surfaces + k, stop);
        cross_surface(&second, surfaces + k, stop);
    }
    store_ray(rays, capacity, i, leave_lens(&first));
    store_ray(rays, capacity, i + VW, leave_lens(&second));
}
