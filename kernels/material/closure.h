// The closure parameters of a vertex: what its BSDF takes from the material besides kind, colour and `parameter`.
// Each is one row of CLOSURE; those that no material of the scene needs are not compiled.
#ifndef CLOSURE_H
#define CLOSURE_H
#include "common/facts.h"
#include "material/cover.h"
#include "material/texture.h"

#if HAS_ROUGH_PLASTIC || HAS_PRINCIPLED
#define HAS_COVERED_BASE 1      // diffuse light from under a rough cover
#else
#define HAS_COVERED_BASE 0
#endif
#if FACET_ENERGY && (HAS_CONDUCTOR || HAS_METAL || HAS_METALLIC)
#define HAS_METAL_AGAIN 1       // light that facets of metal reflect more than once
#else
#define HAS_METAL_AGAIN 0
#endif
#define HAS_BASE (HAS_COVERED_BASE || HAS_METAL_AGAIN)  // light that leaves in all directions
#if HAS_ROUGH_DIELECTRIC || HAS_TRANSMISSION
#define HAS_REFRACTION 1        // by facets
#else
#define HAS_REFRACTION 0
#endif
#if HAS_CONDUCTOR || HAS_METAL || HAS_ROUGH_DIELECTRIC || HAS_BASE
#define HAS_GLOSSY 1
#else
#define HAS_GLOSSY 0
#endif
#if HAS_ROUGH_PLASTIC || HAS_THIN_FILM
#define HAS_KNOWN_COVER 1       // fitted on the host
#else
#define HAS_KNOWN_COVER 0
#endif
#if HAS_PLASTIC || HAS_ROUGH_PLASTIC
#define HAS_UNDERCOVER 1        // a base under a cover of known internal reflection
#else
#define HAS_UNDERCOVER 0
#endif
#if HAS_GLASS_TINT || HAS_TRANSLUCENT
#define HAS_PASSED 1            // a colour of light that passes
#else
#define HAS_PASSED 0
#endif
#if FACET_SHARES && FACET_ENERGY && HAS_REFRACTION
#define HAS_AGAIN 1             // light that facets of glass reflect and refract more than once
#else
#define HAS_AGAIN 0
#endif
#if HAS_AGAIN && HAS_GLASS_TINT && HAS_ROUGH_DIELECTRIC
#define HAS_STAIN 1             // such light takes the colour of its reflections
#else
#define HAS_STAIN 0
#endif
#if FACET_SHARES && HAS_ANISOTROPY && (HAS_METAL_AGAIN || HAS_BRUSHED_BASE)
#define HAS_BRUSHED_SHARE 1     // light that brushed facets reflect once, by tables
#else
#define HAS_BRUSHED_SHARE 0
#endif
#define HAS_LAMPS       (HAS_EMISSIVE || HAS_GLOW)
#define HAS_CLOSURE     (HAS_GLOSSY || HAS_PLASTIC || HAS_THIN_GLASS || HAS_PASSED || HAS_ABSORPTION || HAS_GLOW || HAS_HAIR || HAS_ENTRIES || HAS_MEASURED) // any row below

#include "material/ggx.h"
#include "material/facet_shares.h"

#define SMALLEST_ALPHA  1e-3f       // what float32 still resolves about a highlight

#define BLACK_3 f3(ZERO, ZERO, ZERO)
#define WHITE_3 f3(ONE, ONE, ONE)

