// What fills a solid or the space around all: media that absorb, scatter (Henyey and Greenstein 1941) and glow, homogeneous
// but for the fall of their density with height (integrator/column.h).
// A path carries the media that it is in as a stack in one integer, five bits each, the innermost lowest, above them one bit
// that marks the bottom: entering a solid puts the medium of its inside on top, leaving it takes that away again.
// Facts: HAS_MEDIA, HAS_LAYERED_FOG, HAS_BOUNDARY (surfaces of nothing but a medium behind them).
#ifndef MEDIUM_H
#define MEDIUM_H
#include "common/exponential.h"
#include "material/bsdf.h"

#define MEDIUM_BITS     5
#define MEDIUM_MASK     31
#define ONE_MEDIUM      (1 << (2 * MEDIUM_BITS))        // a stack below it has a bottom alone
#define FULL_OF_MEDIA   (1 << (5 * MEDIUM_BITS))        // one from it on takes no more

#define FARTHEST        1e18f   // where a way ends that meets nothing [m]

// Coefficients [1/m], emitted radiance per metre; of a layer what heights above its base follow from, in scale heights.
typedef struct {
    F3 extinction, scattering, glow;
#if HAS_LAYERED_FOG
    F3 rise;
    F  base;
#endif
} Inside;

static inline I has_extinction(Inside m) { return max3(m.extinction) > 0.0f; }

// The medium on top of the stacks of the lanes `on`; nothing for others. Lanes are taken medium by medium.
static Inside inside_of(I stack, I on, Scene scene)
{
    Inside all;
    all.extinction = all.scattering = all.glow = f3(ZERO, ZERO, ZERO);
#if HAS_LAYERED_FOG
    all.rise = f3(ZERO, ZERO, ZERO);
    all.base = ZERO;
#endif
    I number = stack & MEDIUM_MASK;
    I rest = on & (number != 0);
    while (ANY(rest)) {
        int index = first_of(number, rest);
        I mine = rest & (number == index);
        const __global Medium *medium = scene.media + index;
        F3 scattering = coefficient(medium->scattering, scene);
        F3 glow = f3_of(medium->emission);
#if SPECTRAL_COLOURS
        glow = light_colour(scene.spectral, glow, medium->emission.w, scene.colours);
#endif
        all.scattering = select3(mine, scattering, all.scattering);
        all.extinction = select3(mine, add(scattering, coefficient(medium->absorption, scene)), all.extinction);
        all.glow = select3(mine, glow, all.glow);
#if HAS_LAYERED_FOG
        all.rise = select3(mine, f3_of(medium->layer), all.rise);
        all.base = mine ? (F)(medium->layer.w) : all.base;
#endif
        rest = rest & NOT(mine);
    }
    return all;
}

static inline F3 transmittance_of(F3 extinction, F length)
{
    return f3(exponential(-extinction.x * length), exponential(-extinction.y * length), exponential(-extinction.z * length));
}

// (1 - exp(-x)) / x
static inline F mean_transmittance(F x)
{
    return x < 1e-2f ? 1.0f - x * (0.5f - x * 0.166666667f) : (1.0f - exponential(-x)) / MAX(x, (F)(1e-2f));
}

// The stack of a path along `from` that goes on along `to` from a primitive whose outward normal there is `ng`.
static I stack_beyond(I stack, I primitive, F3 ng, F3 from, F3 to, Scene scene)
{
    F ahead = dot3(ng, to);
    I crosses = (primitive >= 0) & (dot3(ng, from) * ahead > 0.0f);
    if (!ANY(crosses))
        return stack;
    I material = GATHER(I, scene.primitives, (crosses ? primitive : FALSE), .material);
    I inside = GATHER(I, scene.materials, material, .interior);
    crosses = crosses & (inside >= 0);
    I enters = crosses & (ahead < 0.0f) & (stack < FULL_OF_MEDIA);
    I leaves = crosses & (ahead > 0.0f) & (stack >= ONE_MEDIUM);
    return enters ? (stack << MEDIUM_BITS) | inside : (leaves ? stack >> MEDIUM_BITS : stack);
}

// How a medium scatters, as a BSDF of a vertex of this kind; vertex.parameter is the mean cosine.
#define MATERIAL_PHASE 64

static inline I phase_is(I kind) { return kind == MATERIAL_PHASE; }

static inline F henyey_greenstein(F g, F cosine)
{
    F squared = MAX(1.0f + g * g - 2.0f * g * cosine, (F)(1e-9f));
    return 0.25f * INV_PI_F * (1.0f - g * g) / (squared * sqrt(squared));
}

static inline F3 phase_eval(Vertex vertex, F3 d, Side side, F3 wo, F *pdf)
{
    *pdf = henyey_greenstein(vertex.parameter, dot3(d, wo));
    return scale(vertex.color, *pdf);
}

static inline Scattered phase_sample(Vertex vertex, F3 d, Side side, F u, F v, F lobe)
{
    F g = vertex.parameter;
    F s = (1.0f - g * g) / (1.0f - g + 2.0f * g * v);
    F cosine = absolute(g) < 1e-3f ? 1.0f - 2.0f * v : (1.0f + g * g - s * s) / (2.0f * g);
    cosine = MIN(MAX(cosine, (F)(-1.0f)), ONE);
    F sn, cs;
    sincos_turns(u, &sn, &cs);
    F sine = root(1.0f - cosine * cosine);
    F3 x, y;
    frame(d, &x, &y);
    Scattered out;
    out.direction = from_frame(x, y, d, f3(sine * cs, sine * sn, cosine));
    out.weight = vertex.color;
    out.pdf = henyey_greenstein(g, cosine);
    return out;
}

// Makes vertices of paths in the medium of the lanes `on`, which have no surface.
static void take_phase(Vertex *vertex, I on, I stack, F3 d, Scene scene)
{
    F3 against = scale(d, -ONE);
    vertex->n = select3(on, against, vertex->n);
    vertex->ng = select3(on, against, vertex->ng);
    vertex->color = select3(on, f3(ONE, ONE, ONE), vertex->color);
    vertex->parameter = on ? GATHER(F, scene.media, stack & MEDIUM_MASK, .asymmetry) : vertex->parameter;
    vertex->kind = on ? (I)(MATERIAL_PHASE) : vertex->kind;
}

#endif
