// Materials of GGX facets: conductor, metal, rough dielectric, rough plastic, principled. Directions in the frame of the
// normal on the side of `wi`. One facet normal is drawn for all of them; what light takes to leave it, and the diffuse base,
// the sheen and the clear coat that some have, are chosen by one number, and the density is that of the whole mixture.
// A coat with normals of its own has a frame of its own, about vertex.coat_n, which is in the frame of the others here.
#ifndef FACETS_H
#define FACETS_H
#include "material/bsdf.h"
#include "material/sheen.h"

// What is the same for every `wo`.
typedef struct {
    F3    wi;
    F     eta;              // index beyond the surface over the index before it
    I     clear;            // lanes that refract
#if FACET_ENERGY
    F3    boost;            // of metal, by the light that its facets reflect more than once
#endif
#if HAS_AGAIN
    I     behind;           // lanes that come from inside
    F3    again;            // of glass, by what its facets scatter more than once
#endif
#if HAS_BASE
    F3    base;             // diffuse reflectance that the way in leaves
    F     under;            // probability of choosing the base
#endif
#if HAS_SHEEN
    F3    fibres;           // colour of the sheen
    F     sent;             // share of the light from `wi` that it sends back
    F     sheen;            // probability of choosing it
#endif
#if HAS_CLEARCOAT
    Alpha coat_alpha;
    F     bare;             // share of the light from `wi` that the coat lets pass
    F     coat;             // probability of choosing the coat, if not the base
#endif
#if HAS_COAT_NORMAL
    F3    coat_s, coat_t, coat_n;   // frame of the coat
#endif
} Lobes;

typedef struct {
    F3 reflected, refracted;
    F  reflects;            // probability of reflecting where both are possible
} Facet;

#if HAS_PRINCIPLED
#if HAS_SPECULAR_COLOR
#define SPECULAR_COLOR(vertex) (vertex).closure.specular_color
#else
#define SPECULAR_COLOR(vertex) WHITE_3
#endif

static inline F normal_reflectance(F index)
{
    F r = (index - 1.0f) / (index + 1.0f);
    return r * r;
}

static inline F brightest_f0(Vertex vertex)
{
    return normal_reflectance(vertex.parameter) * max3(SPECULAR_COLOR(vertex));
}

// Lanes where facets without a film cover a diffuse base.
static inline I of_facets(Vertex vertex)
{
    I facets = vertex.kind == MATERIAL_PRINCIPLED;
#if HAS_THIN_FILM
    facets = facets & (vertex.closure.film == 0);
#endif
    return facets;
}

// Schlick's rise from `f0` at normal incidence to `most`.
static inline F3 raised(F3 f0, F most, F steep)
{
    return along(f0, sub(f3(most, most, most), f0), steep);
}

#if HAS_THIN_FILM
#define FILM_COSINES 128

// What a surface with a thin film reflects at a cosine, by the table of plan/materials.py.
static F3 film_at(Vertex vertex, F c)
{
    const __global uint *texels = vertex.scene.texels;
    F at = MIN(MAX(c, ZERO), ONE) * (float)(FILM_COSINES - 1);
    F low = MIN(FLOOR(at), (F)((float)(FILM_COSINES - 2)));
    I word = MAX(vertex.closure.film - 1, FALSE) + 3 * TO_I(low);
    F3 a = f3(AS_F(GATHER(U, texels, word, )), AS_F(GATHER(U, texels, word + 1, )), AS_F(GATHER(U, texels, word + 2, )));
    F3 b = f3(AS_F(GATHER(U, texels, word + 3, )), AS_F(GATHER(U, texels, word + 4, )), AS_F(GATHER(U, texels, word + 5, )));
    return at_wavelengths(along(a, sub(b, a), at - low), 0.0f, vertex.scene);
}
#endif

