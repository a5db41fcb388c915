// Materials of GGX facets: conductor, metal, rough dielectric, rough plastic, principled. Directions in the frame of the
// normal on the side of `wi`. One facet normal is drawn for all of them; what light takes to leave it, and the diffuse base,
// the sheen and the clear coat that some have, are chosen by one number, and the density is that of the whole mixture.
// A coat with normals of its own has a frame of its own, about vertex.coat_n, which is in the frame of the others here.
#ifndef FACETS_H
#define FACETS_H
#include "material/bsdf.h"
#include "material/sheen.h"

typedef struct {
    F3 reflected, refracted;
#if HAS_METAL_AGAIN
    F3 by_metal;            // of what is reflected
#endif
    F  reflects;            // probability of reflecting where both are possible
} Facet;

static inline I is_metal(Vertex vertex) { return (vertex.kind == MATERIAL_CONDUCTOR) | (vertex.kind == MATERIAL_METAL); }

// Of the alphas along and across.
static inline F mean_alpha(Vertex vertex) { return MIN(0.5f * (vertex.closure.alpha.x + ACROSS(vertex.closure.alpha)), ONE); }

// Of light that meets several facets, the share that goes in all directions; the rest goes where facets scatter once.
#define LEAST_EVEN 0.02f    // alpha up to which none does,
#define ALL_EVEN   0.09f    // and from which on all

static inline F share_even(Vertex vertex)
{
    return MIN(MAX((mean_alpha(vertex) - LEAST_EVEN) * (1.0f / (ALL_EVEN - LEAST_EVEN)), ZERO), ONE);
}

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
    F dielectric = 1.0f - vertex.closure.metallic;
    metal = scale(metal, vertex.closure.metallic);
    facet.reflected = add(scale(f, dielectric), metal);
#if HAS_THIN_FILM
    I filmed = vertex.closure.film > 0;
    if (ANY(filmed)) {
        F3 film = film_at(vertex, c);
        facet.reflected = select3(filmed, film, facet.reflected);
        metal = select3(filmed, scale(film, vertex.closure.metallic), metal);
    }
#endif
    facet.reflects = ONE;
    facet.refracted = f3(ZERO, ZERO, ZERO);
#if HAS_TRANSMISSION
    facet.refracted = mul(vertex.color, scale(passed, dielectric * clear));
    F other = max3(facet.refracted);
    F own = max3(facet.reflected);
    facet.reflects = other > 0.0f ? own / (own + other) : ONE;
#endif
#if HAS_METAL_AGAIN
    facet.by_metal = metal;
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
IN_PLACE static Facet facet_of(Vertex vertex, Lobes lobes, F c)
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
#if HAS_METAL_AGAIN
    facet.by_metal = keep3(is_metal(vertex), facet.reflected);
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
        facet.reflects = (glass & lobes.clear) ? f : facet.reflects;
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
#if HAS_METAL_AGAIN
        facet.by_metal = select3(principled, own.by_metal, facet.by_metal);
#endif
        facet.reflects = principled ? own.reflects : facet.reflects;
    }
#endif
    return facet;
}

#define LEAST_COAT 0.25f    // the coat is chosen at least so often: it shows lamps, which outshine what lights the base

#if HAS_BASE
// Of light from a direction: the share that the facets above a diffuse base reflect, and its mean over even light; the share that
// meets further facets of metal, and one over its mean. The host knows the first under a film and of plastic, unless they are brushed.
typedef struct { F cover, cover_mean, again, over_again; } Shares;

IN_PLACE static Shares shares_of(Vertex vertex, F3 w)
{
    Shares of;
#if HAS_KNOWN_COVER
    of.cover = cover_albedo(vertex.closure.cover, w.z);
    of.cover_mean = cover_mean(vertex.closure.cover);
#else
    of.cover = of.cover_mean = ZERO;
#endif
#if HAS_METAL_AGAIN
    of.again = ggx_again(w.z, vertex.closure.alpha.x);
    of.over_again = ggx_over_again(vertex.closure.alpha.x);
#endif
#if HAS_PRINCIPLED
    I facets = of_facets(vertex);
    if (ANY(facets)) {
        F f0 = brightest_f0(vertex);
        F own = vertex.closure.specular * schlick_albedo(w.z, vertex.closure.alpha.x, f0);
        of.cover = facets ? MIN(own, ONE) : of.cover;
        of.cover_mean = facets ? vertex.closure.specular * schlick_mean_albedo(vertex.closure.alpha.x, f0) : of.cover_mean;
    }
#endif
#if HAS_BRUSHED_SHARE
    I brushed = vertex.closure.brushed_alphas > 0;
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
        Brushed own = brushed_shares(vertex.scene.facet_shares, vertex.closure.brushed_table,
                                     MAX(vertex.closure.brushed_alphas, (I)(1)), stretched(w.z, w.x, alpha), alpha, rise);
#if HAS_METAL_AGAIN
        of.again = brushed ? own.again : of.again;
        of.over_again = brushed ? 1.0f / MAX(own.again_mean, (F)(1e-9f)) : of.over_again;
#endif
#if HAS_BRUSHED_BASE
#if HAS_THIN_FILM
        brushed = brushed & (vertex.closure.film == 0);
#endif
        F cover = most * (f0 * (1.0f - own.again) + (1.0f - f0) * own.risen);
        of.cover = brushed ? MIN(cover, ONE) : of.cover;
        of.cover_mean = brushed ? most * (f0 * (1.0f - own.again_mean) + (1.0f - f0) * own.risen_mean) : of.cover_mean;
#endif
    }
