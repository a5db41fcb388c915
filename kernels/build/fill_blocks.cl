// Writes the corners of triangles into leaf blocks, and the boxes of the blocks: one work item per block.
// A block (kernels/geometry/bvh.h) has rows x, y, z of the three corners, and the triangles, -1 where there is none.
#include "build/boxes.h"

#define ROWS 10

__kernel void fill_blocks(__global const int   *primitives,     // [count][LEAF_WIDTH] of the group; -1 where there is none
                          __global const float *vertices,       // [][VERTEX_FLOATS]
                          __global const int   *triangles,      // [][4] the corners' vertices
                          __global float       *blocks,         // [][ROWS][LEAF_WIDTH]
                          __global float4      *boxes,          // [][2] lowest and highest corner
                          int                   first_triangle, // of the group
                          int                   first,          // block of the group
                          int                   count)          // blocks of the group
{
    int block = (int)get_global_id(0);
    if (block >= count)
        return;
    __global const int *own = primitives + (size_t)block * LEAF_WIDTH;
    __global float *out = blocks + (size_t)(first + block) * ROWS * LEAF_WIDTH;
    float4 low = (float4)(BIG), high = (float4)(-BIG);
    for (int lane = 0; lane < LEAF_WIDTH; lane++)
    {
        int triangle = own[lane] < 0 ? -1 : own[lane] + first_triangle;
        int4 corners = vload4(max(triangle, 0), triangles);
        int vertex[3] = {corners.x, corners.y, corners.z};
        for (int corner = 0; corner < 3; corner++)
        {
            float4 at = vload4(0, vertices + VERTEX_FLOATS * (size_t)vertex[corner]);
            low = triangle < 0 ? low : smaller(low, at);
            high = triangle < 0 ? high : larger(high, at);
            at = triangle < 0 ? (float4)(0.0f) : at;
            out[(3 * corner) * LEAF_WIDTH + lane] = at.x;
            out[(3 * corner + 1) * LEAF_WIDTH + lane] = at.y;
            out[(3 * corner + 2) * LEAF_WIDTH + lane] = at.z;
        }
        out[(ROWS - 1) * LEAF_WIDTH + lane] = as_float(triangle);
    }
    boxes[2 * (first + block)] = low;
    boxes[2 * (first + block) + 1] = high;
}
