// A pane too thin to shift light: both faces with every reflection between them, and absorption on each way through
// (geometric series; Born and Wolf, Principles of Optics, ch. 7.6, without interference).
#ifndef THIN_GLASS_H
#define THIN_GLASS_H
#include "common/exponential.h"
#include "material/bsdf.h"

#if HAS_THIN_GLASS
static inline I thin_glass_is(I kind) { return kind == MATERIAL_THIN_GLASS; }

typedef struct { F3 reflected, passed; } Pane;

static inline void through_pane(F r, F depth, F *reflected, F *passed)
{
    F t = exponential(-depth);
    F once = (1.0f - r) * (1.0f - r) / MAX(1.0f - r * r * t * t, (F)(SMALLEST));
    *reflected = r + once * r * t * t;
    *passed = once * t;
}

// `depth` is the optical depth at normal incidence.
static inline Pane pane_of(F cos_i, F index, F3 depth)
{
    F ct;
    F r = fresnel(cos_i, index, &ct);
    F longer = 1.0f / MAX(ct, (F)(1e-6f));
    Pane pane;
    through_pane(r, depth.x * longer, &pane.reflected.x, &pane.passed.x);
    through_pane(r, depth.y * longer, &pane.reflected.y, &pane.passed.y);
    through_pane(r, depth.z * longer, &pane.reflected.z, &pane.passed.z);
    return pane;
}

static Scattered thin_glass_sample(Vertex vertex, F3 d, Side side, F u, F v, F lobe)
{
    Pane pane = pane_of(side.cosine, vertex.parameter, vertex.closure.depth);
    F back = max3(pane.reflected);
    F share = back / (back + max3(pane.passed));
    I reflects = lobe < share;
    F3 way = select3(reflects, along(d, side.n, 2.0f * side.cosine), d);
    F3 weight = select3(reflects, scale(pane.reflected, 1.0f / share), scale(pane.passed, 1.0f / (1.0f - share)));
    Scattered out;
    out.direction = normalized(way);
    out.weight = mul(vertex.color, weight);
    out.pdf = ZERO;
#if LAMPS_BEHIND_GLASS
    out.left = rest_of(lobe, share, NOT(reflects), reflects ? share : 1.0f - share);
#endif
    return out;
}
#endif

#endif
