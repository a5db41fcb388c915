// Counter-based random numbers: four per call, keyed by (pixel, sample, dimension, seed), hence the same whatever the wave
// size, order or interruption. PCG4D of Jarzynski and Olano, «Hash functions for GPU rendering», JCGT 9(3) 2020: a
// bijection of its 128-bit input, so no two counters collide.
#ifndef RNG_H
#define RNG_H
#include "common/width.h"

typedef struct { F a, b, c, d; } F4;

// 24 bits give every float in [0, 1 - 2^-24] exactly.
static F unit_float(U x) { return TO_F(AS_I(x >> 8)) * 5.9604644775390625e-8f; }

static F4 random4(U pixel, U sample, U dimension, uint2 seed)
{
    U x = pixel * 1664525u + 1013904223u;
    U y = sample * 1664525u + 1013904223u;
    U z = (dimension ^ seed.y) * 1664525u + 1013904223u;
    U w = (U)(seed.x * 1664525u + 1013904223u);
    x += y * w;  y += z * x;  z += x * y;  w += y * z;
    x ^= x >> 16; y ^= y >> 16; z ^= z >> 16; w ^= w >> 16;
    x += y * w;  y += z * x;  z += x * y;  w += y * z;
    F4 r;
    r.a = unit_float(x); r.b = unit_float(y); r.c = unit_float(z); r.d = unit_float(w);
    return r;
}

#endif
