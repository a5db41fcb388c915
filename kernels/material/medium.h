// What fills a solid or the space around all: media that absorb, scatter (Henyey and Greenstein 1941) and glow, homogeneous
// but for the fall of their density with height (integrator/column.h).
// A path carries the media that it is in as a stack in one integer, five bits each, the innermost lowest, above them one bit
// that marks the bottom: entering a solid puts the medium of its inside on top, leaving it takes the uppermost like it away.
// Where the colour of a medium is a texture, that of the place where a path enters it says how much it scatters.
// Facts: HAS_MEDIA, HAS_ENTRIES, HAS_LAYERED_FOG, HAS_DENSITY, HAS_DROPLETS, HAS_BOUNDARY (of nothing but a medium behind).
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
#if HAS_DENSITY
    I  grid;    // the medium's number, 0 where its density is no grid's
#endif
#if HAS_ENTRIES
    I  by_entry;
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
#if HAS_DENSITY
    all.grid = FALSE;
#endif
#if HAS_ENTRIES
    all.by_entry = FALSE;
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
#if HAS_DENSITY
        all.grid = (mine & (medium->voxels >= 0 ? (I)(-1) : FALSE)) != 0 ? (I)(index) : all.grid;
#endif
#if HAS_ENTRIES
        all.by_entry = (mine & (medium->by_entry ? (I)(-1) : FALSE)) != 0 ? (I)(-1) : all.by_entry;
#endif
        rest = rest & NOT(mine);
    }
    return all;
}

#if HAS_ENTRIES
// The share of light that a medium must scatter evenly so that a deep body of it gives back a share of even light (Kulla and
// Conty 2017), as albedo_for in rptcam_cl/scene/materials.py.
static inline F albedo_for(F colour)
{
    F s = 4.09712f + 4.20863f * colour - sqrt(9.59217f + colour * (41.6808f + 17.7126f * colour));
    s = MIN(MAX(s, ZERO), ONE);
    return 1.0f - s * s;
}

static inline F3 albedos_for(F3 c) { return f3(albedo_for(c.x), albedo_for(c.y), albedo_for(c.z)); }
#endif

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
    I leaves = crosses & (ahead > 0.0f);
    I beyond = enters ? (stack << MEDIUM_BITS) | inside : stack;
    // Of solids that overlap, it is not always the last entered that a path leaves first.
#pragma nounroll
    for (int bits = 0; bits < 4 * MEDIUM_BITS && ANY(leaves); bits += MEDIUM_BITS) {
        I rest = stack >> bits;
        I here = leaves & (rest >= ONE_MEDIUM) & ((rest & MEDIUM_MASK) == inside);
        beyond = here ? ((rest >> MEDIUM_BITS) << bits) | (stack & ((1 << bits) - 1)) : beyond;
        leaves = leaves & NOT(here);
    }
    return beyond;
}

// How a medium scatters, as a BSDF of a vertex of this kind; vertex.parameter is the mean cosine, vertex.color its droplets.
#define MATERIAL_PHASE 64

static inline I phase_is(I kind) { return kind == MATERIAL_PHASE; }

static inline F henyey_greenstein(F g, F cosine)
{
    F squared = MAX(1.0f + g * g - 2.0f * g * cosine, (F)(1e-9f));
    return 0.25f * INV_PI_F * (1.0f - g * g) / (squared * sqrt(squared));
}

#if HAS_DROPLETS
// How droplets of fog scatter beside the part of Henyey and Greenstein: Draine's function with the parameters that Jendersie and
// d'Eon (2023) give by their size; its weight is 0 for other media.
typedef struct { F g, alpha, weight; } Droplets;

static inline Droplets droplets_of(F3 c) { Droplets d; d.g = c.x; d.alpha = c.y; d.weight = c.z; return d; }

static inline F draine(Droplets d, F cosine)
{
    return henyey_greenstein(d.g, cosine) * (1.0f + d.alpha * cosine * cosine)
        / (1.0f + d.alpha * (1.0f + 2.0f * d.g * d.g) * 0.333333333f);
}

