// Plastic with a smooth cover. The cover's reflection is a mirror's; the base scatters what the cover lets in and out.
#ifndef PLASTIC_H
#define PLASTIC_H
#include "material/bsdf.h"

#if HAS_PLASTIC
static inline I plastic_is(I kind) { return kind == MATERIAL_PLASTIC; }

typedef struct {
    F3 base;        // BSDF * pi, without the way out
    F  reflects;    // Fresnel reflectance on the side of the path
    F  mirror;      // probability of choosing the reflection
} Plastic;

static Plastic plastic_of(Vertex vertex, F cosine)
{
    Plastic plastic;
    F index = vertex.parameter;
    F internal = vertex.closure.internal;
    F ct;
    plastic.reflects = fresnel(cosine, index, &ct);
    F out = index * index * (1.0f - internal);      // share of even light that the cover lets through
    plastic.base = scale(lit_from_below(vertex.color, internal), (1.0f - plastic.reflects) / out);
    F diffuse = max3(plastic.base) * out;
    F both = plastic.reflects + diffuse;
    plastic.mirror = both > 0.0f ? plastic.reflects / both : ZERO;
    return plastic;
}

static inline F3 plastic_light(Vertex vertex, Plastic plastic, F cos_o)
{
    F ct;
    F leaves = 1.0f - fresnel(cos_o, vertex.parameter, &ct);
    return scale(plastic.base, leaves * INV_PI_F * cos_o);
}

static inline F3 plastic_eval(Vertex vertex, F3 d, Side side, F3 wo, F *pdf)
{
    F cos_o = dot3(side.n, wo);
    Plastic of = plastic_of(vertex, side.cosine);
    *pdf = cos_o > 0.0f ? (1.0f - of.mirror) * INV_PI_F * cos_o : ZERO;
    return keep3(cos_o > 0.0f, plastic_light(vertex, of, MAX(cos_o, ZERO)));
}

static Scattered plastic_sample(Vertex vertex, F3 d, Side side, F u, F v, F lobe)
{
    Plastic of = plastic_of(vertex, side.cosine);
    I coat = lobe < of.mirror;
    F weight = of.reflects / of.mirror;
    // The base: even light.
    F3 s, t;
    surface_frame(vertex, side.n, &s, &t);
    F3 wo = cosine_direction(u, v);
    F density = (1.0f - of.mirror) * INV_PI_F * wo.z;
    F3 base = keep3(wo.z > 0.0f, scale(plastic_light(vertex, of, wo.z), 1.0f / density));
    Scattered out;
    out.direction = select3(coat, mirrored_direction(d, side), from_frame(s, t, side.n, wo));
    out.weight = select3(coat, f3(weight, weight, weight), base);
    out.pdf = coat ? ZERO : density;
    return out;
}
#endif

#endif