// Schlick's Fresnel between a dielectric and a metal of the base colour (glTF 2.0, appendix B.3.5).
static Facet principled_facet(Vertex vertex, Lobes lobes, F c)
{
    Facet facet;
    F steep = schlick(c);
    F most = vertex.closure.specular;
    F3 f0 = scale(SPECULAR_COLOR(vertex), most * normal_reflectance(vertex.parameter));
    F3 f = raised(f0, most, steep);
#if HAS_TRANSMISSION
    // The transparent part, seen from inside, reflects by the angle outside, and totally beyond the critical one.
    F clear = vertex.closure.transmission;
    F sin2 = (1.0f - c * c) / (lobes.eta * lobes.eta);
    F beyond = lobes.eta < 1.0f ? schlick(root(1.0f - sin2)) : steep;
    F3 of_clear = select3(sin2 >= 1.0f, WHITE_3, raised(f0, most, beyond));
    F3 passed = sub(WHITE_3, of_clear);
    f = along(f, sub(of_clear, f), clear);
#endif
    F3 metal = along(scale(vertex.color, 1.0f - steep), f3(ONE, ONE, ONE), steep);
#if FACET_ENERGY
    metal = mul(metal, lobes.boost);
#endif
    F dielectric = 1.0f - vertex.closure.metallic;
    facet.reflected = along(scale(f, dielectric), metal, vertex.closure.metallic);
#if HAS_THIN_FILM
    I filmed = vertex.closure.film > 0;
    if (ANY(filmed)) {
        F3 film = film_at(vertex, c);
#if FACET_ENERGY
        film = along(film, mul(film, sub(lobes.boost, WHITE_3)), vertex.closure.metallic);
#endif
        facet.reflected = select3(filmed, film, facet.reflected);
    }
#endif
    facet.reflects = ONE;
    facet.refracted = f3(ZERO, ZERO, ZERO);
#if HAS_TRANSMISSION
    facet.refracted = mul(vertex.color, scale(passed, dielectric * clear));
    F other = max3(facet.refracted);
    F own = max3(facet.reflected);
#if HAS_AGAIN
    own += max3(of_clear) * dielectric * clear * (vertex.closure.reflects_more - 1.0f);
#endif
    facet.reflects = other > 0.0f ? own / (own + other) : ONE;
#endif
#if HAS_AGAIN && HAS_TRANSMISSION
    F3 more = scale(mul(of_clear, sub(lobes.again, WHITE_3)), dielectric * clear);
#if HAS_THIN_FILM
    more = keep3(NOT(filmed), more);
#endif
    facet.reflected = add(facet.reflected, more);
    facet.refracted = mul(facet.refracted, lobes.again);
#endif
    return facet;
}
#endif

// What a facet that `wi` meets with cosine `c` does to the light.
static Facet facet_of(Vertex vertex, Lobes lobes, F c)
{
    Facet facet;
    facet.reflected = vertex.color;
    facet.refracted = f3(ZERO, ZERO, ZERO);
    facet.reflects = ONE;
#if HAS_METAL
    I metal = vertex.kind == MATERIAL_METAL;
    if (ANY(metal)) {
        F3 n = vertex.closure.n;
        F3 k = vertex.closure.k;
        F3 f = f3(metal_fresnel(c, n.x, k.x), metal_fresnel(c, n.y, k.y), metal_fresnel(c, n.z, k.z));
        facet.reflected = select3(metal, mul(vertex.color, f), facet.reflected);
    }
#endif
#if FACET_ENERGY
    facet.reflected = mul(facet.reflected, lobes.boost);
#endif
#if HAS_ROUGH_DIELECTRIC || HAS_ROUGH_PLASTIC
    I glass = (vertex.kind == MATERIAL_ROUGH_DIELECTRIC) | (vertex.kind == MATERIAL_ROUGH_PLASTIC);
    if (ANY(glass)) {
        F ct;
        F f = fresnel(c, lobes.eta, &ct);
        F g = 1.0f - f;
        facet.reflected = select3(glass, f3(f, f, f), facet.reflected);
        facet.refracted = select3(glass & lobes.clear, f3(g, g, g), facet.refracted);
#if HAS_AGAIN
        facet.reflected = select3(glass, mul(facet.reflected, lobes.again), facet.reflected);
        facet.refracted = mul(facet.refracted, lobes.again);
#endif
#if HAS_AGAIN
        F odds = f * vertex.closure.reflects_more;
        facet.reflects = (glass & lobes.clear) ? odds / (odds + g) : facet.reflects;
#else
        facet.reflects = (glass & lobes.clear) ? f : facet.reflects;
#endif
#if HAS_GLASS_TINT && HAS_ROUGH_DIELECTRIC
        I tinted = vertex.kind == MATERIAL_ROUGH_DIELECTRIC;
        facet.reflected = select3(tinted, mul(facet.reflected, vertex.color), facet.reflected);
        facet.refracted = select3(tinted, mul(facet.refracted, vertex.closure.passed), facet.refracted);
#endif
    }
#endif
#if HAS_PRINCIPLED
    I principled = vertex.kind == MATERIAL_PRINCIPLED;
    if (ANY(principled)) {
        Facet own = principled_facet(vertex, lobes, c);
        facet.reflected = select3(principled, own.reflected, facet.reflected);
        facet.refracted = select3(principled, own.refracted, facet.refracted);
        facet.reflects = principled ? own.reflects : facet.reflects;
    }
#endif
    return facet;
}

