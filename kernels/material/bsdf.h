// What the BSDFs share. Each is a file of three functions, under masks of lanes: `d` is the direction of the arriving path,
// towards the surface, `side` the side that it sees, `wo` the direction on.
//   I NAME_is(I kind)                          lanes whose material it is
//   F3 NAME_eval(vertex, d, side, wo, *pdf)    BSDF times cosine, and the density with which NAME_sample chooses `wo`
//   Scattered NAME_sample(vertex, d, side, u, v, lobe)      a direction by three random numbers
// One whose directions have no density (mirrors, smooth glass) has no NAME_eval; its samples have the density 0.
#ifndef BSDF_H
#define BSDF_H
#include "material/fresnel.h"
#include "material/side.h"

typedef struct {
    F3 direction;
    F3 weight;   // BSDF * cosine / density
    F  pdf;      // solid-angle density; 0 where light sampling cannot compete
#if LAMPS_BEHIND_GLASS
    F  left;     // of `lobe` where smooth glass has chosen by it: as good as a random number of its own
#endif
} Scattered;

// A direction about (0, 0, 1) of density z / pi.
static inline F3 cosine_direction(F u, F v)
{
    F sn, cs;
    sincos_turns(u, &sn, &cs);
    F r = sqrt(v);
    F z = root(1.0f - v);
    return f3(r * cs, r * sn, z);
}

#if HAS_SHEEN
// A direction about (0, 0, 1) of density 1 / (2 pi).
static inline F3 even_direction(F u, F v)
{
    F sn, cs;
    sincos_turns(u, &sn, &cs);
    F r = root(1.0f - v * v);
    return f3(r * cs, r * sn, v);
}
#endif

// The frame about the normal: x along the tangent where a material is brushed.
static inline void surface_frame(Vertex vertex, F3 n, F3 *s, F3 *t)
{
    frame(n, s, t);
#if HAS_ANISOTROPY
    F3 flat = along(vertex.tangent, n, -dot3(vertex.tangent, n));
    F length2 = dot3(flat, flat);
    *s = select3(length2 > 0.0f, scale(flat, 1.0f / sqrt(MAX(length2, (F)(SMALLEST)))), *s);
    *t = cross3(n, *s);
#endif
}

// The direction of a path after a mirror.
static inline F3 mirrored_direction(F3 d, Side side) { return normalized(along(d, side.n, 2.0f * side.cosine)); }

#endif