// The cosine below which a share u of Draine's function lies, by s = sqrt(1 + g^2 - 2 g cosine), over which its integral is
// -a / s - b s + c s^3: Newton's steps, halved intervals where they leave the bracket.
static F draine_cosine(Droplets d, F u)
{
    F g = MAX(d.g, (F)(1e-3f));
    F middle = 1.0f + g * g;
    F k = d.alpha / (4.0f * g * g);
    F a = 1.0f + k * middle * middle, b = 2.0f * k * middle, c = k * 0.333333333f;
    F low = 1.0f - g, high = 1.0f + g;
    F last = -a / high - b * high + c * high * high * high;
    F first = -a / low - b * low + c * low * low * low;
    F wanted = last + u * (first - last);       // the share below a cosine lies above its s
    F s = (1.0f - g * g) / (1.0f - g + 2.0f * g * u);
    for (uint step = 0u; step < 10u; ++step) {
        F error = -a / s - b * s + c * s * s * s - wanted;
        high = error > 0.0f ? s : high;
        low = error > 0.0f ? low : s;
        F next = s - error / MAX(a / (s * s) - b + 3.0f * c * s * s, (F)(SMALLEST));
        s = ((next > low) & (next < high)) ? next : 0.5f * (low + high);
    }
    return (middle - s * s) / (2.0f * g);
}
#endif

// Density over directions with which a medium scatters; `droplets` are of a vertex, or of the medium of a number.
static inline F phase_of(F g, F3 droplets, F cosine)
{
    F value = henyey_greenstein(g, cosine);
#if HAS_DROPLETS
    Droplets d = droplets_of(droplets);
    value = d.weight > 0.0f ? value + d.weight * (draine(d, cosine) - value) : value;
#endif
    return value;
}

static inline F3 droplets_in(I number, Scene scene)
{
#if HAS_DROPLETS
    return f3(GATHER(F, scene.media, number, .droplets.x), GATHER(F, scene.media, number, .droplets.y),
              GATHER(F, scene.media, number, .droplets.z));
#else
    return f3(ONE, ONE, ONE);
#endif
}

static inline F3 phase_eval(Vertex vertex, F3 d, Side side, F3 wo, F *pdf)
{
    *pdf = phase_of(vertex.parameter, vertex.color, dot3(d, wo));
    return f3(*pdf, *pdf, *pdf);
}

static inline Scattered phase_sample(Vertex vertex, F3 d, Side side, F u, F v, F lobe)
{
    F g = vertex.parameter;
    F s = (1.0f - g * g) / (1.0f - g + 2.0f * g * v);
    F cosine = absolute(g) < 1e-3f ? 1.0f - 2.0f * v : (1.0f + g * g - s * s) / (2.0f * g);
#if HAS_DROPLETS
    I far = lobe < vertex.color.z;
    if (ANY(far))
        cosine = far ? draine_cosine(droplets_of(vertex.color), v) : cosine;
#endif
    cosine = MIN(MAX(cosine, (F)(-1.0f)), ONE);
    F sn, cs;
    sincos_turns(u, &sn, &cs);
    F sine = root(1.0f - cosine * cosine);
    F3 x, y;
    frame(d, &x, &y);
    Scattered out;
    out.direction = from_frame(x, y, d, f3(sine * cs, sine * sn, cosine));
    out.weight = f3(ONE, ONE, ONE);
    out.pdf = phase_of(g, vertex.color, cosine);
    return out;
}

// Makes vertices of paths in the medium of the lanes `on`, which have no surface.
static void take_phase(Vertex *vertex, I on, I stack, F3 d, Scene scene)
{
    F3 against = scale(d, -ONE);
    vertex->n = select3(on, against, vertex->n);
    vertex->ng = select3(on, against, vertex->ng);
    vertex->color = select3(on, droplets_in(stack & MEDIUM_MASK, scene), vertex->color);
    vertex->parameter = on ? GATHER(F, scene.media, stack & MEDIUM_MASK, .asymmetry) : vertex->parameter;
    vertex->kind = on ? (I)(MATERIAL_PHASE) : vertex->kind;
}

#endif