#endif
    return of;
}

#if HAS_METAL_AGAIN
// What a facet of metal reflects of light with the cosine `c` to it.
static F3 reflected_by_metal(Vertex vertex, F c)
{
    F3 reflected = vertex.color;
#if HAS_METAL
    F3 n = vertex.closure.n, k = vertex.closure.k;
    F3 f = f3(metal_fresnel(c, n.x, k.x), metal_fresnel(c, n.y, k.y), metal_fresnel(c, n.z, k.z));
    reflected = select3(vertex.kind == MATERIAL_METAL, mul(reflected, f), reflected);
#endif
#if HAS_METALLIC
    reflected = select3(vertex.kind == MATERIAL_PRINCIPLED, raised(reflected, ONE, schlick(c)), reflected);
#if HAS_THIN_FILM
    I filmed = vertex.closure.film > 0;
    if (ANY(filmed))
        reflected = select3(filmed, film_at(vertex, c), reflected);
#endif
#endif
    return reflected;
}

static inline F grazing(F mu) { return (1.0f - mu) * (1.0f - mu); }

// The colour of light that meets several facets of metal, as a product of one for each of both directions, so that it is the same
// either way: fills `to` and returns what is left by the way in. Fitted to walks among facets (Heitz and others 2016) are the mean
// cosine at the first and the last facet and the share `on` that stays at each between, less the more light grazes; from light along
// the surface to light head on both change as `grazing` does.
static F3 take_metal(Lobes *lobes, Vertex vertex)
{
    F alpha = mean_alpha(vertex);
    F low = alpha * (1.1175f + alpha * (0.8215f * alpha - 1.635f));
    F3 flat = reflected_by_metal(vertex, low);
    F3 steep = reflected_by_metal(vertex, low + 0.32f - 0.07f * alpha);
    F on = 0.05f + alpha * (0.2f + 0.11f * alpha);
    F3 between = along(steep, sub(flat, steep), 0.25f);
    F3 go = sub(WHITE_3, scale(between, on));
    F3 others = f3(go.y * go.z, go.z * go.x, go.x * go.y);
    F3 over = scale(others, 1.0f / (go.x * others.x));
    F3 less = scale(mul(sub(between, WHITE_3), over), on / (1.0f - on));
    lobes->to = mul(steep, along(WHITE_3, less, 0.25f));
    lobes->to_rise = sub(mul(flat, along(WHITE_3, less, -0.9f)), lobes->to);
    F3 first = along(lobes->to, lobes->to_rise, grazing(lobes->wi.z));
    return scale(mul(first, over), 1.0f - on);
}
#endif

// All that leaves evenly. The diffuse base (Kelemen and Szirmay-Kalos 2001): rho (1 - E(wi)) (1 - E(wo)) / (pi (1 - mean of E)) is
// symmetric, and with rho = 1 gives back all that the cover does not. The same of what meets further facets of metal (Kulla and
// Conty 2017). `over` is the share that a coat reflects. Returns about the albedo of all these lobes.
static F add_base(Lobes *lobes, Vertex vertex, F over)
{
    F others = ONE, own = ZERO, once = ONE;
    Shares of = shares_of(vertex, lobes->wi);
#if HAS_METAL_AGAIN
    I metal = is_metal(vertex);
    F share_of_metal = metal ? ONE : ZERO;
#if HAS_METALLIC
    share_of_metal = vertex.kind == MATERIAL_PRINCIPLED ? vertex.closure.metallic : share_of_metal;
#endif
    F3 from = take_metal(lobes, vertex);
    F even = share_even(vertex);
    lobes->sharp = 1.0f - even;
    even *= share_of_metal;
    lobes->from = scale(from, even * of.again * of.over_again);
    own = max3(mul(from, lobes->to)) * even * of.again;
    once = lobes->once = 1.0f - of.again;
    others = metal ? max3(lobes->to) * once : others;
#endif
#if HAS_COVERED_BASE
    F3 rho = f3(ZERO, ZERO, ZERO);
    F share = of.cover;
#if HAS_ROUGH_PLASTIC
    I plastic = vertex.kind == MATERIAL_ROUGH_PLASTIC;
    rho = keep3(plastic, lit_from_below(vertex.color, vertex.closure.internal));
    others = plastic ? share : others;
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
        F rest = (1.0f - metallic) * (share + (1.0f - share) * clear) + metallic * max3(vertex.color) * once;
        rho = select3(principled, scale(vertex.color, (1.0f - metallic) * (1.0f - clear)), rho);
        others = principled ? rest : others;
    }
