// Writes where photons start, by three numbers each.
#include "common/records.h"
#include "caustics/surface.h"

__kernel void probe_photon_start(const __global CausticSurface *surfaces,
                                 const __global float          *curve,
                                 int                            surface_count,
                                 const __global float          *in,     // [3][count]
                                 __global float                *out,    // [7][count]: primitive, point, area, b1, b2
                                 uint                           count)
{
    uint i = get_global_id(0) * VW;
    F u = LOAD_F(in, i), v = LOAD_F(in + count, i), w = LOAD_F(in + 2 * count, i);
    StartPoint s = start_point(surfaces, curve, surface_count, u, v, w);
    STORE_F(out, i, TO_F(s.hit.primitive));
    STORE_F(out + count, i, s.p.x);
    STORE_F(out + 2 * count, i, s.p.y);
    STORE_F(out + 3 * count, i, s.p.z);
    STORE_F(out + 4 * count, i, s.area);
    STORE_F(out + 5 * count, i, s.hit.b1);
    STORE_F(out + 6 * count, i, s.hit.b2);
}
