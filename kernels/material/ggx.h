// GGX microfacets. Directions in the frame of the normal, z > 0 outside; x lies along the tangent.
// Smith shadowing and visible normals: Heitz 2014 (JCGT 3(2)); sampling by spherical caps: Dupuy and Benyoub 2023.
// Where Smith's Lambda would be divided by a cosine, the «stretch» S = (1 + 2 Lambda) z stands: it is finite at grazing.
#ifndef GGX_H
#define GGX_H
#include "common/math.h"
#include "material/fresnel.h"

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

#if FACET_ENERGY || HAS_PRINCIPLED
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
#endif

#if HAS_PRINCIPLED
// Share of light from the cosine `mu` that facets reflect whose reflectance rises from `f0` after Schlick: his formula at a mean
// cosine of theirs, which is fitted to the quadrature, 0.001 below to 0.002 above it where mu >= 0.02 (tests/device/test_covers.py).
static F schlick_albedo(F mu, F alpha, F f0)
{
    F x = mu / (mu + 0.5f * alpha);
    F r = sqrt(alpha);
    F e0 = quartic(r, -0.0184f, 0.4124f, 0.9743f, -1.5709f, 0.6571f);
    F e1 = quartic(r, -0.0067f, 0.1879f, -0.8721f, 1.4655f, -0.8629f);
    F e2 = quartic(r, 0.1806f, -2.3041f, 5.5469f, -12.1783f, 6.7783f);
    F e3 = quartic(r, -0.2758f, 2.4074f, -3.6217f, 14.4694f, -8.185f);
    F e4 = quartic(r, 0.1208f, -0.7119f, -1.83f, -4.8045f, 1.2431f);
    F steep = schlick(MAX(mu + e0 + x * (e1 + x * (e2 + x * (e3 + x * e4))), ZERO));
    return ggx_albedo(mu, alpha) * (f0 + (1.0f - f0) * steep);
}

// Its mean over even light.
static inline F schlick_mean_albedo(F alpha, F f0)
{
    F steep = quartic(sqrt(alpha), 0.04583f, 0.05755f, -0.48377f, 0.6632f, -0.28098f);
    return f0 * ggx_mean_albedo(alpha) + (1.0f - f0) * steep;
}
#endif

#if HAS_CLEARCOAT
#define COAT_INDEX 1.5f

// The same of a clear coat, after Fresnel.
static F coat_albedo(F mu, F alpha)
{
    F x = mu / (mu + 0.5f * alpha);
    F r = sqrt(alpha);
    F e0 = quartic(r, 0.004f, 0.1966f, 1.4399f, -1.6718f, 0.5107f);
    F e1 = quartic(r, -0.1165f, 0.7952f, -0.8996f, -2.9793f, 3.353f);
    F e2 = quartic(r, 0.3763f, -2.5251f, -1.3387f, 17.1322f, -16.7093f);
    F e3 = quartic(r, -0.4302f, 1.8955f, 8.3046f, -33.8671f, 30.956f);
    F e4 = quartic(r, 0.1662f, -0.3364f, -7.7901f, 21.0918f, -20.2131f);
    F ct;
    F share = fresnel(MIN(MAX(mu + e0 + x * (e1 + x * (e2 + x * (e3 + x * e4))), ZERO), ONE), (F)(COAT_INDEX), &ct);
    return ggx_albedo(mu, alpha) * share;
}
#endif

#if FACET_ENERGY
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
