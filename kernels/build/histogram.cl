// Counts and bounds the primitives of each bin along each axis: one work item per chunk, a part of one large node.
// Reads boxes; writes the chunk's bins, which the host adds up.
#include "build/boxes.h"

__kernel void histogram(__global const float4 *boxes,    // [primitives][2]
                        __global const int4   *chunks,   // first, count, node, -
                        __global const float4 *grids,    // [nodes][2]: origin and scale of the bins along x, y, z
                        __global float4       *bins,     // [chunks][3 axes][BINS][2]: bounds; count in the first w
                        int                    count)    // chunks
{
    if ((int)get_global_id(0) >= count)
        return;
    int4 chunk = chunks[get_global_id(0)];
    float4 origin = grids[2 * chunk.z], scale = grids[2 * chunk.z + 1];
    Box box[3 * BINS];
    int number[3 * BINS];
    fill_bins(boxes, chunk.x, chunk.x + chunk.y, origin, scale, box, number);
    __global float4 *out = bins + get_global_id(0) * (3 * BINS * 2);
    for (int i = 0; i < 3 * BINS; ++i) {
        out[2 * i] = (float4)(box[i].lower.xyz, (float)number[i]);
        out[2 * i + 1] = box[i].upper;
    }
}
