// Writes the float in [0, 1) of every word.
#include "common/rng.h"

__kernel void probe_unit_float(const __global uint *words, __global float *out)
{
    uint i = get_global_id(0) * VW;
    STORE_F(out, i, unit_float(AS_U(LOAD_I(words, i))));
}
