// Sets up the boxes that a build sorts: one work item per primitive. Reads the corners; writes the boxes.
#include "build/boxes.h"

__kernel void gather(__global const float *lower,   // [count][3] lower corners
                     __global const float *upper,   // [count][3] upper corners
                     __global float4      *boxes,   // [count][2]
                     int                   count)   // primitives
{
    int i = (int)get_global_id(0);
    if (i >= count)
        return;
    boxes[2 * i] = (float4)(lower[3 * i], lower[3 * i + 1], lower[3 * i + 2], as_float(i));
    boxes[2 * i + 1] = (float4)(upper[3 * i], upper[3 * i + 1], upper[3 * i + 2], 0.0f);
}
