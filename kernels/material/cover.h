// What a glossy cover that the host knows takes from the diffuse base below it. Of the light that arrives with cosine mu it
// reflects the share E(mu), a quartic in 1 - mu; the base gets what is left, and gives it back through the same cover.
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

#endif
