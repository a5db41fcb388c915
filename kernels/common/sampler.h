// The numbers that a sample of a pixel is made of: four per call, keyed by (pixel, sample, dimension, seed). Dimension 0 is
// the camera's (film point, pupil point); vertex e of the path chooses its light by dimension 2 e + 1, its next direction by
// 2 e. Dimension 1 belongs to the path as a whole and is read by path_numbers.
// Facts: SAMPLER_LATTICE; without it every number is independent.
#ifndef SAMPLER_H
#define SAMPLER_H
#include "common/rng.h"

typedef struct { F a, b; } Pair;

#if SAMPLER_LATTICE
// A rank-1 lattice sequence (Cools, Kuo, Nuyens 2006): sample i of a pixel lies at phi(i) z + shift, modulo 1, where phi
// mirrors the binary digits of i at the point. Any 2^k samples from a multiple of 2^k on are a shifted lattice of that size.
// The shift is the hash of pixel and dimension, uniform and independent over both: each sample alone is uniform, so the
// mean is unbiased (Cranley and Patterson 1976), and pixels are independent. The generating vector z was searched
// (benchmarks/lattice_search.py) component by component for 2^2 to 2^18 samples, and for the pairs and triples that
// integrands of paths depend on. Lights of different vertices are never in one product, so they share their components. So
// many components cannot all be good together at few samples: from the third vertex on directions take the samples in
// another order, which makes them independent of the rest.
#define DEEP 6u     // dimension of the third vertex's direction

static inline U reversed_bits(U x)
{
    x = ((x >> 1) & 0x55555555u) | ((x & 0x55555555u) << 1);
    x = ((x >> 2) & 0x33333333u) | ((x & 0x33333333u) << 2);
    x = ((x >> 4) & 0x0f0f0f0fu) | ((x & 0x0f0f0f0fu) << 4);
    x = ((x >> 8) & 0x00ff00ffu) | ((x & 0x00ff00ffu) << 8);
    return (x >> 16) | (x << 16);
}

// A random permutation of the binary tree of digits (Laine and Karras 2011, with the multipliers of Vegdahl 2021): every
// 2^k aligned samples stay together.
static inline U nested_permutation(U x, U seed)
{
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1u;
    x ^= x * 0x05526c56u;
    return x ^ (x * 0x53a22864u);
}

static inline U component(U dimension, uint camera, uint light, uint first, uint second)
{
    U direction = dimension == 2u ? (U)(first) : (U)(second);
    return (dimension & 1u) != 0u ? (U)(light) : (dimension == 0u ? (U)(camera) : direction);
}

static F4 random4(U pixel, U sample, U dimension, uint2 seed)
{
    U4 x = hash4(pixel, (U)(0u), dimension, seed);
    U phi = reversed_bits(sample);
    I deep = (dimension >= DEEP) & ((dimension & 1u) == 0u);
    if (ANY(deep))
        phi = deep ? nested_permutation(phi, x.a ^ (x.c << 16 | x.c >> 16)) : phi;
    x.a += phi * component(dimension, 1u, 150225u, 4275u, 114053u);
    x.b += phi * component(dimension, 33575u, 40171u, 57953u, 38193u);
    x.c += phi * component(dimension, 85533u, 197955u, 148039u, 132887u);
    x.d += phi * component(dimension, 236635u, 211637u, 175223u, 14637u);
    return unit_floats(x);
}

// What holds for a whole path: `a` chooses its wavelength, `b` its time. Two components of the lattice more, searched for
// pairs with all others.
static inline Pair path_numbers(U pixel, U sample, uint2 seed)
{
    U4 x = hash4(pixel, (U)(0u), (U)(1u), seed);
    U phi = reversed_bits(sample);
    Pair r;
    r.a = unit_float(x.a + phi * 259245u);
    r.b = unit_float(x.b + phi * 233999u);
    return r;
}

#else
static inline F4 random4(U pixel, U sample, U dimension, uint2 seed)
{
    return unit_floats(hash4(pixel, sample, dimension, seed));
}

static inline Pair path_numbers(U pixel, U sample, uint2 seed)
{
    U4 x = hash4(pixel, sample, (U)(1u), seed);
    Pair r;
    r.a = unit_float(x.a);
    r.b = unit_float(x.b);
    return r;
}
#endif

#endif
