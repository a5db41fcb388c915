// Smooth glass: reflects or refracts, by Fresnel's share.
#ifndef DIELECTRIC_H
#define DIELECTRIC_H
#include "material/bsdf.h"

#if HAS_DIELECTRIC
static inline I dielectric_is(I kind) { return kind == MATERIAL_DIELECTRIC; }

static Scattered dielectric_sample(Vertex vertex, F3 d, Side side, F u, F v, F lobe)
{
    F index = vertex.parameter;
    F eta = side.behind ? ONE / index : index;
    F ci = side.cosine;
    F ct;
    F reflectance = fresnel(ci, eta, &ct);
    I reflects = lobe < reflectance;
    F inverse = ONE / eta;
    F3 reflected = along(d, side.n, 2.0f * ci);
    F3 refracted = along(scale(d, inverse), side.n, inverse * ci - ct);
    F squeeze = reflects ? ONE : inverse * inverse;       // radiance over n^2 is what refraction conserves
    Scattered out;
    out.direction = normalized(select3(reflects, reflected, refracted));
#if HAS_GLASS_TINT
    out.weight = scale(select3(reflects, vertex.color, vertex.closure.passed), squeeze);
#else
    out.weight = f3(squeeze, squeeze, squeeze);
#endif
    out.pdf = ZERO;
#if LAMPS_BEHIND_GLASS
    out.left = rest_of(lobe, reflectance, NOT(reflects), reflects ? reflectance : 1.0f - reflectance);
#endif
    return out;
}
#endif

#endif