#define LEAST_COAT 0.25f    // the coat is chosen at least so often: it shows lamps, which outshine what lights the base

#if HAS_BASE
// Share of light from `w` that the facets above a base reflect, and its mean; under a film and of plastic the host knows it, unless
// they are brushed.
static F share_above_base(Vertex vertex, F3 w, F *mean)
{
#if HAS_KNOWN_COVER
    F share = cover_albedo(vertex.closure.cover, w.z);
    *mean = cover_mean(vertex.closure.cover);
#else
    F share = *mean = ZERO;
#endif
#if HAS_PRINCIPLED
    I facets = of_facets(vertex);
    if (ANY(facets)) {
        F f0 = brightest_f0(vertex);
        F own = vertex.closure.specular * schlick_albedo(w.z, vertex.closure.alpha.x, f0);
        share = facets ? MIN(own, ONE) : share;
        *mean = facets ? vertex.closure.specular * schlick_mean_albedo(vertex.closure.alpha.x, f0) : *mean;
    }
#endif
#if HAS_BRUSHED_BASE
    I brushed = vertex.closure.brushed_alphas > 0;
#if HAS_THIN_FILM
    brushed = brushed & (vertex.closure.film == 0);
#endif
    if (ANY(brushed)) {
        Alpha alpha = vertex.closure.alpha;
        F f0 = ZERO, most = ONE, rise = schlick(w.z);
#if HAS_ROUGH_PLASTIC
        F ct;
        rise = vertex.kind == MATERIAL_ROUGH_PLASTIC ? fresnel(w.z, vertex.parameter, &ct) : rise;
#endif
#if HAS_PRINCIPLED
        I principled = vertex.kind == MATERIAL_PRINCIPLED;
        f0 = principled ? brightest_f0(vertex) : f0;
        most = principled ? vertex.closure.specular : most;
#endif
        Brushed of = brushed_shares(vertex.scene.facet_shares, vertex.closure.brushed_table, MAX(vertex.closure.brushed_alphas, (I)(1)),
                                    stretched(w.z, w.x, alpha), alpha, rise);
        F own = most * (f0 * of.once + (1.0f - f0) * of.risen);
        share = brushed ? MIN(own, ONE) : share;
        *mean = brushed ? most * (f0 * of.once_mean + (1.0f - f0) * of.risen_mean) : *mean;
    }
#endif
    return share;
}

// The diffuse base (Kelemen and Szirmay-Kalos 2001): rho (1 - E(wi)) (1 - E(wo)) / (pi (1 - mean of E)) is symmetric, and
// with rho = 1 gives back all that the cover does not. `over` is the share that a coat reflects. Returns about the albedo of all
// these lobes.
static F add_base(Lobes *lobes, Vertex vertex, F over)
{
    F3 rho = f3(ZERO, ZERO, ZERO);
    F mean;
    F others = ONE;
    F share = share_above_base(vertex, lobes->wi, &mean);
#if HAS_ROUGH_PLASTIC
    rho = keep3(vertex.kind == MATERIAL_ROUGH_PLASTIC, lit_from_below(vertex.color, vertex.closure.internal));
    others = share;
#endif
#if HAS_PRINCIPLED
    I principled = vertex.kind == MATERIAL_PRINCIPLED;
    if (ANY(principled)) {
        F metallic = vertex.closure.metallic;
#if HAS_TRANSMISSION
        F clear = vertex.closure.transmission;
#else
        F clear = ZERO;
#endif
        F rest = (1.0f - metallic) * (share + (1.0f - share) * clear) + metallic * max3(vertex.color);
        rho = select3(principled, scale(vertex.color, (1.0f - metallic) * (1.0f - clear)), rho);
        others = principled ? rest : others;
    }
#endif
    F whole = 1.0f - mean;
    lobes->base = scale(rho, (1.0f - share) / MAX(whole, (F)(1e-6f)));
    F own = max3(lobes->base) * whole;
    others += over;
#if HAS_CLEARCOAT
    lobes->coat = over > 0.0f ? MAX(over / others, (F)(LEAST_COAT)) : ZERO;
#endif
    lobes->under = own > 0.0f ? own / (own + others) : ZERO;
    return own + others;
}
#endif

