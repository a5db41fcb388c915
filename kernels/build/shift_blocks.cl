// Moves the corners of the triangles in leaf blocks, rounded once, as the host does with vertices: one work item per block.
// Reads and writes blocks as `build/fill_blocks.cl` writes them.
#pragma OPENCL EXTENSION cl_khr_fp64 : enable

#define ROWS            10
#define JOINED(a, b)    a##b
#define SIZED(name, n)  JOINED(name, n)
#define LANES(name)     SIZED(name, LEAF_WIDTH)
#define LOAD(row, p)    LANES(vload)(row, p)

__kernel void shift_blocks(__global const float *before,  // [][ROWS][LEAF_WIDTH]
                           __global float       *blocks,  // the same of the moved ones
                           double                shift_x, // m
                           double                shift_y,
                           double                shift_z,
                           int                   first,   // block to be moved
                           int                   count)   // blocks
{
    int block = (int)get_global_id(0);
    if (block >= count)
        return;
    size_t place = (size_t)(first + block) * ROWS * LEAF_WIDTH;
    __global const float *own = before + place;
    __global float *out = blocks + place;
    double shift[3] = {shift_x, shift_y, shift_z};
    LANES(float) triangles = LOAD(ROWS - 1, own);
    for (int row = 0; row < ROWS - 1; row++)
    {
        LANES(float) at = LANES(convert_float)(LANES(convert_double)(LOAD(row, own)) + shift[row % 3]);
        LANES(vstore)(LANES(as_int)(triangles) < 0 ? (LANES(float))(0.0f) : at, row, out);
    }
    LANES(vstore)(triangles, ROWS - 1, out);
}
