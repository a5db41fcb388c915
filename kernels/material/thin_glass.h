// A pane too thin to shift light: both faces with every reflection between them, and absorption on each way through
// (geometric series; Born and Wolf, Principles of Optics, ch. 7.6, without interference).
#ifndef THIN_GLASS_H
#define THIN_GLASS_H
#include "common/exponential.h"
#include "material/fresnel.h"

typedef struct { F3 reflected, passed; } Pane;

static void through_pane(F r, F depth, F *reflected, F *passed)
{
    F t = exponential(-depth);
    F once = (1.0f - r) * (1.0f - r) / MAX(1.0f - r * r * t * t, (F)(SMALLEST));
    *reflected = r + once * r * t * t;
    *passed = once * t;
}

// `depth` is the optical depth at normal incidence.
static Pane pane_of(F cos_i, F index, F3 depth)
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

#endif
