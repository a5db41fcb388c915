// Takes the rays of a wave through the lens in float64, with the code that renders in float32. What they start from and aim
// at is given in float32 (lens/float64.h) and what comes out is rounded to it; two packets of lanes are under way, as in
// trace_rays.cl.
#include "lens/trace.h"

static inline LensPath enter(const __global float *rays, uint capacity, uint i, real film_distance)
{
    F3 film = f3(LOAD_SINGLE(rays, i), LOAD_SINGLE(rays + capacity, i), ZERO);
#if FILM_MOVED
    film.z = -LOAD_SINGLE(rays + 5 * capacity, i);
#endif
    F3 aim = f3(LOAD_SINGLE(rays + 2 * capacity, i), LOAD_SINGLE(rays + 3 * capacity, i), (F)(film_distance));
    return enter_lens(aim, normalized(sub(aim, film)), LOAD_SINGLE(rays + 4 * capacity, i));
}

static inline void leave(__global float *rays, uint capacity, uint i, LensRay out)
{
    STORE_SINGLE(rays, i, out.p.x);
    STORE_SINGLE(rays + capacity, i, out.p.y);
    STORE_SINGLE(rays + 2 * capacity, i, out.p.z);
    STORE_SINGLE(rays + 3 * capacity, i, out.d.x);
    STORE_SINGLE(rays + 4 * capacity, i, out.d.y);
    STORE_SINGLE(rays + 5 * capacity, i, out.d.z);
    STORE_SINGLE(rays + 6 * capacity, i, TO_F(out.status));
#if LENS_LOSSES
    STORE_SINGLE(rays + 7 * capacity, i, out.transmittance);
#endif
}

__kernel void trace_lens(const __global Surface *surfaces,   // film side first
                         int                     count,      // surfaces
                         const __global real    *stop,       // shape of the stop
                         __global float         *rays,       // see lens/float64.h
                         uint                    capacity)   // slots in it
{
    uint i = get_global_id(0) * (2 * VW);
    LensPath first = enter(rays, capacity, i, surfaces->gap);
    LensPath second = enter(rays, capacity, i + VW, surfaces->gap);
    for (int k = 0; k < count; ++k) {
        cross_surface(&first, surfaces + k, stop);
        cross_surface(&second, surfaces + k, stop);
    }
    leave(rays, capacity, i, leave_lens(&first));
    leave(rays, capacity, i + VW, leave_lens(&second));
}
