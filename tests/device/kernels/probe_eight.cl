// Reads eight neighbouring floats of each lane from places of its own, and writes them again in order.
// Fact: PLAIN, whether the general form of 16 lanes is asked for where there is one for a processor.
#if PLAIN
#undef CLANG_AVX512
#endif
#include "common/transpose.h"

__kernel void probe_eight(const __global float *records,    // eight floats each
                          const __global int   *places,     // first float of each lane
                          __global float       *columns,    // [8][count]
                          __global float       *copies,     // eight floats of each lane
                          uint                  count)
{
    uint i = get_global_id(0) * VW;
    Eight eight = load_eight(records, LOAD_I(places, i));
    for (int k = 0; k < 8; ++k)
        STORE_F(columns + k * count, i, eight.f[k]);
    store_eight(copies, i, eight);
}