#if HAS_SHEEN
// Share of the light of cosine `mu` that the sheen keeps from the surface below.
static inline F sheen_share(Vertex vertex, F3 fibres, F mu)
{
    F share = max3(fibres) * sheen_albedo(vertex.closure.sheen_cover, mu);
    return MIN(share, ONE);
}

// Sheen over a surface of about the albedo `below`.
static inline void add_sheen(Lobes *lobes, Vertex vertex, I behind, F below)
{
    I cloth = (vertex.kind == MATERIAL_PRINCIPLED) & NOT(lobes->clear & behind);
    lobes->fibres = keep3(cloth, vertex.closure.sheen);
    lobes->sent = sheen_share(vertex, lobes->fibres, lobes->wi.z);
    F rest = (1.0f - lobes->sent) * below;
    lobes->sheen = lobes->sent > 0.0f ? lobes->sent / (lobes->sent + rest) : ZERO;
}
#endif

#if HAS_CLEARCOAT
static inline F3 to_coat(Lobes lobes, F3 w)
{
#if HAS_COAT_NORMAL
    w = to_frame(lobes.coat_s, lobes.coat_t, lobes.coat_n, w);
#endif
    return w;
}
#endif

#if FACET_ENERGY
// What metal gains by light that its facets reflect more than once; 1 for all else.
static F3 boost_of(Vertex vertex, F mu)
{
    F3 mean = vertex.color;
#if HAS_METAL
    F3 n = vertex.closure.n, k = vertex.closure.k;
    F3 f0 = f3(metal_fresnel(ONE, n.x, k.x), metal_fresnel(ONE, n.y, k.y), metal_fresnel(ONE, n.z, k.z));
    mean = select3(vertex.kind == MATERIAL_METAL, mul(mean, mean_fresnel(f0)), mean);
#endif
#if HAS_PRINCIPLED
    mean = select3(vertex.kind == MATERIAL_PRINCIPLED, mean_fresnel(mean), mean);
#endif
    I metal = (vertex.kind == MATERIAL_CONDUCTOR) | (vertex.kind == MATERIAL_METAL) | (vertex.kind == MATERIAL_PRINCIPLED);
#if HAS_BRUSHED_SHARE
    return select3(metal, ggx_boost(vertex.closure.once, vertex.closure.once_mean, mean), WHITE_3);
#else
    F alpha = vertex.closure.alpha.x;
    return select3(metal, ggx_boost(ggx_albedo(mu, alpha), ggx_mean_albedo(alpha), mean), WHITE_3);
#endif
}
#endif

#if HAS_AGAIN
// What glass gains by light that its facets scatter more than once: a factor for each of both directions, so that the BSDF stays the
// same either way. That light is mostly what one facet refracts and another reflects, so that it takes the colour of reflections beside
// that of light scattered once.
static F3 again_of(Vertex vertex, Lobes lobes, F3 wo)
{
    I passes = lobes.clear & (wo.z < 0.0f);
    Gains gains = vertex.closure.gains;
    F other = glass_gain(vertex.scene.facet_shares, gains, lobes.behind ^ passes, passes ? (I)(GAIN_PASSED) : (I)(GAIN_REFLECTED),
                         entry_of(stretched(wo.z, wo.x, vertex.closure.alpha), TURNS_OF(gains)));
    F again = (passes ? vertex.closure.gain_passed : vertex.closure.gain) * (gains.table > 0 ? other : ONE);
    F3 gain = f3(again, again, again);
#if HAS_STAIN
    I glass = vertex.kind == MATERIAL_ROUGH_DIELECTRIC;
    gain = select3(glass, ggx_boost(1.0f / again, vertex.closure.glass_mean, vertex.color), gain);
#endif
    return gain;
}
#endif

