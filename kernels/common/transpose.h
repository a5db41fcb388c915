// Eight or four neighbouring words in memory per lane: written and read whole, turned by shuffles instead of lane by lane.
#ifndef TRANSPOSE_H
#define TRANSPOSE_H
#include "common/width.h"

typedef struct { F f[8]; } Eight;

#if VW == 1
static inline Eight load_eight(const __global float *p, I offset)
{
    float8 v = vload8(0, p + offset);
    Eight e;
    e.f[0] = v.s0; e.f[1] = v.s1; e.f[2] = v.s2; e.f[3] = v.s3;
    e.f[4] = v.s4; e.f[5] = v.s5; e.f[6] = v.s6; e.f[7] = v.s7;
    return e;
}

static inline void store_eight(__global float *p, uint first, Eight e)
{
    vstore8((float8)(e.f[0], e.f[1], e.f[2], e.f[3], e.f[4], e.f[5], e.f[6], e.f[7]), first, p);
}
#else
#define PAIR_LO(a, b) ((float8)((a).s0, (b).s0, (a).s1, (b).s1, (a).s4, (b).s4, (a).s5, (b).s5))
#define PAIR_HI(a, b) ((float8)((a).s2, (b).s2, (a).s3, (b).s3, (a).s6, (b).s6, (a).s7, (b).s7))
#define QUAD_LO(a, b) ((float8)((a).s0, (a).s1, (b).s0, (b).s1, (a).s4, (a).s5, (b).s4, (b).s5))
#define QUAD_HI(a, b) ((float8)((a).s2, (a).s3, (b).s2, (b).s3, (a).s6, (a).s7, (b).s6, (b).s7))

static inline void transpose8(float8 *r)
{
    float8 a = PAIR_LO(r[0], r[1]), b = PAIR_HI(r[0], r[1]), c = PAIR_LO(r[2], r[3]), d = PAIR_HI(r[2], r[3]);
    float8 e = PAIR_LO(r[4], r[5]), f = PAIR_HI(r[4], r[5]), g = PAIR_LO(r[6], r[7]), h = PAIR_HI(r[6], r[7]);
    float8 p = QUAD_LO(a, c), q = QUAD_HI(a, c), s = QUAD_LO(b, d), t = QUAD_HI(b, d);
    float8 u = QUAD_LO(e, g), v = QUAD_HI(e, g), w = QUAD_LO(f, h), x = QUAD_HI(f, h);
    r[0] = (float8)(p.lo, u.lo); r[1] = (float8)(q.lo, v.lo); r[2] = (float8)(s.lo, w.lo); r[3] = (float8)(t.lo, x.lo);
    r[4] = (float8)(p.hi, u.hi); r[5] = (float8)(q.hi, v.hi); r[6] = (float8)(s.hi, w.hi); r[7] = (float8)(t.hi, x.hi);
}

static inline void load_rows(const __global float *p, int8 i, float8 *r)
{
    r[0] = vload8(0, p + i.s0); r[1] = vload8(0, p + i.s1); r[2] = vload8(0, p + i.s2); r[3] = vload8(0, p + i.s3);
    r[4] = vload8(0, p + i.s4); r[5] = vload8(0, p + i.s5); r[6] = vload8(0, p + i.s6); r[7] = vload8(0, p + i.s7);
    transpose8(r);
}

#if VW == 8
static Eight load_eight(const __global float *p, I offset)
{
    float8 r[8];
    load_rows(p, offset, r);
    Eight e;
    for (int k = 0; k < 8; ++k)
        e.f[k] = r[k];
    return e;
}

