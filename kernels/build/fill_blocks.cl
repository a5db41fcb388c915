// Writes the corners of triangles into leaf blocks once more, for vertices that have moved: one work item per block.
// A block (kernels/geometry/bvh.h) has rows x, y, z of the three corners, and the triangles, -1 where there is none.

#define ROWS 10

__kernel void fill_blocks(__global const float *before,     // [count][ROWS][LEAF_WIDTH] the same triangles
                          __global float       *blocks,
                          __global const float *vertices,   // [][VERTEX_FLOATS]
                          __global const int   *triangles,  // [][4] the corners' vertices
                          int                   count)      // blocks
{
    int block = (int)get_global_id(0);
    if (block >= count)
        return;
    __global const float *own = before + (size_t)block * ROWS * LEAF_WIDTH;
    __global float *out = blocks + (size_t)block * ROWS * LEAF_WIDTH;
    for (int lane = 0; lane < LEAF_WIDTH; lane++)
    {
        float number = own[(ROWS - 1) * LEAF_WIDTH + lane];
        int triangle = as_int(number);
        int4 corners = vload4(max(triangle, 0), triangles);
        int vertex[3] = {corners.x, corners.y, corners.z};
        for (int corner = 0; corner < 3; corner++)
        {
            float4 at = vload4(0, vertices + VERTEX_FLOATS * (size_t)vertex[corner]);
            at = triangle < 0 ? (float4)(0.0f) : at;
            out[(3 * corner) * LEAF_WIDTH + lane] = at.x;
            out[(3 * corner + 1) * LEAF_WIDTH + lane] = at.y;
            out[(3 * corner + 2) * LEAF_WIDTH + lane] = at.z;
        }
        out[(ROWS - 1) * LEAF_WIDTH + lane] = number;
    }
}
