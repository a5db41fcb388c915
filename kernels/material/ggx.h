// Isotropic GGX conductor with Fresnel = 1 times a tint. Directions in the frame of the normal, z > 0 outside.
// Smith shadowing and visible normals: Heitz 2014 (JCGT 3(2)); sampling by spherical caps: Dupuy and Benyoub 2023.
#ifndef GGX_H
#define GGX_H
#include "common/math.h"

// Smith's Lambda for a direction with cosine z.
static F ggx_lambda(F z, F alpha)
{
    F z2 = z * z;
    F tan2 = MAX(ONE - z2, ZERO) / z2;
    return 0.5f * (sqrt(1.0f + alpha * alpha * tan2) - 1.0f);
}

static F ggx_density(F3 h, F alpha)
{
    F a2 = alpha * alpha;
    F k = (h.x * h.x + h.y * h.y) / a2 + h.z * h.z;
    return INV_PI_F / (a2 * k * k);
}

static F3 ggx_visible_normal(F3 wi, F alpha, F u, F v)
{
    F3 w = normalized(f3(wi.x * alpha, wi.y * alpha, wi.z));
    F s, c;
    sincos_turns(u, &s, &c);
    F z = (1.0f - v) * (1.0f + w.z) - w.z;
    F r = root(1.0f - z * z);
    F3 h = f3(r * c + w.x, r * s + w.y, z + w.z);
    return normalized(f3(h.x * alpha, h.y * alpha, h.z));
}

// BSDF times cosine (without the tint), and the density of sampling `wo`; both zero below the surface.
static F ggx_eval(F3 wi, F3 wo, F alpha, F *pdf)
{
    I above = (wi.z > 0.0f) & (wo.z > 0.0f);
    F3 h = normalized(add(wi, wo));
    F d = ggx_density(h, alpha);
    F li = ggx_lambda(wi.z, alpha);
    F lo = ggx_lambda(wo.z, alpha);
    F base = d / (4.0f * wi.z);
    *pdf = above ? base / (1.0f + li) : ZERO;
    return above ? base / (1.0f + li + lo) : ZERO;
}

#endif