static Lobes lobes_of(Vertex vertex, F3 wi, I behind)
{
    Lobes lobes;
    lobes.wi = wi;
    lobes.eta = vertex.parameter;
    lobes.clear = FALSE;
#if HAS_ROUGH_DIELECTRIC
    lobes.clear = vertex.kind == MATERIAL_ROUGH_DIELECTRIC;
#endif
#if HAS_TRANSMISSION
    lobes.clear = lobes.clear | ((vertex.kind == MATERIAL_PRINCIPLED) & (vertex.closure.transmission > 0.0f));
#endif
#if HAS_REFRACTION
    lobes.eta = (lobes.clear & behind) ? 1.0f / lobes.eta : lobes.eta;
#endif
#if FACET_ENERGY
    lobes.boost = boost_of(vertex, wi.z);
#endif
#if HAS_AGAIN
    lobes.behind = behind;
    lobes.again = WHITE_3;
#endif
#if HAS_CLEARCOAT
    I coated = (vertex.kind == MATERIAL_PRINCIPLED) & NOT(lobes.clear & behind);
    F coat = coated ? vertex.closure.coat : ZERO;
    F alpha = coated ? vertex.closure.coat_alpha : ONE;
    lobes.coat_alpha = same_alpha(alpha);
#if HAS_COAT_NORMAL
    lobes.coat_n = vertex.coat_n;
    frame(lobes.coat_n, &lobes.coat_s, &lobes.coat_t);
#endif
    F over = coat * coat_albedo(to_coat(lobes, wi).z, alpha);
    lobes.bare = 1.0f - over;
#elif HAS_BASE
    F over = ZERO;
#endif
#if HAS_SHEEN
    add_sheen(&lobes, vertex, behind, add_base(&lobes, vertex, over));
#elif HAS_BASE
    add_base(&lobes, vertex, over);
#endif
    return lobes;
}

// BSDF times cosine and the density of choosing `wo`, for the facet normal `h` between `wi` and `wo`.
static F3 lobes_eval(Vertex vertex, Lobes lobes, F3 wo, F3 h, F *pdf)
{
    F c = MAX(dot3(lobes.wi, h), ZERO);
#if HAS_AGAIN
    lobes.again = again_of(vertex, lobes, wo);
#endif
    Facet facet = facet_of(vertex, lobes, c);
    F density;
    F mirrored = ggx_reflect(lobes.wi, wo, h, vertex.closure.alpha, &density);
    F3 sum = scale(facet.reflected, mirrored);
#if HAS_REFRACTION
    density *= facet.reflects;
    I below = lobes.clear & (wo.z < 0.0f);
    if (ANY(below)) {
        F other;
        F bent = ggx_refract(lobes.wi, wo, h, vertex.closure.alpha, lobes.eta, &other);
        sum = select3(below, scale(facet.refracted, bent), sum);
        density = below ? other * (1.0f - facet.reflects) : density;
    }
#endif
#if HAS_CLEARCOAT
    F3 coat_wi = to_coat(lobes, lobes.wi);
    F3 coat_wo = to_coat(lobes, wo);
    F taken = lobes.bare;
#if !FACET_ENERGY
    taken *= lobes.coat > 0.0f ? 1.0f - vertex.closure.coat * coat_albedo(absolute(coat_wo.z), lobes.coat_alpha.x) : ONE;
#endif
    F coat_density;
#if HAS_COAT_NORMAL
    h = normalized(add(coat_wi, coat_wo));
    c = MAX(dot3(coat_wi, h), ZERO);
#endif
    F coat = ggx_reflect(coat_wi, coat_wo, h, lobes.coat_alpha, &coat_density);
    F ct;
    coat *= vertex.closure.coat * fresnel(c, (F)(COAT_INDEX), &ct);
    I shines = lobes.coat > 0.0f;
#if HAS_COAT_NORMAL
    I through = lobes.clear & (wo.z < 0.0f);
    shines = shines & NOT(through);
    coat_density = through ? ZERO : coat_density;
#endif
    coat = shines ? coat : ZERO;
    density += lobes.coat * (coat_density - density);
#endif
#if HAS_BASE
    F up = MAX(wo.z, ZERO) * INV_PI_F;
    F mean;
    sum = along(sum, lobes.base, up * (1.0f - share_above_base(vertex, f3(wo.x, wo.y, MAX(wo.z, ZERO)), &mean)));
    density += lobes.under * (up - density);
#endif
#if HAS_SHEEN
    if (ANY(lobes.sent > 0.0f)) {
#if FACET_ENERGY
        F kept = lobes.sent;
#else
        F kept = MAX(lobes.sent, sheen_share(vertex, lobes.fibres, absolute(wo.z)));
#endif
        sum = scale(sum, 1.0f - kept);
        sum = along(sum, lobes.fibres, sheen_reflect(vertex.closure, lobes.wi, wo, h));
        density += lobes.sheen * ((wo.z > 0.0f ? 0.5f * INV_PI_F : ZERO) - density);
    }
#endif
#if HAS_CLEARCOAT
    sum = add(scale(sum, taken), f3(coat, coat, coat));
#endif
    *pdf = density;
    return sum;
}

