// Plastic with a smooth cover. The cover's reflection is a mirror's; the base scatters what the cover lets in and out.
#ifndef PLASTIC_H
#define PLASTIC_H
#include "material/fresnel.h"
#include "material/vertex.h"

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

static F3 plastic_light(Vertex vertex, Plastic plastic, F cos_o)
{
    F ct;
    F leaves = 1.0f - fresnel(cos_o, vertex.parameter, &ct);
    return scale(plastic.base, leaves * INV_PI_F * cos_o);
}

#endif
