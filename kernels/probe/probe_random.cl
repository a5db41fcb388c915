// Writes four random numbers per counter.
#include "common/sampler.h"

__kernel void probe_random(const __global uint *pixels,
                           const __global uint *samples,
                           const __global uint *dimensions,
                           __global float      *out,        // [4][capacity]
                           uint                 capacity,   // counters
                           uint2                seed)
{
    uint i = get_global_id(0) * VW;
    U pixel = AS_U(LOAD_I(pixels, i));
    U sample = AS_U(LOAD_I(samples, i));
    U dimension = AS_U(LOAD_I(dimensions, i));
    F4 u = random4(pixel, sample, dimension, seed);
    STORE_F(out, i, u.a);
    STORE_F(out + capacity, i, u.b);
    STORE_F(out + 2 * capacity, i, u.c);
    STORE_F(out + 3 * capacity, i, u.d);
}