// The facet normal that takes `wi` to `wo`.
static inline F3 facet_normal(Lobes lobes, F3 wo)
{
    F3 h = add(lobes.wi, wo);
#if HAS_REFRACTION
    h = select3(lobes.clear & (wo.z < 0.0f), along(lobes.wi, wo, lobes.eta), h);
    F up = with_sign(ONE, h.z);
    h = scale(h, up);
#endif
    F length2 = dot3(h, h);
    F3 unit = scale(h, 1.0f / sqrt(MAX(length2, (F)(SMALLEST))));
    return select3(length2 > SMALLEST, unit, f3(ZERO, ZERO, ONE));      // of light that grazes from the other side
}

static inline F3 facets_eval(Vertex vertex, F3 wi, F3 wo, I behind, F *pdf)
{
    Lobes lobes = lobes_of(vertex, wi, behind);
    return lobes_eval(vertex, lobes, wo, facet_normal(lobes, wo), pdf);
}

// Chooses `wo`; returns BSDF times cosine over the density, zero where nothing goes on.
static F3 facets_sample(Vertex vertex, F3 wi, I behind, F u, F v, F lobe, F3 *wo, F *pdf)
{
    // Choose the sheen, the base, the coat or the facets by one number.
    Lobes lobes = lobes_of(vertex, wi, behind);
    Alpha alpha = vertex.closure.alpha;
#if HAS_SHEEN
    I cloth = lobe < lobes.sheen;
    lobe = cloth ? ONE : (lobe - lobes.sheen) / (1.0f - lobes.sheen);
#endif
#if HAS_BASE
    I under = lobe < lobes.under;
    lobe = under ? lobe : (lobe - lobes.under) / (1.0f - lobes.under);
#endif
#if HAS_CLEARCOAT
    I coated = lobe < lobes.coat;
    lobe = coated ? lobe : (lobe - lobes.coat) / (1.0f - lobes.coat);
    alpha = select_Alpha(coated, lobes.coat_alpha, alpha);
#endif
    // Reflect at a visible facet, refract through it, or leave the base.
#if HAS_COAT_NORMAL
    F3 h = ggx_visible_normal(select3(coated, to_coat(lobes, wi), wi), alpha, u, v);
    h = select3(coated, from_frame(lobes.coat_s, lobes.coat_t, lobes.coat_n, h), h);
#else
    F3 h = ggx_visible_normal(wi, alpha, u, v);
#endif
    F c = dot3(wi, h);
    F3 to = sub(scale(h, 2.0f * c), wi);
    I good = to.z > 0.0f;
#if HAS_COAT_NORMAL
    I seen = (dot3(lobes.coat_n, to) > 0.0f) & (NOT(lobes.clear) | good);
    good = coated ? seen : good;
#endif
#if HAS_REFRACTION
    Facet facet = facet_of(vertex, lobes, c);
    I passes = lobes.clear & (lobe >= facet.reflects);
#if HAS_CLEARCOAT
    passes = passes & NOT(coated);
#endif
    if (ANY(passes)) {
        F inverse = 1.0f / lobes.eta;
        F ct = root(1.0f - (1.0f - c * c) * inverse * inverse);
        F3 bent = normalized(along(scale(wi, -inverse), h, inverse * c - ct));
        to = select3(passes, bent, to);
        good = passes ? bent.z < 0.0f : good;
    }
#endif
#if HAS_BASE
    if (ANY(under)) {
        to = select3(under, cosine_direction(u, v), to);
        h = select3(under, facet_normal(lobes, to), h);
        good = good | under;
    }
#endif
#if HAS_SHEEN
    if (ANY(cloth)) {
        to = select3(cloth, even_direction(u, v), to);
        h = select3(cloth, facet_normal(lobes, to), h);
        good = good | cloth;
    }
#endif
    // Weigh the direction by the density of the whole mixture.
    F3 value = lobes_eval(vertex, lobes, to, h, pdf);
    good = good & (*pdf > 0.0f);
    *pdf = good ? *pdf : ZERO;
    *wo = to;
    return keep3(good, scale(value, 1.0f / (good ? *pdf : ONE)));
}

#endif
