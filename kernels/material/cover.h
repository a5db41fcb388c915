// What a glossy cover over a diffuse base takes from it. Of the light that arrives with cosine mu the cover reflects the
// share E(mu), a quartic in 1 - mu; the base gets what is left, and gives it back through the same cover.
#ifndef COVER_H
#define COVER_H
#include "common/math.h"

typedef struct { F c0, c1, c2, c3, c4; } Cover;

static inline Cover no_cover(void)
{
    Cover e;
    e.c0 = e.c1 = e.c2 = e.c3 = e.c4 = ZERO;
    return e;
}

static inline Cover select_Cover(I mine, Cover a, Cover b)
{
    a.c0 = mine ? a.c0 : b.c0;
    a.c1 = mine ? a.c1 : b.c1;
    a.c2 = mine ? a.c2 : b.c2;
    a.c3 = mine ? a.c3 : b.c3;
    a.c4 = mine ? a.c4 : b.c4;
    return a;
}

static inline F cover_albedo(Cover e, F mu)
{
    F y = 1.0f - mu;
    F share = e.c0 + y * (e.c1 + y * (e.c2 + y * (e.c3 + y * e.c4)));
    return MIN(MAX(share, ZERO), ONE);
}

// The mean of E over a hemisphere of even light: the integral of 2 mu E(mu).
static inline F cover_mean(Cover e)
{
    return e.c0 + e.c1 * (1.0f / 3.0f) + e.c2 * (1.0f / 6.0f) + e.c3 * 0.1f + e.c4 * (1.0f / 15.0f);
}

#if HAS_PLASTIC || HAS_ROUGH_PLASTIC
// Albedo of a base of reflectance `rho` under a cover that sends the share `internal` of what leaves the base back to it.
static inline F3 lit_from_below(F3 rho, F internal)
{
    F out = 1.0f - internal;
    return f3(rho.x * out / (1.0f - rho.x * internal), rho.y * out / (1.0f - rho.y * internal),
              rho.z * out / (1.0f - rho.z * internal));
}
#endif

#if HAS_PRINCIPLED
#define COAT_REFLECTANCE 0.04f      // of a clear coat of index 1.5 at normal incidence

static inline F cubic(F q, float a, float b, float c, float d) { return a + q * (b + q * (c + q * d)); }

// Of GGX facets with Schlick's Fresnel, from `f0` at normal incidence, times `weight`: f0 + (1 - f0) G(mu), where G, the
// share that facets of reflectance (1 - cos)^5 send back, is fitted from above to its quadrature, so that no energy is won:
// at most 0.03 too high for mu >= 0.07, 0.004 on the mean (tests/device/test_covers.py).
static Cover cover_of(F f0, F alpha, F weight)
{
    F q = alpha / (alpha + 0.15f);
    F scale_g = weight * (1.0f - f0);
    Cover e;
    e.c0 = weight * f0 + scale_g * cubic(q, -0.00019f, 0.04512f, -0.10674f, 0.06553f);
    e.c1 = scale_g * cubic(q, 0.35521f, -1.50564f, 1.93655f, -0.80906f);
    e.c2 = scale_g * cubic(q, -1.32616f, 1.39756f, 4.3985f, -4.67664f);
    e.c3 = scale_g * cubic(q, 0.97883f, 9.28648f, -30.0f, 20.24348f);
    e.c4 = scale_g * cubic(q, 1.00749f, -10.82534f, 23.85271f, -14.21993f);
    return e;
}
#endif

#endif
