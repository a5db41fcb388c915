// The BSDFs behind one interface, evaluated under masks; materials that the scene lacks are not compiled.
// `d` is the direction of the arriving camera path (towards the surface), `wo` the direction on.
#ifndef SCATTER_H
#define SCATTER_H
#include "material/vertex.h"
#if HAS_CONDUCTOR
#include "material/ggx.h"
#endif
#if HAS_DIELECTRIC
#include "material/fresnel.h"
#endif

typedef struct {
    F3 direction;
    F3 weight;   // BSDF * cosine / density
    F  pdf;      // solid-angle density; 0 where light sampling cannot compete (mirror, smooth glass)
} Scattered;

// BSDF * cosine, and the density with which scatter_sample would choose `wo`.
static F3 scatter_eval(Vertex vertex, F3 d, F3 wo, F *pdf)
{
    F3 n = vertex.n;
    F cos_i = -dot3(n, d);
    F cos_o = with_sign(ONE, cos_i) * dot3(n, wo);
    F value = ZERO;
    *pdf = ZERO;
#if HAS_MATTE
    I matte = (vertex.kind == MATERIAL_MATTE) & (cos_o > 0.0f);
    value = matte ? cos_o * INV_PI_F : value;
    *pdf = matte ? cos_o * INV_PI_F : *pdf;
#endif
#if HAS_CONDUCTOR
    I metal = vertex.kind == MATERIAL_CONDUCTOR;
    if (ANY(metal)) {
        F3 facing = scale(n, with_sign(ONE, cos_i));
        F3 s, t;
        frame(facing, &s, &t);
        F3 wi = scale(to_frame(s, t, facing, d), -ONE);
        F density;
        F bsdf = ggx_eval(wi, to_frame(s, t, facing, wo), vertex.parameter, &density);
        value = metal ? bsdf : value;
        *pdf = metal ? density : *pdf;
    }
#endif
    return scale(vertex.color, value);
}

static Scattered scatter_sample(Vertex vertex, F3 d, F u, F v, F lobe)
{
    F3 n = vertex.n;
    F cos_i = -dot3(n, d);
    F3 facing = scale(n, with_sign(ONE, cos_i));
    Scattered out;
    out.direction = facing;
    out.weight = vertex.color;
    out.pdf = ZERO;
#if HAS_MATTE || HAS_CONDUCTOR
    F3 s, t;
    frame(facing, &s, &t);
#endif
#if HAS_MATTE
    I matte = vertex.kind == MATERIAL_MATTE;
    if (ANY(matte)) {
        F sn, cs;
        sincos_turns(u, &sn, &cs);
        F r = sqrt(v);
        F z = root(1.0f - v);
        F3 wo = from_frame(s, t, facing, f3(r * cs, r * sn, z));
        out.direction = select3(matte, wo, out.direction);
        out.weight = select3(matte & (z <= 0.0f), f3(ZERO, ZERO, ZERO), out.weight);
        out.pdf = matte ? z * INV_PI_F : out.pdf;
    }
#endif
#if HAS_MIRROR
    I mirror = vertex.kind == MATERIAL_MIRROR;
    if (ANY(mirror))
        out.direction = select3(mirror, normalized(along(d, n, 2.0f * cos_i)), out.direction);
#endif
#if HAS_CONDUCTOR
    I metal = vertex.kind == MATERIAL_CONDUCTOR;
    if (ANY(metal)) {
        F alpha = vertex.parameter;
        F3 wi = scale(to_frame(s, t, facing, d), -ONE);
        F3 h = ggx_visible_normal(wi, alpha, u, v);
        F3 wo = sub(scale(h, 2.0f * dot3(wi, h)), wi);
        F density;
        F value = ggx_eval(wi, wo, alpha, &density);
        I good = metal & (density > 0.0f);
        out.direction = select3(good, from_frame(s, t, facing, wo), out.direction);
        out.weight = select3(metal, scale(vertex.color, good ? value / density : ZERO), out.weight);
        out.pdf = good ? density : out.pdf;
    }
#endif
#if HAS_DIELECTRIC
    I glass = vertex.kind == MATERIAL_DIELECTRIC;
    if (ANY(glass)) {
        F index = vertex.parameter;
        F eta = cos_i > 0.0f ? index : ONE / index;
        F ci = absolute(cos_i);
        F ct;
        F reflectance = fresnel(ci, eta, &ct);
        I reflects = lobe < reflectance;
        F inverse = ONE / eta;
        F3 reflected = along(d, facing, 2.0f * ci);
        F3 refracted = along(scale(d, inverse), facing, inverse * ci - ct);
        out.direction = select3(glass, normalized(select3(reflects, reflected, refracted)), out.direction);
        F squeeze = reflects ? ONE : inverse * inverse;       // radiance over n^2 is what refraction conserves
        out.weight = select3(glass, f3(squeeze, squeeze, squeeze), out.weight);
    }
#endif
    return out;
}

#endif
