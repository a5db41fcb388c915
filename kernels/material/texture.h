// Textures: colours and numbers over the surface coordinates (u, v), or over space. One record says which; it is the same for
// all lanes.
#ifndef TEXTURE_H
#define TEXTURE_H
#include "common/angles.h"
#include "common/scene.h"
#include "material/image.h"
#include "material/noise.h"

#if HAS_TEXTURE
#if HAS_MAPPING
// The coordinates that take the place of u and v, by where in the world the lanes are; z where they are those of space.
static F3 mapped_coordinates(const __global Texture *t, Scene scene)
{
    F3 p = f3(row_point(t->row_x, scene.place), row_point(t->row_y, scene.place), row_point(t->row_z, scene.place));
    if (t->mapping == MAPPED_SPHERICAL)
        return f3(1.0f - share_upwards(p.z, sqrt(p.x * p.x + p.y * p.y)), turns_around(p.x, p.y), ZERO);
    if (t->mapping == MAPPED_CYLINDRICAL)
        return f3(turns_around(-p.x, -p.y), p.z, ZERO);
    if (t->mapping == MAPPED_ROUND)
        return f3(turns_around(-p.x, -p.y), normalized(p).z, ZERO);
    return p;
}
#endif

// Where many numbers and colours of a material may be textures, a GPU's program has the patterns once, and calls them: with
// each copy of them compilers took seconds longer, and more memory for what registers did not hold.
#if VW == 1 && HAS_ROUGHNESS_TEXTURE + HAS_METALLIC_TEXTURE + HAS_SPECULAR_TEXTURE + HAS_SPECULAR_COLOR_TEXTURE \
    + HAS_COAT_TEXTURE + HAS_SHEEN_TEXTURE + HAS_TRANSMISSION_TEXTURE + HAS_PASSED_TEXTURE + 3 * HAS_BUMP > 3
#define SHARED __attribute__((noinline))
#else
#define SHARED
#endif

// How far from colour a to colour b a pattern is at a point.
static F pattern_at(const __global Texture *t, F x, F y, F z, const __global uint *texels)
{
    F k = ZERO;
#if HAS_CHECKER || HAS_GRID
    F cell_x = FLOOR(x);
    F cell_y = FLOOR(y);
#endif
#if HAS_CHECKER
    if (t->kind == TEXTURE_CHECKER) {
#if HAS_MAPPING
        F half_sum = 0.5f * (cell_x + cell_y + FLOOR(z));
#else
        F half_sum = 0.5f * (cell_x + cell_y);
#endif
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
#if HAS_PERLIN
    if (t->kind == TEXTURE_PERLIN)
        k = perlin_form(texels + t->first, f3(x, y, z), t);
#endif
#if HAS_DOTS
    if (t->kind == TEXTURE_DOTS)
        k = in_spot(texels + t->first, x, y) ? ONE : ZERO;
#endif
    return k;
}

// Where on the pattern of a texture u and v are, or the place of the lanes.
static F3 pattern_point(const __global Texture *t, F u, F v, Scene scene)
{
    F z = ZERO;
#if HAS_MAPPING
    if (t->mapping != MAPPED_UV) {
        F3 there = mapped_coordinates(t, scene);
        u = there.x;
        v = there.y;
        z = there.z;
    }
#endif
    F x = t->row_u.x * u + t->row_u.y * v + t->row_u.z;
    F y = t->row_v.x * u + t->row_v.y * v + t->row_v.z;
    return f3(x, y, z);
}

SHARED static F3 pattern_color(const __global Texture *t, F x, F y, F z, const __global uint *texels)
{
#if HAS_MARBLE
    if (t->kind == TEXTURE_MARBLE)
        return marble_at(texels + t->first, f3(x, y, z), t);
#endif
#if HAS_IMAGE
    if (t->kind == TEXTURE_IMAGE) {
        F3 c = mul(image_at(t, texels, x, y), f3_of(t->a));
        return f3(MIN(c.x, (F)(t->limit)), MIN(c.y, (F)(t->limit)), MIN(c.z, (F)(t->limit)));
    }
#endif
    F k = pattern_at(t, x, y, z, texels);
#if HAS_PERLIN
    k = t->kind == TEXTURE_PERLIN ? MIN(MAX(k, ZERO), ONE) : k;
#endif
    F rest = 1.0f - k;                              // so that both ends are exact
    return f3(rest * t->a.x + k * t->b.x, rest * t->a.y + k * t->b.y, rest * t->a.z + k * t->b.z);
}

#if HAS_MIXTURE
#define MIXTURE_HELD (2 * HAS_MIXTURE + 1)      // colours at a time that the mixtures of the scene need

// The colours of the parts, the last in front; each mixture takes three. They move, so that registers hold them.
static F3 mixture_color(int texture, F u, F v, Scene scene)
{
    F3 held[MIXTURE_HELD];
#pragma unroll
    for (int k = 0; k < MIXTURE_HELD; ++k)
        held[k] = f3(ZERO, ZERO, ZERO);
    for (int i = (int)scene.textures[texture].first; i <= texture; ++i) {
        const __global Texture *t = scene.textures + i;
        if (t->kind == TEXTURE_MIXTURE) {
            F3 low = held[2], high = held[1], k = held[0];
#pragma unroll
            for (int n = 1; n < MIXTURE_HELD - 2; ++n)
                held[n] = held[n + 2];
            held[0] = f3((1.0f - k.x) * low.x + k.x * high.x, (1.0f - k.y) * low.y + k.y * high.y,
                         (1.0f - k.z) * low.z + k.z * high.z);
        } else {
            F3 at = pattern_point(t, u, v, scene);
#pragma unroll
            for (int n = MIXTURE_HELD - 1; n > 0; --n)
                held[n] = held[n - 1];
            held[0] = pattern_color(t, at.x, at.y, at.z, scene.texels);
        }
    }
    F most = (F)(scene.textures[texture].limit);        // what is mixed may exceed it
    return f3(MIN(held[0].x, most), MIN(held[0].y, most), MIN(held[0].z, most));
}
#endif

static inline F3 texture_color(int texture, F u, F v, Scene scene)
{
    const __global Texture *t = scene.textures + texture;
#if HAS_MIXTURE
    if (t->kind == TEXTURE_MIXTURE)
        return mixture_color(texture, u, v, scene);
#endif
    F3 at = pattern_point(t, u, v, scene);
    return pattern_color(t, at.x, at.y, at.z, scene.texels);
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
