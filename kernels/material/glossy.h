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

static inline F3 glossy_eval(Vertex vertex, F3 d, Side side, F3 wo, F *pdf)
{
    F3 s, t;
    surface_frame(vertex, side.n, &s, &t);
    F3 wi = scale(to_frame(s, t, side.n, d), -ONE);
    wi.z = side.cosine;
#if HAS_COAT_NORMAL
    vertex.coat_n = to_frame(s, t, side.n, side.coat);
#endif
    return facets_eval(vertex, wi, to_frame(s, t, side.n, wo), side.behind, pdf);
}

static Scattered glossy_sample(Vertex vertex, F3 d, Side side, F u, F v, F lobe)
{
    F3 s, t;
    surface_frame(vertex, side.n, &s, &t);
    F3 wi = scale(to_frame(s, t, side.n, d), -ONE);
    wi.z = side.cosine;
#if HAS_COAT_NORMAL
    vertex.coat_n = to_frame(s, t, side.n, side.coat);
#endif
    F3 wo;
    Scattered out;
    out.weight = facets_sample(vertex, wi, side.behind, u, v, lobe, &wo, &out.pdf);
    out.direction = select3(out.pdf > 0.0f, from_frame(s, t, side.n, wo), side.n);
    return out;
}
#endif

#endif