static void store_eight(__global float *p, uint first, Eight e)
{
    float8 r[8];
    for (int k = 0; k < 8; ++k)
        r[k] = e.f[k];
    transpose8(r);
    for (int k = 0; k < 8; ++k)
        vstore8(r[k], first + k, p);
}
#elif defined CLANG_AVX512
// Rows k and k + 8 side by side in one register, and three shuffles of whole registers for each, which the compiler takes as
// they are. The general form below it takes apart: a camera ray through a lens then has 1.7 times the instructions.
#define ROW_PAIR(a, b, ...)  __builtin_shufflevector(a, b, __VA_ARGS__)
#define LO_FLOATS(a, b)  ROW_PAIR(a, b, 0, 16, 1, 17, 4, 20, 5, 21, 8, 24, 9, 25, 12, 28, 13, 29)
#define HI_FLOATS(a, b)  ROW_PAIR(a, b, 2, 18, 3, 19, 6, 22, 7, 23, 10, 26, 11, 27, 14, 30, 15, 31)
#define LO_PAIRS(a, b)   ROW_PAIR(a, b, 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24, 25, 12, 13, 28, 29)
#define HI_PAIRS(a, b)   ROW_PAIR(a, b, 2, 3, 18, 19, 6, 7, 22, 23, 10, 11, 26, 27, 14, 15, 30, 31)
#define LO_FOURS(a, b)   ROW_PAIR(a, b, 0, 1, 2, 3, 16, 17, 18, 19, 8, 9, 10, 11, 24, 25, 26, 27)
#define HI_FOURS(a, b)   ROW_PAIR(a, b, 4, 5, 6, 7, 20, 21, 22, 23, 12, 13, 14, 15, 28, 29, 30, 31)

typedef float8 __attribute__((aligned(4))) EightInMemory;

// Both 8 x 8 squares of eight registers turned at once.
static inline Eight turned_squares(float16 r0, float16 r1, float16 r2, float16 r3, float16 r4, float16 r5, float16 r6, float16 r7)
{
    float16 a = LO_FLOATS(r0, r1), b = HI_FLOATS(r0, r1), c = LO_FLOATS(r2, r3), d = HI_FLOATS(r2, r3);
    float16 e = LO_FLOATS(r4, r5), f = HI_FLOATS(r4, r5), g = LO_FLOATS(r6, r7), h = HI_FLOATS(r6, r7);
    float16 p = LO_PAIRS(a, c), q = HI_PAIRS(a, c), s = LO_PAIRS(b, d), t = HI_PAIRS(b, d);
    float16 u = LO_PAIRS(e, g), v = HI_PAIRS(e, g), w = LO_PAIRS(f, h), x = HI_PAIRS(f, h);
    Eight out;
    out.f[0] = LO_FOURS(p, u); out.f[1] = LO_FOURS(q, v); out.f[2] = LO_FOURS(s, w); out.f[3] = LO_FOURS(t, x);
    out.f[4] = HI_FOURS(p, u); out.f[5] = HI_FOURS(q, v); out.f[6] = HI_FOURS(s, w); out.f[7] = HI_FOURS(t, x);
    return out;
}

static inline float16 row_pair(const __global float *p, int a, int b)
{
    float8 low = *(const __global EightInMemory *)(p + a), high = *(const __global EightInMemory *)(p + b);
    return __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
}

static inline Eight load_eight(const __global float *p, I i)
{
    return turned_squares(row_pair(p, i.s0, i.s8), row_pair(p, i.s1, i.s9), row_pair(p, i.s2, i.sa),
                          row_pair(p, i.s3, i.sb), row_pair(p, i.s4, i.sc), row_pair(p, i.s5, i.sd),
                          row_pair(p, i.s6, i.se), row_pair(p, i.s7, i.sf));
}

