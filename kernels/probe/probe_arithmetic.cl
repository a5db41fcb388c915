// Writes the root of a, the quotient of a and b, and whether a is not finite.
#include "common/math.h"

__kernel void probe_arithmetic(const __global float *a,
                               const __global float *b,
                               __global float       *out,    // [3][count]
                               uint                  count)
{
    uint i = get_global_id(0) * VW;
    F x = LOAD_F(a, i);
    STORE_F(out, i, sqrt(x));
    STORE_F(out + count, i, x / LOAD_F(b, i));
    STORE_F(out + 2 * count, i, not_finite(x) ? ONE : ZERO);
}
