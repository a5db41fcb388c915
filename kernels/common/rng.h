// A counter-based hash: four words per counter (pixel, sample, dimension, seed), so the same for any wave size,
// order or interruption. PCG4D of Jarzynski and Olano, «Hash functions for GPU rendering», JCGT 9(3) 2020: a bijection of
// its 128-bit input, so no two counters collide.
#ifndef RNG_H
#define RNG_H
#include "common/width.h"

typedef struct { U a, b, c, d; } U4;
typedef struct { F a, b, c, d; } F4;

static U4 hash4(U pixel, U sample, U dimension, uint2 seed)
{
    U4 h;
    h.a = pixel * 1664525u + 1013904223u;
    h.b = sample * 1664525u + 1013904223u;
    h.c = (dimension ^ seed.y) * 1664525u + 1013904223u;
    h.d = (U)(seed.x * 1664525u + 1013904223u);
    h.a += h.b * h.d;  h.b += h.c * h.a;  h.c += h.a * h.b;  h.d += h.b * h.c;
    h.a ^= h.a >> 16; h.b ^= h.b >> 16; h.c ^= h.c >> 16; h.d ^= h.d >> 16;
    h.a += h.b * h.d;  h.b += h.c * h.a;  h.c += h.a * h.b;  h.d += h.b * h.c;
    return h;
}

// 24 bits give every float in [0, 1 - 2^-24] exactly.
static inline F unit_float(U x) { return TO_F(AS_I(x >> 8)) * 5.9604644775390625e-8f; }

static inline F4 unit_floats(U4 x)
{
    F4 r;
    r.a = unit_float(x.a); r.b = unit_float(x.b); r.c = unit_float(x.c); r.d = unit_float(x.d);
    return r;
}

#endif
