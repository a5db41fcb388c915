// Gradient noise: a random slope at every lattice point (by hash, no table), blended smoothly over each cell (the
// fifth-order fade of Perlin, «Improving noise», 2002), and the sum of octaves of it.
#ifndef NOISE_H
#define NOISE_H
#include "common/scene.h"

static inline F fade(F t) { return t * t * t * (t * (t * 6.0f - 15.0f) + 10.0f); }

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

#if HAS_PERLIN || HAS_MARBLE || HAS_DOTS
#if VW == 1
#define ONE_AT_A_TIME _Pragma("unroll 1")       // on a GPU what goes on at once takes registers
#else
#define ONE_AT_A_TIME
#endif

// Perlin's noise of 2002 in space: slopes towards the twelve edges of a cube by a permutation of 256, which the table has
// twice.
static inline F slope_of_bits(I bits, F x, F y, F z)
{
    I slope = bits & 15;
    I last = (slope == 12) | (slope == 13);
    F u = ((slope < 8) | last) ? x : y;
    F v = ((slope < 4) | last) ? y : z;
    return ((slope & 1) != 0 ? -u : u) + ((slope & 2) != 0 ? -v : v);
}

static F perlin_noise(const __global uint *table, F x, F y, F z)
{
    F fx = FLOOR(x), fy = FLOOR(y), fz = FLOOR(z);
    I ix = TO_I(fx) & 255, iy = TO_I(fy) & 255, iz = TO_I(fz) & 255;
    F dx = x - fx, dy = y - fy, dz = z - fz;
    F along_x = fade(dx), along_y = fade(dy), along_z = fade(dz);
    I left = AS_I(GATHER(U, table, ix, )) + iy;
    I right = AS_I(GATHER(U, table, ix + 1, )) + iy;
    F layer = ZERO, first_layer = ZERO;
    ONE_AT_A_TIME
    for (int k = 0; k < 2; ++k) {
        F row = ZERO, first_row = ZERO;
        F z_k = dz - (float)k;
        ONE_AT_A_TIME
        for (int j = 0; j < 2; ++j) {
            F y_j = dy - (float)j;
            I a = AS_I(GATHER(U, table, AS_I(GATHER(U, table, left + j, )) + iz + k, ));
            I b = AS_I(GATHER(U, table, AS_I(GATHER(U, table, right + j, )) + iz + k, ));
            F low = slope_of_bits(a, dx, y_j, z_k);
            first_row = row;
            row = low + along_x * (slope_of_bits(b, dx - 1.0f, y_j, z_k) - low);
        }
        first_layer = layer;
        layer = first_row + along_y * (row - first_row);
    }
    return first_layer + along_z * (layer - first_layer);
}

// The sum of octaves, or of their sizes with what pbrt adds for all further ones: each 1.99 times as fine as the last and
// `gain` times as strong.
static F octaves_of_perlin(const __global uint *table, F3 p, int octaves, float gain, int sizes)
{
    F sum = ZERO;
    float amplitude = 1.0f, fine = 1.0f;
    for (int i = 0; i < octaves; ++i) {
        F n = perlin_noise(table, fine * p.x, fine * p.y, fine * p.z);
        sum += amplitude * (sizes ? absolute(n) : n);
        fine *= 1.99f;
        amplitude *= gain;
    }
    return sizes ? sum + 0.2f * amplitude : sum;
}
#endif

#if HAS_PERLIN
static F perlin_form(const __global uint *table, F3 p, const __global Texture *t)
{
    int wind = t->form == PERLIN_WIND;
    F gust = ONE, n = ZERO;
#pragma unroll 1            // so that the noise stands in programs once
    for (int finer = wind ? 0 : 1; finer < 2; ++finer) {
        gust = finer == 0 ? gust : (wind ? absolute(n) : ONE);
        n = octaves_of_perlin(table, scale(p, (F)(finer ? 1.0f : 0.1f)), wind ? (finer ? 6 : 3) : t->octaves,
                              wind ? 0.5f : t->parameter, t->form == PERLIN_TURBULENCE);
    }
    return gust * n;
}
#endif

#if HAS_MARBLE
// A sine along y, shifted by noise, as a spline of colours: nine control points after the permutation, six cubic pieces.
#define MARBLE_POINTS 512
static inline F marble_point(const __global uint *table, I index) { return AS_F(GATHER(U, table, index, )); }

static F3 marble_at(const __global uint *table, F3 p, const __global Texture *t)
{
    F phase = p.y + t->variation * octaves_of_perlin(table, p, t->octaves, t->parameter, 0);
    F turns = phase * 0.159154943092f;
    F sine, cosine;
    sincos_turns(turns - FLOOR(turns), &sine, &cosine);
    F place = 3.0f + 3.0f * sine;
    F piece = MIN(MAX(FLOOR(place), ZERO), (F)((float)t->form));        // beyond its last piece a spline goes on
    F k = place - piece, rest = 1.0f - k;
    I first = MARBLE_POINTS + 3 * TO_I(piece);
    F share[4] = {rest * rest * rest, 3.0f * k * rest * rest, 3.0f * k * k * rest, k * k * k};
    F3 c = f3(ZERO, ZERO, ZERO);
    for (int i = 0; i < 4; ++i)
        c = along(c, f3(marble_point(table, first + 3 * i), marble_point(table, first + 3 * i + 1),
                        marble_point(table, first + 3 * i + 2)), share[i]);
    c = mul(c, f3_of(t->a));
    F most = (F)(t->limit);
    return t->form < 5 ? f3(MIN(MAX(c.x, ZERO), most), MIN(MAX(c.y, ZERO), most), MIN(MAX(c.z, ZERO), most)) : c;
}
#endif

#if HAS_DOTS
// Whether a spot lies at a place: in the cells where noise is above 0, shifted within them by noise.
static I in_spot(const __global uint *table, F x, F y)
{
    F cell_x = FLOOR(x + 0.5f), cell_y = FLOOR(y + 0.5f);
    F half_way = (F)(0.5f);
    I there = perlin_noise(table, cell_x + 0.5f, cell_y + 0.5f, half_way) > 0.0f;
    F dx = x - cell_x - 0.15f * perlin_noise(table, cell_x + 1.5f, cell_y + 2.8f, half_way);
    F dy = y - cell_y - 0.15f * perlin_noise(table, cell_x + 4.5f, cell_y + 9.8f, half_way);
    return there & (dx * dx + dy * dy < 0.1225f);
}
#endif

#endif