#endif
    F whole = 1.0f - of.cover_mean;
    lobes->base = scale(rho, (1.0f - share) / MAX(whole, (F)(1e-6f)));
    own += max3(lobes->base) * whole;
#endif
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
    lobes->sent_mean = max3(lobes->fibres) * vertex.closure.sheen_mean;
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

#if HAS_AGAIN
// Of `wo`, on whichever side it leaves, the share that meets further facets of glass.
IN_PLACE static F again_beyond(Vertex vertex, Lobes lobes, F3 wo)
{
    Entry entry = entry_of(stretched(wo.z, wo.x, vertex.closure.alpha), TURNS_OF(vertex.closure.glass));
    return glass_again(vertex.scene.facet_shares, vertex.closure.glass, lobes.behind ^ (wo.z < 0.0f), entry);
}

// What light from `wi` leaves to further facets of glass, which send it to both sides as metal does to one (Kulla and Conty 2017).
// It takes the colour of reflections beside that of light scattered once, as mostly one facet refracts and another reflects.
IN_PLACE static void take_glass(Lobes *lobes, Vertex vertex, I behind)
{
    const __global float *table = vertex.scene.facet_shares;
    Glass glass = vertex.closure.glass;
    I known = lobes->clear & (glass.table > 0);
    F clear = ONE;
    F3 reflected = WHITE_3, passed = WHITE_3;
#if HAS_TRANSMISSION
    I principled = vertex.kind == MATERIAL_PRINCIPLED;
    clear = principled ? vertex.closure.transmission * (1.0f - vertex.closure.metallic) : clear;
    passed = select3(principled, vertex.color, passed);
#endif
    lobes->stain = WHITE_3;
#if HAS_STAIN
    I tinted = vertex.kind == MATERIAL_ROUGH_DIELECTRIC;
    F once = behind ? vertex.closure.once_inside : vertex.closure.once_outside;
    lobes->stain = select3(tinted, colour_again(vertex.color, 1.0f - once), lobes->stain);
    reflected = select3(tinted, mul(vertex.color, lobes->stain), reflected);
    passed = select3(tinted, mul(vertex.closure.passed, lobes->stain), passed);
#endif
    lobes->behind = behind;
    lobes->glass_again = known ? again_beyond(vertex, *lobes, lobes->wi) : ZERO;
    F even = share_even(vertex);
    lobes->sharp_glass = 1.0f - even;
    lobes->wide = clear * even * lobes->glass_again;
    I own = behind ? (I)(1) : FALSE;
    lobes->back = glass_number(table, glass, AGAIN_BACK + own);
    F mean = glass_number(table, glass, AGAIN_MEAN + own), beyond = glass_number(table, glass, AGAIN_MEAN + 1 - own);
    lobes->wide_back = scale(reflected, lobes->back * lobes->wide / MAX(mean, (F)(1e-9f)));
    F squeezed = MAX(beyond, (F)(1e-9f)) * lobes->eta * lobes->eta;
    lobes->wide_through = scale(passed, (1.0f - lobes->back) * lobes->wide / squeezed);
    lobes->again = WHITE_3;
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
#if HAS_AGAIN
    take_glass(&lobes, vertex, behind);
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
    lobes.bare_mean = 1.0f - coat * coat_mean_albedo(alpha);
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

#if FACET_ENERGY && (HAS_SHEEN || HAS_CLEARCOAT)
// What passes a coat or a sheen both ways, the same either way, of light that what is below sends on: the layer lets pass the
// shares `in` and `out` of both directions, and `mean` of even light. Below it a mirror loses what light loses on one of its
// ways, since the other is as steep, and an even base keeps all that comes through; rough facets are between.
static F through_layer(F in, F out, F mean, F spread, F3 wo)
{
    F both = in * out;
    F passed = root(both);
    passed += spread * (both / MAX(mean, (F)(1e-3f)) - passed);
    return wo.z < 0.0f ? in : passed;
}

// By which white metal below a smooth coat gives back the most even light.
static inline F spread_of(Vertex vertex)
{
    F alpha = mean_alpha(vertex);
    return MIN(alpha * (2.9f - 1.95f * alpha), ONE);
}
#endif

// BSDF times cosine and the density of choosing `wo`, for the facet normal `h` between `wi` and `wo`.
IN_PLACE static F3 lobes_eval(Vertex vertex, Lobes lobes, F3 wo, F3 h, F *pdf)
{
    F c = MAX(dot3(lobes.wi, h), ZERO);
#if HAS_AGAIN
    F beyond = again_beyond(vertex, lobes, wo);
    F sharper = 1.0f / sqrt((1.0f - lobes.glass_again) * MAX(1.0f - beyond, (F)(0.1f))) - 1.0f;
    lobes.again = along(WHITE_3, lobes.stain, lobes.glass_again > 0.0f ? lobes.sharp_glass * sharper : ZERO);
#endif
#if HAS_BASE
    Shares of = shares_of(vertex, f3(wo.x, wo.y, MAX(wo.z, ZERO)));
#endif
    Facet facet = facet_of(vertex, lobes, c);
#if HAS_METAL_AGAIN
    F more = lobes.sharp * (1.0f / sqrt(lobes.once * MAX(1.0f - of.again, (F)(0.1f))) - 1.0f);
    facet.reflected = along(facet.reflected, mul(facet.by_metal, lobes.to), more);
#endif
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
    F bare = lobes.coat > 0.0f ? 1.0f - vertex.closure.coat * coat_albedo(absolute(coat_wo.z), lobes.coat_alpha.x) : ONE;
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
    F3 even = f3(ZERO, ZERO, ZERO);
#if HAS_BASE
    F up = MAX(wo.z, ZERO) * INV_PI_F;
#if HAS_COVERED_BASE
    even = scale(lobes.base, up * (1.0f - of.cover));
#endif
#if HAS_METAL_AGAIN
    even = along(even, mul(lobes.from, along(lobes.to, lobes.to_rise, grazing(MAX(wo.z, ZERO)))), up * of.again);
#endif
    density += lobes.under * (up - density);
#endif
#if HAS_AGAIN
    F evenly = absolute(wo.z) * INV_PI_F;
    even = along(even, select3(below, lobes.wide_through, lobes.wide_back), beyond * evenly);
#endif
#if HAS_SHEEN
    if (ANY(lobes.sent > 0.0f)) {
        F kept = sheen_share(vertex, lobes.fibres, absolute(wo.z));
#if FACET_ENERGY
        F passed = through_layer(1.0f - lobes.sent, 1.0f - kept, 1.0f - lobes.sent_mean, spread_of(vertex), wo);
        even = scale(even, through_layer(1.0f - lobes.sent, 1.0f - kept, 1.0f - lobes.sent_mean, ONE, wo));
#else
        F passed = 1.0f - MAX(lobes.sent, kept);
        even = scale(even, passed);
#endif
        sum = scale(sum, passed);
        even = along(even, lobes.fibres, sheen_reflect(vertex.closure, lobes.wi, wo, h));
        density += lobes.sheen * ((wo.z > 0.0f ? 0.5f * INV_PI_F : ZERO) - density);
    }
#endif
#if HAS_AGAIN
    density += lobes.wide * ((below ? 1.0f - lobes.back : lobes.back) * evenly - density);
#endif
#if HAS_CLEARCOAT
#if FACET_ENERGY
    F passed = through_layer(lobes.bare, bare, lobes.bare_mean, spread_of(vertex), wo);
    even = scale(even, through_layer(lobes.bare, bare, lobes.bare_mean, ONE, wo));
#else
    F passed = lobes.bare * bare;
    even = scale(even, passed);
#endif
    sum = scale(sum, passed);
    even = add(even, f3(coat, coat, coat));
#endif
    *pdf = density;
    return add(sum, even);
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

// Chooses `wo`; returns BSDF times cosine over the density, zero where nothing goes on.
static F3 facets_sample(Vertex vertex, Lobes lobes, F u, F v, F lobe, F3 *wo, F *pdf)
{
    // Choose the sheen, the base, the coat or the facets by one number.
    F3 wi = lobes.wi;
    Alpha alpha = vertex.closure.alpha;
#if HAS_AGAIN
    I wide = lobe < lobes.wide;
    I returns = lobe < lobes.back * lobes.wide;
    lobe = wide ? ONE : (lobe - lobes.wide) / (1.0f - lobes.wide);
#endif
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
#if HAS_AGAIN
    if (ANY(wide)) {
        F3 any = cosine_direction(u, v);
        any.z = returns ? any.z : -any.z;
        to = select3(wide, any, to);
        h = select3(wide, facet_normal(lobes, to), h);
        good = good | wide;
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
