// The BSDFs behind one interface: each evaluates the lanes that are its own. Those that the scene lacks are not compiled.
#ifndef SCATTER_H
#define SCATTER_H
#include "material/dielectric.h"
#include "material/glossy.h"
#include "material/hair.h"
#include "material/matte.h"
#if HAS_MEDIA
#include "material/medium.h"
#endif
#include "material/measured.h"
#include "material/mirror.h"
#include "material/plastic.h"
#include "material/thin_glass.h"
#include "material/translucent.h"

// One row for each BSDF: SPREAD(name) where its directions have a density, SPECULAR(name) where they do not, BOTH(name) where
// some have.
#define BSDFS(SPREAD, BOTH, SPECULAR) \
    WHEN(HAS_MATTE,      SPREAD(matte)) \
    WHEN(HAS_TRANSLUCENT, SPREAD(translucent)) \
    WHEN(HAS_PLASTIC,    BOTH(plastic)) \
    WHEN(HAS_MEASURED,   SPREAD(measured)) \
    WHEN(HAS_GLOSSY,     SPREAD(glossy)) \
    WHEN(HAS_HAIR,       SPREAD(hair)) \
    WHEN(HAS_MIRROR,     SPECULAR(mirror)) \
    WHEN(HAS_DIELECTRIC, SPECULAR(dielectric)) \
    WHEN(HAS_THIN_GLASS, SPECULAR(thin_glass)) \
    WHEN(HAS_MEDIA,      SPREAD(phase))

// A medium has no surface to be on the wrong side of, and fibres scatter to all sides.
#if HAS_MEDIA
#define PHASES_AGREE | phase_is(vertex.kind)
#else
#define PHASES_AGREE
#endif
#if HAS_HAIR
#define FIBRES_AGREE | hair_is(vertex.kind)
#else
#define FIBRES_AGREE
#endif

#define NOTHING_TO_EVAL(name)
#define EVAL(name) \
    { \
        I mine = name##_is(vertex.kind); \
        if (ANY(mine)) { \
            F density; \
            F3 bsdf = name##_eval(vertex, d, side, wo, &density); \
            value = select3(mine, bsdf, value); \
            *pdf = mine ? density : *pdf; \
        } \
    }

// What a path along `d` sees of a vertex, with what its facets make of it: the same for all directions on.
static Side side_seen(Vertex vertex, F3 d)
{
    Side side = side_of(vertex, d);
#if HAS_GLOSSY && !defined(SPECULAR_ALONE)
    if (ANY(glossy_is(vertex.kind)))
        side.lobes = glossy_lobes(vertex, d, side);
#endif
    return side;
}

// BSDF * cosine, and the density with which scatter_sample would choose `wo`.
static inline F3 scatter_eval(Vertex vertex, F3 d, Side side, F3 wo, F *pdf)
{
    F3 value = f3(ZERO, ZERO, ZERO);
    *pdf = ZERO;
    BSDFS(EVAL, EVAL, NOTHING_TO_EVAL)
#if HAS_SHADING_NORMAL
    I agrees = consistent(vertex, side, wo) PHASES_AGREE FIBRES_AGREE;
    value = keep3(agrees, value);
    *pdf = agrees ? *pdf : ZERO;
#endif
    return value;
}

#define KEEP_LEFT
#define SAMPLE(name) \
    { \
        I mine = name##_is(vertex.kind); \
        if (ANY(mine)) { \
            Scattered own = name##_sample(vertex, d, side, u, v, lobe); \
            out.direction = select3(mine, own.direction, out.direction); \
            out.weight = select3(mine, own.weight, out.weight); \
            out.pdf = mine ? own.pdf : out.pdf; \
            KEEP_LEFT \
        } \
    }

#ifdef SPECULAR_ALONE    // photons go on by mirrors and smooth glass alone, so that all else need not be compiled
#define SAMPLE_SPREAD(name) out.weight = keep3(NOT(name##_is(vertex.kind)), out.weight);
#else
#define SAMPLE_SPREAD SAMPLE
#endif

// A direction on, by three random numbers: two for the direction, one for the lobe.
static Scattered scatter_sample(Vertex vertex, F3 d, Side side, F u, F v, F lobe)
{
#if HAS_MIX
    lobe = vertex.lobe;
#endif
    Scattered out;
    out.direction = side.n;
    out.weight = vertex.color;
    out.pdf = ZERO;
    BSDFS(SAMPLE_SPREAD, SAMPLE, SAMPLE)
#if HAS_SHADING_NORMAL
    I agrees = consistent(vertex, side, out.direction) PHASES_AGREE FIBRES_AGREE;
    out.weight = keep3(agrees, out.weight);
#endif
    return out;
}

#if LAMPS_BEHIND_GLASS
// Smooth glass, through which light samples follow the ray to a lamp.
static inline I is_clear(Vertex vertex)
{
    return (vertex.kind == MATERIAL_DIELECTRIC) | (vertex.kind == MATERIAL_THIN_GLASS);
}

#undef KEEP_LEFT
#define KEEP_LEFT out.left = mine ? own.left : out.left;

// A direction on from smooth glass, as scatter_sample has it; weight 0 where the surface is of something else.
static Scattered clear_sample(Vertex vertex, F3 d, F lobe)
{
    Side side = side_of(vertex, d);
    F u = ZERO, v = ZERO;
    Scattered out;
    out.direction = d;
    out.weight = f3(ZERO, ZERO, ZERO);
    out.pdf = ZERO;
    out.left = lobe;
    WHEN(HAS_DIELECTRIC, SAMPLE(dielectric))
    WHEN(HAS_THIN_GLASS, SAMPLE(thin_glass))
#if HAS_SHADING_NORMAL
    out.weight = keep3(consistent(vertex, side, out.direction), out.weight);
#endif
    return out;
}
#endif

#endif
