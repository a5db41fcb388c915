// GGX microfacets. Directions in the frame of the normal, z > 0 outside; x lies along the tangent.
// Smith shadowing and visible normals: Heitz 2014 (JCGT 3(2)); sampling by spherical caps: Dupuy and Benyoub 2023.
// Where Smith's Lambda would be divided by a cosine, the «stretch» S = (1 + 2 Lambda) z stands: it is finite at grazing.
#ifndef GGX_H
#define GGX_H
#include "common/math.h"

// GGX alpha along the tangent and across it.
typedef struct {
    F x;
#if HAS_ANISOTROPY
    F y;
#endif
} Alpha;

static inline Alpha same_alpha(F alpha)
{
    Alpha a;
    a.x = alpha;
#if HAS_ANISOTROPY
    a.y = alpha;
#endif
    return a;
}

static inline Alpha select_Alpha(I mine, Alpha a, Alpha b)
{
    a.x = mine ? a.x : b.x;
#if HAS_ANISOTROPY
    a.y = mine ? a.y : b.y;
#endif
    return a;
}

#if HAS_ANISOTROPY
#define ACROSS(alpha) ((alpha).y)
#else
#define ACROSS(alpha) ((alpha).x)
#endif

static inline F ggx_stretch(F3 w, Alpha alpha)
{
    F x = w.x * alpha.x;
    F y = w.y * ACROSS(alpha);
    return sqrt(x * x + y * y + w.z * w.z);
}

static inline F ggx_density(F3 h, Alpha alpha)
{
#if HAS_ANISOTROPY
    F ratio = alpha.y / alpha.x;
    F area = alpha.x * alpha.y;
    F k = h.x * h.x * ratio + h.y * h.y / ratio + h.z * h.z * area;
#else
    F area = alpha.x * alpha.x;
    F k = h.x * h.x + h.y * h.y + h.z * h.z * area;
#endif
    return INV_PI_F * area / (k * k);
}

static inline F3 ggx_visible_normal(F3 wi, Alpha alpha, F u, F v)
{
    F3 w = normalized(f3(wi.x * alpha.x, wi.y * ACROSS(alpha), wi.z));
    F s, c;
    sincos_turns(u, &s, &c);
    F z = (1.0f - v) * (1.0f + w.z) - w.z;
    F r = root(1.0f - z * z);
    F3 h = f3(r * c + w.x, r * s + w.y, z + w.z);
    return normalized(f3(h.x * alpha.x, h.y * ACROSS(alpha), h.z));
}

// What reflection by the facets of normal `h` sends from `wo` to `wi`: BSDF times cosine, without Fresnel's factor, and the
// density of choosing `wo`; both zero below the surface.
static inline F ggx_reflect(F3 wi, F3 wo, F3 h, Alpha alpha, F *pdf)
{
    I above = (wi.z > 0.0f) & (wo.z > 0.0f);
    F half_density = 0.5f * ggx_density(h, alpha);
    F si = ggx_stretch(wi, alpha);
    F so = ggx_stretch(wo, alpha);
    *pdf = above ? half_density / (wi.z + si) : ZERO;
    return above ? half_density * wo.z / (wo.z * si + wi.z * so) : ZERO;
}

#if HAS_REFRACTION
// The same for refraction to a `wo` below the surface (Walter et al. 2007; masking and shadowing are independent across an
// interface). The value is for radiance, which refraction into the index `eta` times as large divides by eta^2.
static F ggx_refract(F3 wi, F3 wo, F3 h, Alpha alpha, F eta, F *pdf)
{
    F ci = dot3(wi, h);
    F co = -dot3(wo, h);
    I possible = (ci > 0.0f) & (co > 0.0f) & (wi.z > 0.0f) & (wo.z < 0.0f);
    F bend = ci - eta * co;
    F visible = 2.0f * ggx_density(h, alpha) * ci / (wi.z + ggx_stretch(wi, alpha));
    F density = visible * eta * eta * co / (bend * bend);
    F unshadowed = -2.0f * wo.z / (ggx_stretch(wo, alpha) - wo.z);
    *pdf = possible ? density : ZERO;
    return possible ? density * unshadowed / (eta * eta) : ZERO;
}
#endif

#endif
