// The side of a surface from which a path sees it, and the shading normal there.
#ifndef SIDE_H
#define SIDE_H
#include "material/vertex.h"

#if HAS_GLOSSY
// Of facets (material/facets.h), what is the same for every direction on; in the frame of s, t and the normal.
typedef struct {
    F3    s, t, wi;
    F     eta;              // index beyond the surface over the index before it
    I     clear;            // lanes that refract
#if HAS_AGAIN
    I     behind;           // lanes that come from inside
    F3    again, stain;     // of glass, where facets scatter once by what they scatter again, and the colour of that
    F     glass_again;      // share of the light from `wi` that meets further facets of glass
    F     sharp_glass;      // how much of it goes where they scatter once
    F     wide;             // probability of choosing any direction instead, for the rest of it,
    F     back;             // and of choosing it on this side
    F3    wide_back, wide_through;  // that rest, over the mean of even light on this side and on the other
#endif
#if HAS_COVERED_BASE
    F3    base;             // diffuse reflectance that the way in leaves
#endif
#if HAS_METAL_AGAIN
    F3    from;             // of metal, the share of the light from `wi` that meets several facets, over the mean of even light;
    F3    to, to_rise;      // what the last one leaves of it, head on, and how much more along the surface
    F     once;             // share of the light from `wi` that meets no further facet
    F     sharp;            // how much of what meets further ones goes where facets reflect once
#endif
#if HAS_BASE
    F     under;            // probability of choosing these
#endif
#if HAS_SHEEN
    F3    fibres;           // colour of the sheen
    F     sent;             // share of the light from `wi` that it sends back
    F     sent_mean;        // and of even light
    F     sheen;            // probability of choosing it
#endif
#if HAS_CLEARCOAT
    Alpha coat_alpha;
    F     bare;             // share of the light from `wi` that the coat lets pass
    F     bare_mean;        // and of even light
    F     coat;             // probability of choosing the coat, if not the base
#endif
#if HAS_COAT_NORMAL
    F3    coat_s, coat_t, coat_n;   // frame of the coat
#endif
} Lobes;
#endif

typedef struct {
    F3 n;           // shading normal on the side of the path
    F  cosine;      // of the path to it, >= 0
    I  behind;      // the path comes from the back
#if HAS_COAT_NORMAL
    F3 coat;        // normal of the clear coat, likewise
#endif
#if HAS_GLOSSY
    Lobes lobes;    // of the lanes with facets
#endif
} Side;

#if HAS_SHADING_NORMAL
#define GRAZING 1e-3f       // least cosine of a path to the shading normal, and of its mirror image to the true one

// A shading normal on the side of the path as the path sees it, and the cosine to it; `out` is the true one on that side.
static F3 facing_normal(F3 n, F3 out, F3 d, I shiny, F *cosine)
{
    *cosine = -dot3(n, d);
    // A shading normal that turns its back on the path is bent until it just faces it: no black fringes.
    I away = *cosine < GRAZING;
    if (ANY(away)) {
        F3 bent = normalized(along(n, d, *cosine - GRAZING));
        n = select3(away, bent, n);
        *cosine = away ? MAX(-dot3(n, d), ZERO) : *cosine;
    }
    // One whose mirror direction is below the surface is bent until that just leaves it: no black rims of shiny meshes.
    F3 mirrored = along(d, n, 2.0f * *cosine);
    F rise = dot3(mirrored, out);
    I sunk = (rise < GRAZING) & shiny;
    if (ANY(sunk)) {
        F3 bent = normalized(sub(normalized(along(mirrored, out, GRAZING - rise)), d));
        n = select3(sunk, bent, n);
        *cosine = sunk ? MAX(-dot3(n, d), ZERO) : *cosine;
    }
    return n;
}

static Side side_of(Vertex vertex, F3 d)
{
    Side side;
    F front = -dot3(vertex.ng, d);
    side.behind = front < 0.0f;
    F sign = with_sign(ONE, front);
    F3 out = scale(vertex.ng, sign);
    side.n = facing_normal(scale(vertex.n, sign), out, d, (vertex.kind != MATERIAL_MATTE) & (vertex.kind != MATERIAL_TRANSLUCENT),
                          &side.cosine);
#if HAS_COAT_NORMAL
    F unused;
    side.coat = facing_normal(scale(vertex.coat_n, sign), out, d, TRUE, &unused);
#endif
    return side;
}

// Whether `wo` leaves on the same side of the surface itself as of its shading normal: light that would have to pass
// through the surface to agree with both is left out, when evaluating as when sampling.
static inline I consistent(Vertex vertex, Side side, F3 wo)
{
    F true_side = dot3(vertex.ng, wo);
    true_side = side.behind ? -true_side : true_side;
    I agrees = (true_side > 0.0f) == (dot3(side.n, wo) > 0.0f);
#if HAS_COAT_NORMAL
    // An opaque surface sends nothing but the light of its coat where only the coat's normal agrees.
    I coated = (vertex.kind == MATERIAL_PRINCIPLED) & (vertex.closure.coat > 0.0f);
#if HAS_TRANSMISSION
    coated = coated & (vertex.closure.transmission == 0.0f);
#endif
    agrees = agrees | (coated & (true_side > 0.0f) & (dot3(side.coat, wo) > 0.0f));
#endif
    return agrees;
}
#else
static inline Side side_of(Vertex vertex, F3 d)
{
    Side side;
    F front = -dot3(vertex.n, d);
    side.behind = front < 0.0f;
    side.n = scale(vertex.n, with_sign(ONE, front));
    side.cosine = absolute(front);
    return side;
}
#endif

#endif
