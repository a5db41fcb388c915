// Moves the primitives of a chunk to the two children of its node: one work item per chunk. Reads boxes; writes them,
// in their old order within each child, and what their centroids span. A chunk whose threshold is BINS is just copied.
#include "build/boxes.h"

__kernel void partition(__global const float4 *boxes,     // [primitives][2]
                        __global float4       *sorted,    // [primitives][2]
                        __global const int4   *chunks,    // first, count, where the left and the right ones go
                        __global const int4   *splits,    // [chunks]: axis, bins on the left, bits of origin and scale
                        __global float4       *spans,     // [chunks][2 children][2]: bounds of the centroids
                        int                    count)     // chunks
{
    int item = (int)get_global_id(0);
    if (item >= count)
        return;
    int4 chunk = chunks[item], split = splits[item];
    float origin = as_float(split.z), scale = as_float(split.w);
    Box left = empty_box(), right = empty_box();
    for (int i = chunk.x; i < chunk.x + chunk.y; ++i) {
        Box one = read_box(boxes, i);
        Box centroid = { one.lower + one.upper, one.lower + one.upper };
        bool on_left = bin_of(component(centroid.lower, split.x), origin, scale) < split.y;
        int to;
        if (on_left) {
            left = joined(left, centroid);
            to = chunk.z++;
        } else {
            right = joined(right, centroid);
            to = chunk.w++;
        }
        sorted[2 * to] = boxes[2 * i];
        sorted[2 * to + 1] = boxes[2 * i + 1];
    }
    spans[4 * item] = left.lower;
    spans[4 * item + 1] = left.upper;
    spans[4 * item + 2] = right.lower;
    spans[4 * item + 3] = right.upper;
}
