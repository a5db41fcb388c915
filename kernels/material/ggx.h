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

#if FACET_ENERGY
static inline F quartic(F x, float a, float b, float c, float d, float e) { return a + x * (b + x * (c + x * (d + x * e))); }

// Share of light from the cosine `mu` that facets which absorb nothing send back after one reflection: what is missing meets
// further facets. A fit to its quadrature, at most 0.0032 of the value off (tests/device/test_covers.py); facets with
// two alphas have tables, material/facet_shares.h.
static F ggx_albedo(F mu, F alpha)
{
    F x = mu / (mu + 0.5f * alpha);
    F e0 = quartic(alpha, 0.9969f, 0.0041f, -0.0252f, 0.0683f, -0.0469f);
    F e1 = quartic(alpha, 0.1202f, 0.6268f, -7.1829f, 5.6795f, -1.4904f);
    F e2 = quartic(alpha, -3.2013f, -5.3056f, 57.3534f, -51.9450f, 11.8601f);
    F e3 = quartic(alpha, 15.6234f, 16.5589f, -229.5235f, 183.7096f, -18.0872f);
    F e4 = quartic(alpha, -35.4656f, -25.1964f, 441.2840f, -272.4617f, -45.3697f);
    F e5 = quartic(alpha, 36.4543f, 19.0337f, -402.7317f, 148.2968f, 136.2376f);
    F e6 = quartic(alpha, -13.5264f, -5.7445f, 140.7566f, -10.0429f, -86.7532f);
    F share = e0 + x * (e1 + x * (e2 + x * (e3 + x * (e4 + x * (e5 + x * e6)))));
    return MIN(MAX(share, (F)(0.2f)), ONE);
}

// Its mean over even light.
static inline F ggx_mean_albedo(F alpha)
{
    return MIN(quartic(alpha, 1.0045f, -0.1926f, -1.6264f, 1.9318f, -0.7089f), ONE);
}

// What light that meets facets again and again adds to what they reflect once, as a factor on that: the share `once` of the
// direction, `mean` of even light; each facet reflects the share `f` on average (Turquin 2019, with the series of Kulla and
// Conty 2017).
static F3 ggx_boost(F once, F mean, F3 f)
{
    F missing = 1.0f / once - 1.0f;
    F kept = 1.0f - mean;
    return f3(1.0f + missing * f.x * mean / (1.0f - f.x * kept), 1.0f + missing * f.y * mean / (1.0f - f.y * kept),
              1.0f + missing * f.z * mean / (1.0f - f.z * kept));
}

#define SCHLICK_MEAN 0.0476190476f      // of (1 - cos)^5 over even light

static inline F3 mean_fresnel(F3 f0)
{
    return f3(f0.x + (1.0f - f0.x) * SCHLICK_MEAN, f0.y + (1.0f - f0.y) * SCHLICK_MEAN, f0.z + (1.0f - f0.z) * SCHLICK_MEAN);
}
#endif

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
