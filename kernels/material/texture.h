// Textures: colours and numbers over the surface coordinates (u, v). One record says which; it is the same for all lanes.
#ifndef TEXTURE_H
#define TEXTURE_H
#include "common/scene.h"
#include "material/image.h"
#include "material/noise.h"

#if HAS_TEXTURE
// How far from colour a to colour b a pattern is at a point.
static F pattern_at(const __global Texture *t, F x, F y)
{
    F k = ZERO;
#if HAS_CHECKER || HAS_GRID
    F cell_x = FLOOR(x);
    F cell_y = FLOOR(y);
#endif
#if HAS_CHECKER
    if (t->kind == TEXTURE_CHECKER) {
        F half_sum = 0.5f * (cell_x + cell_y);
        k = half_sum != FLOOR(half_sum) ? ONE : ZERO;
    }
#endif
#if HAS_GRID
    if (t->kind == TEXTURE_GRID)
        k = ((x - cell_x < t->parameter) | (y - cell_y < t->parameter)) ? ONE : ZERO;
#endif
#if HAS_GRADIENT
    if (t->kind == TEXTURE_GRADIENT)
        k = MIN(MAX(x, ZERO), ONE);
#endif
#if HAS_NOISE
    if (t->kind == TEXTURE_NOISE) {
        F n = 0.5f + t->contrast * octaves_of_noise(x, y, t->octaves, t->parameter, (uint)t->seed);
        k = MIN(MAX(n, ZERO), ONE);
    }
#endif
    return k;
}

static F3 texture_color(int texture, F u, F v, Scene scene)
{
    const __global Texture *t = scene.textures + texture;
    F x = t->row_u.x * u + t->row_u.y * v + t->row_u.z;
    F y = t->row_v.x * u + t->row_v.y * v + t->row_v.z;
#if HAS_IMAGE
    if (t->kind == TEXTURE_IMAGE) {
        F3 c = mul(image_at(t, scene.texels, x, y), f3_of(t->a));
        return f3(MIN(c.x, (F)(t->limit)), MIN(c.y, (F)(t->limit)), MIN(c.z, (F)(t->limit)));
    }
#endif
    F k = pattern_at(t, x, y);
    F rest = 1.0f - k;                              // so that both ends are exact
    return f3(rest * t->a.x + k * t->b.x, rest * t->a.y + k * t->b.y, rest * t->a.z + k * t->b.z);
}

// The first channel, of textures that stand for a number.
static inline F texture_scalar(int texture, F u, F v, Scene scene) { return texture_color(texture, u, v, scene).x; }
#endif

// The colour of a material at texture coordinates: constant where it has no texture.
static inline F3 reflectance_at(const __global Material *material, F u, F v, Scene scene)
{
#if HAS_TEXTURE
    if (material->texture >= 0)
        return texture_color(material->texture, u, v, scene);
#endif
    return f3_of(material->color);
}

#endif
