// The reflectance of a material at texture coordinates: constant, checker or grid of lines.
#ifndef TEXTURE_H
#define TEXTURE_H
#include "common/records.h"

static F3 gather_color(const __global Material *ms, I m)
{
    return f3(GATHER(F, ms, m, .color.x), GATHER(F, ms, m, .color.y), GATHER(F, ms, m, .color.z));
}

static F3 reflectance_at(const __global Material *ms, I m, F u, F v)
{
    F3 color = gather_color(ms, m);
#if HAS_TEXTURE
    I kind = GATHER(I, ms, m, .texture);
    if (ANY(kind != TEXTURE_CONSTANT)) {
        F x = u * GATHER(F, ms, m, .mapping.x) + GATHER(F, ms, m, .mapping.z);
        F y = v * GATHER(F, ms, m, .mapping.y) + GATHER(F, ms, m, .mapping.w);
        F cell_x = floor(x);
        F cell_y = floor(y);
        F3 other = f3(GATHER(F, ms, m, .other.x), GATHER(F, ms, m, .other.y), GATHER(F, ms, m, .other.z));
        I second = FALSE;
#if HAS_CHECKER
        F half_sum = 0.5f * (cell_x + cell_y);
        second |= (kind == TEXTURE_CHECKER) & (half_sum != floor(half_sum));
#endif
#if HAS_GRID
        F width = GATHER(F, ms, m, .line_width);
        second |= (kind == TEXTURE_GRID) & ((x - cell_x < width) | (y - cell_y < width));
#endif
        color = select3(second, other, color);
    }
#endif
    return color;
}

#endif
