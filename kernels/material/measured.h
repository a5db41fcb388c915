// Measured reflection of an even surface that has no direction of its own: a table by the half vector of Rusinkiewicz 1998, as
// MERL has it (Matusik et al. 2003). Rows of its half angle are finest at the mirror's direction, by the root of the angle.
#ifndef MEASURED_H
#define MEASURED_H
#include "common/angles.h"
#include "material/bsdf.h"

#if HAS_MEASURED
#define MEASURED_HEAD 3     // words before the table: its numbers of half angles, difference angles, and turns in half a circle

static inline I measured_is(I kind) { return kind == MATERIAL_MEASURED; }

// The cell before a place, the cell after, and the share of the latter; places are in cells, their values in the middle.
static inline F cells_at(F place, I count, I *before, I *after)
{
    F last = TO_F(count) - 1.0f;
    F at = MIN(MAX(place * TO_F(count) - 0.5f, ZERO), last);
    *before = TO_I(FLOOR(at));
    *after = MIN(*before + 1, count - 1);
    return at - FLOOR(at);
}

// BRDF of two directions in the frame of the normal.
static F3 measured_brdf(Vertex vertex, F3 wi, F3 wo)
{
    const __global uint *texels = vertex.scene.texels;
    I mine = measured_is(vertex.kind), start = vertex.closure.measured, single = (I)(1);
    I halves = mine ? AS_I(GATHER(U, texels, start, )) : single;        // of other lanes there is no table
    I differences = mine ? AS_I(GATHER(U, texels, start + 1, )) : single;
    I turns = mine ? AS_I(GATHER(U, texels, start + 2, )) : single;
    F3 h = normalized(add(wi, wo));
    F side = sqrt(h.x * h.x + h.y * h.y);
    F c = side > SMALLEST ? h.x / side : ONE, s = side > SMALLEST ? h.y / side : ZERO;
    // wi as seen from the half vector
    F flat = wi.x * c + wi.y * s;
    F3 seen = f3(flat * h.z - wi.z * side, wi.y * c - wi.x * s, dot3(wi, h));
    F aside = sqrt(seen.x * seen.x + seen.y * seen.y);
    F around = 2.0f * turns_around(seen.x, seen.y);
    around = (around - FLOOR(around)) * TO_F(turns) - 0.5f;        // half a circle: both directions may be exchanged
    F k = around - FLOOR(around);
    I turn[2];
    turn[0] = TO_I(MAX(FLOOR(around), (F)(-1.0f)));
    turn[0] = MIN(turn[0] < 0 ? turn[0] + turns : turn[0], turns - 1);
    turn[1] = turn[0] + 1 < turns ? turn[0] + 1 : FALSE;
    I half_cell[2], difference[2];
    F a = cells_at(sqrt(MAX(4.0f * turns_of(MAX(h.z, ZERO), side), ZERO)), halves, half_cell, half_cell + 1);
    F b = cells_at(4.0f * turns_of(MAX(seen.z, ZERO), aside), differences, difference, difference + 1);
    F3 sum = f3(ZERO, ZERO, ZERO);
    for (int i = 0; i < 8; ++i) {
        F share = ((i & 1) ? a : 1.0f - a) * ((i & 2) ? b : 1.0f - b) * ((i & 4) ? k : 1.0f - k);
        I cell = (half_cell[i & 1] * differences + difference[(i >> 1) & 1]) * turns + turn[i >> 2];
        I word = start + MEASURED_HEAD + 3 * cell;
        sum = along(sum, f3(AS_F(GATHER(U, texels, word, )), AS_F(GATHER(U, texels, word + 1, )),
                            AS_F(GATHER(U, texels, word + 2, ))), share);
    }
#if SPECTRAL_COLOURS
    F most = MAX(max3(sum), (F)(SMALLEST));
    sum = scale(at_wavelengths(scale(sum, 1.0f / most), 0.0f, vertex.scene), most);
#endif
    return sum;
}

// Facets of about the same gloss, or even scattering.
static F3 measured_value(Vertex vertex, F3 wi, F3 wo, F *pdf)
{
    F glossy;
    ggx_reflect(wi, wo, normalized(add(wi, wo)), same_alpha(vertex.closure.measured_alpha), &glossy);
    F even = MAX(wo.z, ZERO) * INV_PI_F;
    *pdf = even + vertex.closure.measured_gloss * (glossy - even);
    I above = (wi.z > 0.0f) & (wo.z > 0.0f);
    *pdf = above ? *pdf : ZERO;
    return keep3(above, scale(measured_brdf(vertex, wi, wo), wo.z));
}

static inline F3 measured_eval(Vertex vertex, F3 d, Side side, F3 wo, F *pdf)
{
    F3 s, t;
    frame(side.n, &s, &t);
    F3 wi = scale(to_frame(s, t, side.n, d), -ONE);
    wi.z = side.cosine;
    return measured_value(vertex, wi, to_frame(s, t, side.n, wo), pdf);
}

static Scattered measured_sample(Vertex vertex, F3 d, Side side, F u, F v, F lobe)
{
    F3 s, t;
    frame(side.n, &s, &t);
    F3 wi = scale(to_frame(s, t, side.n, d), -ONE);
    wi.z = side.cosine;
    F3 h = ggx_visible_normal(wi, same_alpha(vertex.closure.measured_alpha), u, v);
    F3 wo = sub(scale(h, 2.0f * dot3(wi, h)), wi);
    wo = select3(lobe < vertex.closure.measured_gloss, wo, cosine_direction(u, v));
    Scattered out;
    F3 value = measured_value(vertex, wi, wo, &out.pdf);
    I good = out.pdf > 0.0f;
    out.weight = keep3(good, scale(value, 1.0f / (good ? out.pdf : ONE)));
    out.direction = select3(good, from_frame(s, t, side.n, wo), side.n);
    return out;
}
#endif

#endif
