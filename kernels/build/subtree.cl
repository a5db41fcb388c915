// Builds the binary tree of a range of primitives down to leaves: one work item per range. Sorts the boxes in place;
// writes, at each place where a node is split, the node's depth + 1. Places without a mark lie inside a leaf.
// No leaf exceeds `max_depth`: where halves are the only way to keep it, halves are taken. Facts: DEEPEST, its bound.
#include "build/splits.h"

static int levels_of_halves(int blocks)
{
    int levels = 0;
    for (; blocks > 1; blocks = (blocks + 1) / 2)
        ++levels;
    return levels;
}

static int split(__global float4 *boxes, int begin, int end, int depth, int max_depth, int leaf_bits, float shrink)
{
    Box span = empty_box();
    for (int i = begin; i < end; ++i) {
        Box one = read_box(boxes, i);
        Box centroid = { one.lower + one.upper, one.lower + one.upper };
        span = joined(span, centroid);
    }
    float4 extent = span.upper - span.lower;
    if (extent.x <= CLOSEST && extent.y <= CLOSEST && extent.z <= CLOSEST)
        return halves(begin, end, leaf_bits);
    if (depth + levels_of_halves(blocks_of(end - begin, leaf_bits)) >= max_depth)
        return median_split(boxes, begin, end, leaf_bits, span);
    if (end - begin <= SWEEP)
        return sweep_split(boxes, begin, end, leaf_bits, shrink);
    return binned_split(boxes, begin, end, leaf_bits, span, shrink);
}

__kernel void subtree(__global float4     *boxes,       // [primitives][2]
                      __global uchar      *marks,       // [primitives]
                      __global const int4 *ranges,      // begin, end, depth, -
                      float                shrink,      // scale of half_area
                      int                  leaf_bits,
                      int                  max_depth,
                      int                  count)       // ranges
{
    if ((int)get_global_id(0) >= count)
        return;
    int4 range = ranges[get_global_id(0)];
    int begin = range.x, end = range.y, depth = range.z, waiting = 0;
    int2 later[DEEPEST];    // ends and depths of the right parts, which begin where what lies before them ends
    for (;;) {
        if (blocks_of(end - begin, leaf_bits) > 1) {
            int middle = split(boxes, begin, end, depth, max_depth, leaf_bits, shrink);
            marks[middle] = (uchar)++depth;
            later[waiting++] = (int2)(end, depth);
            end = middle;
        } else if (waiting > 0) {
            begin = end;
            end = later[--waiting].x;
            depth = later[waiting].y;
        } else
            return;
    }
}
