// Writes the leaves of a sorted range: one work item per leaf. Reads boxes; writes primitive indices and bounds.
#include "build/boxes.h"

__kernel void leaves(__global const float4 *boxes,    // [primitives][2]
                     __global const int    *starts,   // [leaves + 1] first primitive of each leaf
                     __global int          *blocks,   // [leaves][leaf_size] primitives, -1 where there is none
                     __global float4       *bounds,   // [leaves][2] corners
                     int                    leaf_size,
                     int                    count)    // leaves
{
    int leaf = (int)get_global_id(0);
    if (leaf >= count)
        return;
    int begin = starts[leaf], number = starts[leaf + 1] - begin;
    Box box = empty_box();
    for (int i = 0; i < leaf_size; ++i) {
        blocks[leaf * leaf_size + i] = i < number ? as_int(boxes[2 * (begin + i)].w) : -1;
        if (i < number)
            box = joined(box, read_box(boxes, begin + i));
    }
    bounds[2 * leaf] = box.lower;
    bounds[2 * leaf + 1] = box.upper;
}
