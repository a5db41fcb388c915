// Gradient noise: a random slope at every lattice point (by hash, no table), blended smoothly over each cell (the
// fifth-order fade of Perlin, «Improving noise», 2002), and the sum of octaves of it.
#ifndef NOISE_H
#define NOISE_H
#include "common/math.h"

#if HAS_NOISE
// 32 well-mixed bits of a lattice point: the integer hash of Jarzynski and Olano, JCGT 9(3) 2020, in two dimensions (pcg2d).
static U lattice_hash(U x, U y, uint seed)
{
    x = x * 1664525u + 1013904223u + seed;
    y = y * 1664525u + 1013904223u;
    x += y * 1664525u;
    y += x * 1664525u;
    x ^= x >> 16;
    y ^= y >> 16;
    x += y * 1664525u;
    y += x * 1664525u;
    return y ^ (x >> 16);
}

// Height, at the offset (x, y), of the plane through a lattice point with slopes of -1 … 1 each.
static inline F slope_at(I column, I row, uint seed, F x, F y)
{
    U bits = lattice_hash(AS_U(column), AS_U(row), seed);
    F a = TO_F(AS_I(bits & 65535u)) * (1.0f / 32768.0f) - 1.0f;
    F b = TO_F(AS_I(bits >> 16)) * (1.0f / 32768.0f) - 1.0f;
    return a * x + b * y;
}

static inline F fade(F t) { return t * t * t * (t * (t * 6.0f - 15.0f) + 10.0f); }

// Within -1 … 1; standard deviation 0.18.
static F gradient_noise(F x, F y, uint seed)
{
    F fx = FLOOR(x);
    F fy = FLOOR(y);
    I column = TO_I(fx);
    I row = TO_I(fy);
    F dx = x - fx;
    F dy = y - fy;
    F along_x = fade(dx);
    F below = slope_at(column, row, seed, dx, dy);
    below += along_x * (slope_at(column + 1, row, seed, dx - 1.0f, dy) - below);
    F above = slope_at(column, row + 1, seed, dx, dy - 1.0f);
    above += along_x * (slope_at(column + 1, row + 1, seed, dx - 1.0f, dy - 1.0f) - above);
    return below + fade(dy) * (above - below);
}

// The sum of octaves, each at twice the frequency, `gain` times the amplitude and with slopes of its own, over the root of
// the sum of their squares: as far spread as one octave.
static F octaves_of_noise(F x, F y, int octaves, float gain, uint seed)
{
    F sum = ZERO;
    float amplitude = 1.0f, squares = 0.0f;
    for (int i = 0; i < octaves; ++i) {
        sum += amplitude * gradient_noise(x, y, seed + (uint)i * 2654435769u);
        squares += amplitude * amplitude;
        amplitude *= gain;
        x = 2.0f * x + 0.5f;        // so that the lattice points of octaves, where noise is zero, do not coincide
        y = 2.0f * y + 0.5f;
    }
    return sum / sqrt(squares);
}
#endif

#endif
