// Materials of GGX facets in the frame of the surface; what they do there is in material/facets.h.
#ifndef GLOSSY_H
#define GLOSSY_H
#include "material/bsdf.h"

#if HAS_GLOSSY
#include "material/facets.h"

#define AMONG(kind_name) | (kind == MATERIAL_##kind_name)

static inline I glossy_is(I kind)
{
    return FALSE WHEN(HAS_CONDUCTOR, AMONG(CONDUCTOR)) WHEN(HAS_METAL, AMONG(METAL))
        WHEN(HAS_ROUGH_DIELECTRIC, AMONG(ROUGH_DIELECTRIC)) WHEN(HAS_ROUGH_PLASTIC, AMONG(ROUGH_PLASTIC))
        WHEN(HAS_PRINCIPLED, AMONG(PRINCIPLED));
}

static Lobes glossy_lobes(Vertex vertex, F3 d, Side side)
{
    F3 s, t;
    surface_frame(vertex, side.n, &s, &t);
    F3 wi = scale(to_frame(s, t, side.n, d), -ONE);
    wi.z = side.cosine;
#if HAS_COAT_NORMAL
    vertex.coat_n = to_frame(s, t, side.n, side.coat);
#endif
    Lobes lobes = lobes_of(vertex, wi, side.behind);
    lobes.s = s;
    lobes.t = t;
    return lobes;
}

static inline F3 glossy_eval(Vertex vertex, F3 d, Side side, F3 wo, F *pdf)
{
    wo = to_frame(side.lobes.s, side.lobes.t, side.n, wo);
    return lobes_eval(vertex, side.lobes, wo, facet_normal(side.lobes, wo), pdf);
}

static Scattered glossy_sample(Vertex vertex, F3 d, Side side, F u, F v, F lobe)
{
    F3 wo;
    Scattered out;
    out.weight = facets_sample(vertex, side.lobes, u, v, lobe, &wo, &out.pdf);
    out.direction = select3(out.pdf > 0.0f, from_frame(side.lobes.s, side.lobes.t, side.n, wo), side.n);
    return out;
}
#endif

#endif
