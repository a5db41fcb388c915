// The sheen of cloth: fibres that stand up, seen where light or eye graze. Estevez and Kulla 2017, «Production friendly
// microfacet sheen BRDF»: the density of normals (2 + 1/a) sin(theta)^(1/a) / (2 pi), and their fit of Smith's Lambda
// without the softening of the terminator, which is not the same either way. The surface below gets what the sheen leaves.
#ifndef SHEEN_H
#define SHEEN_H
#include "common/exponential.h"
#include "material/closure.h"

#if HAS_SHEEN
#define LEAST_SHEEN_COSINE 1e-6f    // below it the fit of Lambda no longer grows as 1 / cosine

// `middle` is the logarithm at the cosine 0.5.
static F sheen_lambda(F mu, F alpha, F middle)
{
    F keep = (1.0f - alpha) * (1.0f - alpha);
    F a = 21.5473f + keep * (25.3245f - 21.5473f);
    F b = 3.82987f + keep * (3.32435f - 3.82987f);
    F c = 0.19823f + keep * (0.16801f - 0.19823f);
    F d = -1.97760f + keep * (-1.27393f + 1.97760f);
    F e = -4.32054f + keep * (-4.85967f + 4.32054f);
    I low = mu < 0.5f;
    F x = MAX(low ? mu : 1.0f - mu, (F)(LEAST_SHEEN_COSINE));
    F l = a / (1.0f + b * exponential(c * logarithm(x))) + d * x + e;
    return exponential(low ? l : 2.0f * middle - l);
}

// BSDF times cosine of a white sheen, zero below the surface; `h` is the normal between both directions.
static inline F sheen_reflect(Closure closure, F3 wi, F3 wo, F3 h)
{
    F alpha = closure.sheen_alpha;
    I above = (wi.z > 0.0f) & (wo.z > 0.0f);
    F ci = MAX(wi.z, (F)(LEAST_SHEEN_COSINE));
    F co = MAX(wo.z, (F)(LEAST_SHEEN_COSINE));
    F sin2 = MAX(1.0f - h.z * h.z, (F)(SMALLEST));
    F density = closure.sheen_peak * exponential(0.5f * logarithm(sin2) / alpha);
    F lambdas = sheen_lambda(ci, alpha, closure.sheen_half) + sheen_lambda(co, alpha, closure.sheen_half);
    return above ? density / (4.0f * ci * (1.0f + lambdas)) : ZERO;
}

// Share of light of cosine `mu` that a white sheen sends back: the logarithm is a quartic in the root of mu (rendering/plan/materials.py).
static inline F sheen_albedo(Cover e, F mu)
{
    F t = sqrt(mu);
    return exponential(e.c0 + t * (e.c1 + t * (e.c2 + t * (e.c3 + t * e.c4))));
}
#endif

#endif
