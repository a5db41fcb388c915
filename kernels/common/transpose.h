// Eight neighbouring floats in memory per lane: written and read whole, turned by shuffles instead of lane by lane.
#ifndef TRANSPOSE_H
#define TRANSPOSE_H
#include "common/width.h"

typedef struct { F f[8]; } Eight;

#if VW == 1
static Eight load_eight(const __global float *p, I offset)
{
    float8 v = vload8(0, p + offset);
    Eight e;
    e.f[0] = v.s0; e.f[1] = v.s1; e.f[2] = v.s2; e.f[3] = v.s3;
    e.f[4] = v.s4; e.f[5] = v.s5; e.f[6] = v.s6; e.f[7] = v.s7;
    return e;
}

static void store_eight(__global float *p, uint first, Eight e)
{
    vstore8((float8)(e.f[0], e.f[1], e.f[2], e.f[3], e.f[4], e.f[5], e.f[6], e.f[7]), first, p);
}
#else
#define PAIR_LO(a, b) ((float8)((a).s0, (b).s0, (a).s1, (b).s1, (a).s4, (b).s4, (a).s5, (b).s5))
#define PAIR_HI(a, b) ((float8)((a).s2, (b).s2, (a).s3, (b).s3, (a).s6, (b).s6, (a).s7, (b).s7))
#define QUAD_LO(a, b) ((float8)((a).s0, (a).s1, (b).s0, (b).s1, (a).s4, (a).s5, (b).s4, (b).s5))
#define QUAD_HI(a, b) ((float8)((a).s2, (a).s3, (b).s2, (b).s3, (a).s6, (a).s7, (b).s6, (b).s7))

static void transpose8(float8 *r)
{
    float8 a = PAIR_LO(r[0], r[1]), b = PAIR_HI(r[0], r[1]), c = PAIR_LO(r[2], r[3]), d = PAIR_HI(r[2], r[3]);
    float8 e = PAIR_LO(r[4], r[5]), f = PAIR_HI(r[4], r[5]), g = PAIR_LO(r[6], r[7]), h = PAIR_HI(r[6], r[7]);
    float8 p = QUAD_LO(a, c), q = QUAD_HI(a, c), s = QUAD_LO(b, d), t = QUAD_HI(b, d);
    float8 u = QUAD_LO(e, g), v = QUAD_HI(e, g), w = QUAD_LO(f, h), x = QUAD_HI(f, h);
    r[0] = (float8)(p.lo, u.lo); r[1] = (float8)(q.lo, v.lo); r[2] = (float8)(s.lo, w.lo); r[3] = (float8)(t.lo, x.lo);
    r[4] = (float8)(p.hi, u.hi); r[5] = (float8)(q.hi, v.hi); r[6] = (float8)(s.hi, w.hi); r[7] = (float8)(t.hi, x.hi);
}

static void load_rows(const __global float *p, int8 i, float8 *r)
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

#endif
