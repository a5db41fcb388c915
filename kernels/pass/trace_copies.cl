// Traces the same rays through copies of a lens, each of which has its own surfaces, to where they meet their films. A work
// item has two packets of lanes of one copy under way, as in trace_rays.cl.
#include "lens/trace.h"

static inline LensPath load_path(const __global real *rays, uint capacity, uint i)
{
    F3 p = f3(LOAD_F(rays, i), LOAD_F(rays + capacity, i), ZERO);
    return enter_lens(p, f3(LOAD_F(rays + 2 * capacity, i), LOAD_F(rays + 3 * capacity, i), LOAD_F(rays + 4 * capacity, i)), ONE);
}

static inline void store_point(__global real *points, uint capacity, uint i, LensRay out, real film)
{
    F3 slope = scale(out.d, ONE / out.d.z);
    F3 at = along(out.p, slope, film - out.p.z);
    F lost = AS_F((I)(INFINITE) | TRUE);                // not a number
    STORE_F(points, i, out.passed ? at.x : lost);
    STORE_F(points + capacity, i, out.passed ? at.y : lost);
    STORE_F(points + 2 * capacity, i, slope.x);
    STORE_F(points + 3 * capacity, i, slope.y);
}

__kernel void trace_copies(const __global Surface *surfaces,   // [copies][count], in order of travel
                           int                     count,      // surfaces of a copy
                           const __global real    *stop,       // of nobody: rims and stops take no rays here
                           const __global real    *rays,       // [5][capacity]: x, y in the first vertex plane, direction
                           __global real          *points,     // [copies][4][capacity]: x, y on the film, slopes there
                           uint                    capacity,   // padded number of rays
                           real                    film)       // distance behind the last vertex
{
    uint packets = capacity / (2 * VW);
    uint copy = get_global_id(0) / packets;
    uint i = (get_global_id(0) - copy * packets) * (2 * VW);
    surfaces += copy * count;
    points += (size_t)copy * 4 * capacity;
    LensPath first = load_path(rays, capacity, i);
    LensPath second = load_path(rays, capacity, i + VW);
    for (int k = 0; k < count; ++k) {
        cross_surface(&first, surfaces + k, stop);
        cross_surface(&second, surfaces + k, stop);
    }
    store_point(points, capacity, i, leave_lens(&first), film);
    store_point(points, capacity, i + VW, leave_lens(&second), film);
}
