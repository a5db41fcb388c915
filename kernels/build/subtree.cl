// Builds the binary tree of a range of primitives down to leaves: one work item per range. Sorts the boxes in place;
// writes, at each place where a node is split, the node's depth + 1. Places without a mark lie inside a leaf.
// Facts: MAX_DEPTH, which no leaf exceeds: where halves are the only way to keep it, halves are taken.
#include "build/splits.h"

static int levels_of_halves(int count)
{
    int levels = 0;
    for (int blocks = (count + LEAF_SIZE - 1) / LEAF_SIZE; blocks > 1; blocks = (blocks + 1) / 2)
        ++levels;
    return levels;
}

static int split(__global float4 *boxes, int begin, int end, int depth, float shrink)
{
    Box span = empty_box();
    for (int i = begin; i < end; ++i) {
        Box one = read_box(boxes, i);
        Box centroid = { one.lower + one.upper, one.lower + one.upper };
        span = joined(span, centroid);
    }
    float4 extent = span.upper - span.lower;
    if (extent.x <= CLOSEST && extent.y <= CLOSEST && extent.z <= CLOSEST)
        return halves(begin, end);
    if (depth + levels_of_halves(end - begin) >= MAX_DEPTH)
        return median_split(boxes, begin, end, span);
    if (end - begin <= SWEEP)
        return sweep_split(boxes, begin, end, shrink);
    return binned_split(boxes, begin, end, span, shrink);
}

__kernel void subtree(__global float4     *boxes,    // [primitives][2]
                      __global uchar      *marks,    // [primitives]
                      __global const int4 *ranges,   // begin, end, depth, -
                      float                shrink,   // scale of half_area
                      int                  count)    // ranges
{
    if ((int)get_global_id(0) >= count)
        return;
    int4 range = ranges[get_global_id(0)];
    int begin = range.x, end = range.y, depth = range.z, waiting = 0;
    int2 later[MAX_DEPTH];    // ends and depths of the right parts, which begin where what lies before them ends
    for (;;) {
        if (end - begin > LEAF_SIZE) {
            int middle = split(boxes, begin, end, depth, shrink);
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
