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
static inline F cubic(F x, float a, float b, float c, float d) { return a + x * (b + x * (c + x * d)); }
static inline F quartic(F x, float a, float b, float c, float d, float e) { return a + x * cubic(x, b, c, d, e); }

// Share of light from the cosine `mu` that meets further facets after one reflection, of facets that absorb nothing. A fit to its
// quadrature, 0.003 off at most where mu >= 0.01 (tests/device/test_covers.py); facets with two alphas have tables,
// material/facet_shares.h.
static F ggx_again(F mu, F alpha)
{
    F y = alpha / (mu + alpha);
    F p0 = cubic(alpha, 0.2339f, 5.9127f, 44.965f, 7.2562f);
    F p1 = cubic(alpha, 8.9162f, -64.8282f, -133.9671f, -138.4206f);
    F p2 = cubic(alpha, -35.2489f, 230.9865f, 54.7584f, 542.302f);
    F p3 = cubic(alpha, 50.5652f, -372.8272f, 229.589f, -900.0f);
    F p4 = cubic(alpha, -31.7851f, 283.3422f, -311.1575f, 692.0224f);
    F p5 = cubic(alpha, 7.3104f, -82.6035f, 115.9163f, -203.2345f);
    return MIN(MAX(y * y * (p0 + y * (p1 + y * (p2 + y * (p3 + y * (p4 + y * p5))))), ZERO), ONE);
}

// One over the mean of the fit over even light: of the light of a direction that meets further facets 0.0014 off at most.
static inline F ggx_over_again(F alpha)
{
    return cubic(alpha, 0.1901f, 4.5835f, 7.1391f, 7.7584f) / (alpha * alpha * (1.0f + 10.6266f * alpha));
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
    return (1.0f - ggx_again(mu, alpha)) * (f0 + (1.0f - f0) * steep);
}

// Its mean over even light.
static inline F schlick_mean_albedo(F alpha, F f0)
{
    F once = MIN(quartic(alpha, 1.0045f, -0.1926f, -1.6264f, 1.9318f, -0.7089f), ONE);
    F steep = quartic(sqrt(alpha), 0.04583f, 0.05755f, -0.48377f, 0.6632f, -0.28098f);
    return f0 * once + (1.0f - f0) * steep;
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
    return (1.0f - ggx_again(mu, alpha)) * share;
}

// Its mean over even light.
static inline F coat_mean_albedo(F alpha) { return cubic(alpha, 0.0916f, -0.159f, 0.1341f, -0.046f); }
#endif

#if FACET_ENERGY
// The colour that light takes by meeting further facets, each of which reflects the share `f` on average and sends the share
// `again` of even light on to others (the series of Kulla and Conty 2017).
static F3 colour_again(F3 f, F again)
{
    F once = 1.0f - again;
    return f3(f.x * once / (1.0f - f.x * again), f.y * once / (1.0f - f.y * again), f.z * once / (1.0f - f.z * again));
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
