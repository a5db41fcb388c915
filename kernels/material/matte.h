// Even scattering (Lambert).
#ifndef MATTE_H
#define MATTE_H
#include "material/bsdf.h"

#if HAS_MATTE
static inline I matte_is(I kind) { return kind == MATERIAL_MATTE; }

static inline F3 matte_eval(Vertex vertex, F3 d, Side side, F3 wo, F *pdf)
{
    F cos_o = dot3(side.n, wo);
    *pdf = cos_o > 0.0f ? cos_o * INV_PI_F : ZERO;
    return scale(vertex.color, *pdf);
}

static inline Scattered matte_sample(Vertex vertex, F3 d, Side side, F u, F v, F lobe)
{
    F3 s, t;
    surface_frame(vertex, side.n, &s, &t);
    F3 wo = cosine_direction(u, v);
    Scattered out;
    out.direction = from_frame(s, t, side.n, wo);
    out.weight = keep3(wo.z > 0.0f, vertex.color);
    out.pdf = wo.z * INV_PI_F;
    return out;
}
#endif

#endif
