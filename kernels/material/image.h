// Pictures as textures: texels of 8 bits (packed red, green, blue from the low byte on) or halves (two words: red and green,
// blue), rows from the bottom, one texel more per row that repeats the first, so that a texel and its right neighbour
// are read together. Which picture is the same for all lanes; base and size are then no gathers.
// Measured on PoCL for 8 lanes: see docs/textures.md.
#ifndef IMAGE_H
#define IMAGE_H
#include "common/scene.h"
#include "common/transpose.h"

#if HAS_IMAGE || EMITTER_PROFILES || ENVIRONMENT == ENVIRONMENT_IMAGE
// Linear value of sRGB codes 0 to 1 (IEC 61966-2-1): a fit through 1 to the 256 codes, relative error below 4e-5.
static inline F srgb_decoded(F c)
{
    F p = 0.00084768841f + c * (0.035566021f + c * (0.48221895f + c * (0.87610829f + c * (-0.87665248f
        + c * (0.87562668f + c * (-0.53258198f + c * 0.13886686f))))));
    return c <= 0.04045f ? c * 0.0773993808f : p;
}

// A half without sign: its bits in a float's place are 2^112 too small.
static inline F half_decoded(I bits) { return AS_F(bits << 13) * 5.192296858534828e33f; }

static inline F3 texel_of(int format, I low, I high)
{
    if (format == TEXEL_HALF)
        return f3(half_decoded(low & 0x7fff), half_decoded((low >> 16) & 0x7fff), half_decoded(high & 0x7fff));
    F3 c = scale(f3(TO_F(low & 255), TO_F((low >> 8) & 255), TO_F((low >> 16) & 255)), (F)(1.0f / 255.0f));
    return format == TEXEL_SRGB ? f3(srgb_decoded(c.x), srgb_decoded(c.y), srgb_decoded(c.z)) : c;
}

// The texels at an index and to its right.
static inline void texel_pair(const __global uint *texels, int format, I index, F3 *left, F3 *right)
{
    I a, b, c, d;
    load_four(texels, format == TEXEL_HALF ? 2 * index : index, &a, &b, &c, &d);
    *left = texel_of(format, a, b);
    *right = format == TEXEL_HALF ? texel_of(format, c, d) : texel_of(format, b, FALSE);
}

// A coordinate of the picture taken to 0 … 1.
static inline F wrapped(F x, int wrap)
{
    if (wrap == WRAP_CLAMP)
        return MIN(MAX(x, ZERO), ONE);
    if (wrap == WRAP_REPEAT)
        return x - FLOOR(x);
    F y = x - 2.0f * FLOOR(0.5f * x);
    return MIN(y, 2.0f - y);
}

static inline I within(I i, int count) { return MIN(MAX(i, FALSE), (I)(count - 1)); }

// Where between the centres of texels a coordinate lies: after the centre of texel *before, the share *after of the way.
static inline void between(F x, int count, int wrap, I *before, F *after)
{
    F place = x * (float)count - 0.5f;
    if (wrap == WRAP_REPEAT)
        place = place < 0.0f ? place + (float)count : place;
    else
        place = MIN(MAX(place, ZERO), (F)((float)(count - 1)));
    F whole = FLOOR(place);
    *before = within(TO_I(whole), count);
    *after = place - whole;
}

static inline F3 mixed(F3 a, F3 b, F k) { return f3(a.x + k * (b.x - a.x), a.y + k * (b.y - a.y), a.z + k * (b.z - a.z)); }

static inline F3 image_nearest(const __global Texture *t, const __global uint *texels, F x, F y)
{
    I column = within(TO_I(x * (float)t->width), t->width);
    I row = within(TO_I(y * (float)t->height), t->height);
    I index = row * (t->width + 1) + column;
    if (t->format == TEXEL_HALF)
        return texel_of(TEXEL_HALF, AS_I(GATHER(U, texels, 2 * index, )), AS_I(GATHER(U, texels, 2 * index + 1, )));
    return texel_of(t->format, AS_I(GATHER(U, texels, index, )), FALSE);
}

static F3 image_bilinear(const __global Texture *t, const __global uint *texels, F x, F y)
{
    I column, row;
    F right, above;
    between(x, t->width, t->wrap_u, &column, &right);
    between(y, t->height, t->wrap_v, &row, &above);
    I next = row + 1;
    next = next < t->height ? next : (t->wrap_v == WRAP_REPEAT ? FALSE : row);
    F3 a, b, c, d;
    texel_pair(texels, t->format, row * (t->width + 1) + column, &a, &b);
    texel_pair(texels, t->format, next * (t->width + 1) + column, &c, &d);
    return mixed(mixed(a, b, right), mixed(c, d, right), above);
}

// The picture at coordinates in which it fills 0 … 1; linear, without its gain.
static inline F3 image_at(const __global Texture *t, const __global uint *all_texels, F x, F y)
{
    const __global uint *texels = all_texels + t->first;
    F wx = wrapped(x, t->wrap_u);
    F wy = wrapped(y, t->wrap_v);
    return t->nearest ? image_nearest(t, texels, wx, wy) : image_bilinear(t, texels, wx, wy);
}
#endif

#endif