static inline void store_eight(__global float *p, uint first, Eight e)
{
    Eight rows = turned_squares(e.f[0], e.f[1], e.f[2], e.f[3], e.f[4], e.f[5], e.f[6], e.f[7]);
    __global EightInMemory *to = (__global EightInMemory *)(p + (size_t)first * 8);
    to[0] = rows.f[0].lo; to[1] = rows.f[1].lo; to[2] = rows.f[2].lo; to[3] = rows.f[3].lo;
    to[4] = rows.f[4].lo; to[5] = rows.f[5].lo; to[6] = rows.f[6].lo; to[7] = rows.f[7].lo;
    to[8] = rows.f[0].hi; to[9] = rows.f[1].hi; to[10] = rows.f[2].hi; to[11] = rows.f[3].hi;
    to[12] = rows.f[4].hi; to[13] = rows.f[5].hi; to[14] = rows.f[6].hi; to[15] = rows.f[7].hi;
}
#elif VW == 16
static Eight load_eight(const __global float *p, I offset)
{
    float8 low[8], high[8];
    load_rows(p, offset.lo, low);
    load_rows(p, offset.hi, high);
    Eight e;
    for (int k = 0; k < 8; ++k)
        e.f[k] = (float16)(low[k], high[k]);
    return e;
}

static void store_eight(__global float *p, uint first, Eight e)
{
    float8 r[8];
    for (int k = 0; k < 8; ++k)
        r[k] = e.f[k].lo;
    transpose8(r);
    for (int k = 0; k < 8; ++k)
        vstore8(r[k], first + k, p);
    for (int k = 0; k < 8; ++k)
        r[k] = e.f[k].hi;
    transpose8(r);
    for (int k = 0; k < 8; ++k)
        vstore8(r[k], first + 8 + k, p);
}
#endif
#endif

// Four neighbouring words of each lane, loaded whole and turned by shuffles.
static void load_four(const __global uint *words, I i, I *a, I *b, I *c, I *d)
{
#if VW == 8 && !DOUBLE
    const __global float *p = (const __global float *)words;
    float8 r0 = (float8)(vload4(0, p + i.s0), vload4(0, p + i.s4));
    float8 r1 = (float8)(vload4(0, p + i.s1), vload4(0, p + i.s5));
    float8 r2 = (float8)(vload4(0, p + i.s2), vload4(0, p + i.s6));
    float8 r3 = (float8)(vload4(0, p + i.s3), vload4(0, p + i.s7));
    float8 low = PAIR_LO(r0, r1), low_next = PAIR_LO(r2, r3), high = PAIR_HI(r0, r1), high_next = PAIR_HI(r2, r3);
    *a = AS_I(QUAD_LO(low, low_next));
    *b = AS_I(QUAD_HI(low, low_next));
    *c = AS_I(QUAD_LO(high, high_next));
    *d = AS_I(QUAD_HI(high, high_next));
#elif VW == 16 && defined CLANG_AVX512
    const __global float *p = (const __global float *)words;
    float16 r0 = (float16)(vload4(0, p + i.s0), vload4(0, p + i.s4), vload4(0, p + i.s8), vload4(0, p + i.sc));
    float16 r1 = (float16)(vload4(0, p + i.s1), vload4(0, p + i.s5), vload4(0, p + i.s9), vload4(0, p + i.sd));
    float16 r2 = (float16)(vload4(0, p + i.s2), vload4(0, p + i.s6), vload4(0, p + i.sa), vload4(0, p + i.se));
    float16 r3 = (float16)(vload4(0, p + i.s3), vload4(0, p + i.s7), vload4(0, p + i.sb), vload4(0, p + i.sf));
    float16 low = LO_FLOATS(r0, r1), low_next = LO_FLOATS(r2, r3), high = HI_FLOATS(r0, r1), high_next = HI_FLOATS(r2, r3);
    *a = AS_I(LO_PAIRS(low, low_next));
    *b = AS_I(HI_PAIRS(low, low_next));
    *c = AS_I(LO_PAIRS(high, high_next));
    *d = AS_I(HI_PAIRS(high, high_next));
#else
    *a = AS_I(GATHER(U, words, i, ));
    *b = AS_I(GATHER(U, words, i + 1, ));
    *c = AS_I(GATHER(U, words, i + 2, ));
    *d = AS_I(GATHER(U, words, i + 3, ));
#endif
}

#endif
