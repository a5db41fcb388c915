// The reflectance of a material at texture coordinates: constant, checker or grid of lines.
#ifndef TEXTURE_H
#define TEXTURE_H
#include "common/records.h"

static F3 reflectance_at(const __global Material *material, F u, F v)
{
    F3 color = f3_of(material->color);
#if HAS_TEXTURE
    if (material->texture != TEXTURE_CONSTANT) {
        F x = u * material->mapping.x + material->mapping.z;
        F y = v * material->mapping.y + material->mapping.w;
        F cell_x = floor(x);
        F cell_y = floor(y);
        I second = FALSE;
#if HAS_CHECKER
        if (material->texture == TEXTURE_CHECKER) {
            F half_sum = 0.5f * (cell_x + cell_y);
            second = half_sum != floor(half_sum);
        }
#endif
#if HAS_GRID
        if (material->texture == TEXTURE_GRID)
            second = (x - cell_x < material->line_width) | (y - cell_y < material->line_width);
#endif
        color = select3(second, f3_of(material->other), color);
    }
#endif
    return color;
}

#endif
