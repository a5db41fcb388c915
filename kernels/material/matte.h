// Even scattering (Lambert), and that of rough matte surfaces (Oren and Nayar 1994, their qualitative model).
#ifndef MATTE_H
#define MATTE_H
#include "material/bsdf.h"

#if HAS_MATTE
static inline I matte_is(I kind) { return kind == MATERIAL_MATTE; }

#if HAS_OREN_NAYAR
// Over an even surface, of cosines to the normal `cos_i` and `cos_o`; vertex.parameter is the variance of the slopes.
static inline F rough_matte(Vertex vertex, F cos_i, F cos_o, F cos_between)
{
    F variance = vertex.parameter;
    F a = 1.0f - 0.5f * variance / (variance + 0.33f);
    F b = 0.45f * variance / (variance + 0.09f);
    F sines = MAX(cos_between - cos_i * cos_o, ZERO);       // of both angles, times the cosine between their planes
    return a + b * sines / MAX(MAX(cos_i, cos_o), (F)(1e-6f));
}
#endif

static inline F3 matte_eval(Vertex vertex, F3 d, Side side, F3 wo, F *pdf)
{
    F cos_o = dot3(side.n, wo);
    *pdf = cos_o > 0.0f ? cos_o * INV_PI_F : ZERO;
#if HAS_OREN_NAYAR
    return scale(vertex.color, *pdf * rough_matte(vertex, side.cosine, cos_o, -dot3(d, wo)));
#else
    return scale(vertex.color, *pdf);
#endif
}

static inline Scattered matte_sample(Vertex vertex, F3 d, Side side, F u, F v, F lobe)
{
    F3 s, t;
    surface_frame(vertex, side.n, &s, &t);
    F3 wo = cosine_direction(u, v);
    Scattered out;
    out.direction = from_frame(s, t, side.n, wo);
    out.weight = keep3(wo.z > 0.0f, vertex.color);
#if HAS_OREN_NAYAR
    out.weight = scale(out.weight, rough_matte(vertex, side.cosine, wo.z, -dot3(d, out.direction)));
#endif
    out.pdf = wo.z * INV_PI_F;
    return out;
}
#endif

#endif