// What a material says at texture coordinates: by the texture that replaces a number, an alpha or a colour, where it has one.
// The fact says whether any material of the scene does.
#define BY_TEXTURE(fact, texture, read, value) WHEN(fact, material->texture >= 0 ? (read) :) (value)
#define NUMBER(fact, name) \
    BY_TEXTURE(fact, name##_texture, texture_scalar(material->name##_texture, u, v, scene), (F)(material->name))
#define ALPHA(fact, name) \
    BY_TEXTURE(fact, name##_roughness_texture, squared_roughness(material->name##_roughness_texture, u, v, scene), \
               (F)(material->name##_alpha))
#define COLOR(fact, name) \
    BY_TEXTURE(fact, name##_texture, \
               at_wavelengths(texture_color(material->name##_texture, u, v, scene), material->name.w, scene), \
               coefficient(material->name, scene))

// EACH(type, member, value of lanes without a material, value that a material gives).
#define CLOSURE(EACH) \
    WHEN(HAS_GLOSSY,       EACH(Alpha, alpha,        same_alpha(ONE),  alpha_of(material, u, v, scene))) \
    WHEN(HAS_METAL,        EACH(F3,    n,            WHITE_3,          coefficient(material->metal_n, scene))) /* n + ik */ \
    WHEN(HAS_METAL,        EACH(F3,    k,            WHITE_3,          coefficient(material->metal_k, scene))) \
    WHEN(HAS_AGAIN,        EACH(Glass, glass,        no_glass(),       glass_of(material, closure->alpha))) /* tables of rough glass */ \
    WHEN(HAS_STAIN,        EACH(F,     once_outside, ONE,              (F)(material->once.x))) /* share scattered once */ \
    WHEN(HAS_STAIN,        EACH(F,     once_inside,  ONE,              (F)(material->once.y))) \
    WHEN(HAS_BRUSHED_SHARE, EACH(I,    brushed_table, FALSE,           (I)(material->brushed_table))) \
    WHEN(HAS_BRUSHED_SHARE, EACH(I,    brushed_alphas, FALSE,          (I)(material->brushed_alphas))) \
    WHEN(HAS_UNDERCOVER,   EACH(F,     internal,     ZERO,             (F)(material->internal))) /* diffuse share */ \
    WHEN(HAS_KNOWN_COVER,  EACH(Cover, cover,        no_cover(), known_cover(material->cover, material->cover_last))) \
    WHEN(HAS_HAIR,         EACH(F,     across,       ZERO,             ZERO)) /* of a fibre, -1 to 1, by the point */ \
    WHEN(HAS_HAIR,         EACH(F,     hair_variance, ONE,             (F)(material->hair.x))) \
    WHEN(HAS_HAIR,         EACH(F,     hair_scale,   ONE,              (F)(material->hair.y))) \
    WHEN(HAS_HAIR,         EACH(F,     hair_tilt,    ZERO,             (F)(material->hair.z))) \
    WHEN(HAS_HAIR,         EACH(F,     hair_depth,   ONE,              (F)(material->hair.w))) \
    WHEN(HAS_MEASURED,     EACH(I,     measured,     FALSE,            (I)(material->first))) /* where its table starts */ \
    WHEN(HAS_MEASURED,     EACH(F,     measured_alpha, ONE,            (F)(material->alpha))) \
    WHEN(HAS_MEASURED,     EACH(F,     measured_gloss, ZERO,           (F)(material->factor))) \
    WHEN(HAS_THIN_GLASS,   EACH(F3,    depth,        BLACK_3,          coefficient(material->absorption, scene))) \
    WHEN(HAS_PASSED,       EACH(F3,    passed,       WHITE_3,          COLOR(HAS_PASSED_TEXTURE, passed))) \
    WHEN(HAS_ENTRIES,      EACH(F3,    inside,       WHITE_3,          COLOR(HAS_ENTRIES, inside))) /* of its medium, deep */ \
    WHEN(HAS_PRINCIPLED,   EACH(F,     metallic,     ZERO,             NUMBER(HAS_METALLIC_TEXTURE, metallic))) \
    WHEN(HAS_PRINCIPLED,   EACH(F,     specular,     ZERO,             NUMBER(HAS_SPECULAR_TEXTURE, specular))) \
    WHEN(HAS_THIN_FILM,    EACH(I,     film,         FALSE,            film_of(material))) /* where its table starts, and 1 */ \
    WHEN(HAS_SPECULAR_COLOR, EACH(F3,  specular_color, WHITE_3,        COLOR(HAS_SPECULAR_COLOR_TEXTURE, specular_color))) \
    WHEN(HAS_TRANSMISSION, EACH(F,     transmission, ZERO,             NUMBER(HAS_TRANSMISSION_TEXTURE, transmission))) \
    WHEN(HAS_CLEARCOAT,    EACH(F,     coat,         ZERO,             NUMBER(HAS_COAT_TEXTURE, coat))) \
    WHEN(HAS_CLEARCOAT,    EACH(F,     coat_alpha,   ONE,              ALPHA(HAS_COAT_ROUGHNESS_TEXTURE, coat))) \
    WHEN(HAS_SHEEN,        EACH(F3,    sheen,        BLACK_3,          COLOR(HAS_SHEEN_TEXTURE, sheen))) \
    WHEN(HAS_SHEEN,        EACH(F,     sheen_alpha,  ONE,              (F)(material->sheen_alpha))) \
    WHEN(HAS_SHEEN,        EACH(F,     sheen_peak,   ZERO,             (F)(material->sheen_peak))) \
    WHEN(HAS_SHEEN,        EACH(F,     sheen_mean,   ZERO,             (F)(material->once.z))) /* share of even light sent back */ \
    WHEN(HAS_SHEEN,        EACH(F,     sheen_half,   ZERO,             (F)(material->sheen_half))) \
    WHEN(HAS_SHEEN,        EACH(Cover, sheen_cover,  no_cover(),       known_cover(material->sheen_cover, material->sheen_last))) \
    WHEN(HAS_ABSORPTION,   EACH(F3,    absorption,   BLACK_3,          absorption_of(material, scene))) /* 1/m */ \
    WHEN(HAS_GLOW_BEHIND,  EACH(I,     glow_behind,  FALSE,            (I)(material->glow_behind ? -1 : 0))) \
    WHEN(HAS_GLOW,         EACH(F3,    glow,         BLACK_3,          glow_of(material, u, v, scene)))  /* own radiance */

// A coefficient or colour at the wavelengths of the path, by the number of its spectrum.
static inline F3 at_wavelengths(F3 rgb, float spectrum, Scene scene)
{
#if SPECTRAL_COLOURS
    return surface_colour(scene.spectral, rgb, spectrum, scene.colours);
#else
    return rgb;
#endif
}

static inline F3 coefficient(float4 rgb, Scene scene) { return at_wavelengths(f3_of(rgb), rgb.w, scene); }

#if HAS_ABSORPTION
// Coefficient of what lies behind the surface: behind a pane lies what is before it.
static inline F3 absorption_of(const __global Material *material, Scene scene)
{
    return material->kind == MATERIAL_THIN_GLASS ? BLACK_3 : coefficient(material->absorption, scene);
}
#endif

#if HAS_ROUGHNESS_TEXTURE || HAS_COAT_ROUGHNESS_TEXTURE
// Alpha where a texture gives the roughness, its root.
static inline F squared_roughness(int texture, F u, F v, Scene scene)
{
    F roughness = texture_scalar(texture, u, v, scene);
    return MAX(roughness * roughness, (F)(SMALLEST_ALPHA));
}
#endif

#if HAS_THIN_FILM
static inline I film_of(const __global Material *material)
{
    return (I)(material->kind == MATERIAL_PRINCIPLED ? material->first : 0);
}
#endif

#if HAS_GLOSSY
static Alpha alpha_of(const __global Material *material, F u, F v, Scene scene)
{
    F stretch = ONE;
#if HAS_ROUGHNESS_TEXTURE
    if (material->roughness_texture >= 0)
        stretch = squared_roughness(material->roughness_texture, u, v, scene);
#endif
    Alpha alpha;
    alpha.x = material->alpha * stretch;
#if HAS_ANISOTROPY
    alpha.y = MAX(material->alpha_across * stretch, (F)(SMALLEST_ALPHA));
#endif
    return alpha;
}
#endif

#if HAS_AGAIN
static Glass glass_of(const __global Material *material, Alpha alpha)
{
    Glass glass;
    glass.table = (I)(material->share_levels > 0 ? material->share_table : 0);
#if HAS_ROUGHNESS_TEXTURE
    glass.levels = (I)(MAX(material->share_levels, 1));
    glass.level = ACROSS(alpha) / (material->alpha_across > 0.0f ? material->alpha_across : 1.0f);
#endif
#if HAS_ANISOTROPY
    glass.turns = (I)(MAX(material->share_turns, 1));
#endif
    return glass;
}
#endif

#if HAS_KNOWN_COVER || HAS_SHEEN
static inline Cover known_cover(float4 first, float last)
{
    Cover e;
    e.c0 = (F)(first.x);
    e.c1 = (F)(first.y);
    e.c2 = (F)(first.z);
    e.c3 = (F)(first.w);
    e.c4 = (F)(last);
    return e;
}
#endif

#if HAS_GLOW_BEHIND
#define GLOWS(vertex, front) (((front) > 0.0f) | (vertex).closure.glow_behind)
#else
#define GLOWS(vertex, front) ((front) > 0.0f)
#endif

#if HAS_GLOW
static inline F3 glow_of(const __global Material *material, F u, F v, Scene scene)
{
    F3 glow = f3_of(material->glow);
#if HAS_TEXTURE
    if (material->glow_texture >= 0)
        glow = texture_color(material->glow_texture, u, v, scene);
#endif
#if SPECTRAL_COLOURS
    glow = light_colour(scene.spectral, glow, material->glow.w, scene.colours);
#endif
    return glow;
}
#endif

#if HAS_CLOSURE
#define select_F(mine, a, b) ((mine) ? (a) : (b))
#define select_I(mine, a, b) ((mine) ? (a) : (b))
#define select_F3            select3

#define AS_CLOSURE_MEMBER(type, member, without, given) type member;
#define AS_EMPTY_MEMBER(type, member, without, given)   closure.member = without;
#define AS_TAKEN_MEMBER(type, member, without, given)   closure->member = select_##type(mine, given, closure->member);

typedef struct {
    CLOSURE(AS_CLOSURE_MEMBER)
} Closure;

static inline Closure empty_closure(void)
{
    Closure closure;
    CLOSURE(AS_EMPTY_MEMBER)
    return closure;
}

// Fills the lanes `mine`, which share a material, at texture coordinates.
static inline void take_closure(Closure *closure, I mine, const __global Material *material, F u, F v, Scene scene)
{
    CLOSURE(AS_TAKEN_MEMBER)
}
#endif

#endif
