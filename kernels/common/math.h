// Three-vectors of lanes and the few functions the renderer needs, from + - * / sqrt alone, so that results do not
// depend on a device's maths library.
#ifndef MATH_H
#define MATH_H
#include "common/width.h"

#define PI_F      3.14159265358979f
#define INV_PI_F  0.318309886183791f

typedef struct { F x, y, z; } F3;

static inline F3 f3(F x, F y, F z)           { F3 r; r.x = x; r.y = y; r.z = z; return r; }
static inline F3 f3_of(float4 v)             { return f3((F)(v.x), (F)(v.y), (F)(v.z)); }
static inline F3 add(F3 a, F3 b)             { return f3(a.x + b.x, a.y + b.y, a.z + b.z); }
static inline F3 sub(F3 a, F3 b)             { return f3(a.x - b.x, a.y - b.y, a.z - b.z); }
static inline F3 mul(F3 a, F3 b)             { return f3(a.x * b.x, a.y * b.y, a.z * b.z); }
static inline F3 scale(F3 a, F s)            { return f3(a.x * s, a.y * s, a.z * s); }
static inline F3 along(F3 o, F3 d, F t)      { return f3(o.x + t * d.x, o.y + t * d.y, o.z + t * d.z); }
static inline F  dot3(F3 a, F3 b)            { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline F3 select3(I m, F3 a, F3 b)    { return f3(m ? a.x : b.x, m ? a.y : b.y, m ? a.z : b.z); }
static inline F3 keep3(I m, F3 a)            { return select3(m, a, f3(ZERO, ZERO, ZERO)); }
static inline F  max3(F3 a)                  { F m = MAX(a.x, a.y); return MAX(m, a.z); }
static inline F  root(F x)                   { return sqrt(MAX(x, ZERO)); }
static inline F  absolute(F x)               { return AS_F(AS_I(x) & ~SIGN_BIT); }
static inline F  with_sign(F x, F s)         { return AS_F((AS_I(x) & ~SIGN_BIT) | (AS_I(s) & SIGN_BIT)); }
static inline F3 normalized(F3 a)            { return scale(a, ONE / sqrt(dot3(a, a))); }
static inline F3 cross3(F3 a, F3 b)
{
    return f3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

// Integer test: survives compilers that assume finite numbers.
static inline I not_finite(F x)              { return (AS_I(x) & ~SIGN_BIT) >= INFINITE; }

// sin and cos of 2 pi u for u in [0, 1]: quarter turns by rounding, then Taylor polynomials on +-pi/4 (error < 4e-7).
static void sincos_turns(F u, F *sine, F *cosine)
{
    F quarters = u * 4.0f;
    I q = TO_I(quarters + 0.5f);
    F a = (quarters - TO_F(q)) * 1.57079632679f;
    F s = a * a;
    F sn = a + a * s * (-1.66666667e-1f + s * (8.33333333e-3f + s * (-1.98412698e-4f + s * 2.75573e-6f)));
    F cs = 1.0f + s * (-0.5f + s * (4.16666667e-2f + s * (-1.38888889e-3f + s * 2.48015873e-5f)));
    I swap = (q & 1) != 0;
    F x = swap ? sn : cs;
    F y = swap ? cs : sn;
    *cosine = ((q + 1) & 2) != 0 ? -x : x;
    *sine = (q & 2) != 0 ? -y : y;
}

// What is left of a random number u that has chosen one of two sides, the first with probability `share`, that taken with `taken`.
static inline F rest_of(F u, F share, I second, F taken)
{
    return MIN((second ? u - share : u) / taken, (F)(0.99999994f));
}

// A right-handed frame with z = n: Duff et al. 2017, «Building an orthonormal basis, revisited».
static inline void frame(F3 n, F3 *s, F3 *t)
{
    F sign = with_sign(ONE, n.z);
    F a = -1.0f / (sign + n.z);
    F b = n.x * n.y * a;
    *s = f3(1.0f + sign * n.x * n.x * a, sign * b, -sign * n.x);
    *t = f3(b, sign + n.y * n.y * a, -n.y);
}

static inline F3 from_frame(F3 s, F3 t, F3 n, F3 v)
{
    return f3(s.x * v.x + t.x * v.y + n.x * v.z, s.y * v.x + t.y * v.y + n.y * v.z, s.z * v.x + t.z * v.y + n.z * v.z);
}

static inline F3 to_frame(F3 s, F3 t, F3 n, F3 v) { return f3(dot3(s, v), dot3(t, v), dot3(n, v)); }

// An affine map held as three rows: points take the translation, vectors do not.
static inline F  row_point(float4 r, F3 p)   { return r.x * p.x + r.y * p.y + r.z * p.z + r.w; }
static inline F  row_vector(float4 r, F3 d)  { return r.x * d.x + r.y * d.y + r.z * d.z; }

#endif
