// The closure parameters of a vertex: what its BSDF takes from the material besides kind, colour and `parameter`.
// Each is one row of CLOSURE; those that no material of the scene needs are not compiled.
#ifndef CLOSURE_H
#define CLOSURE_H
#include "common/facts.h"
#include "material/cover.h"
#include "material/texture.h"

#if HAS_ROUGH_PLASTIC || HAS_PRINCIPLED
#define HAS_BASE 1              // diffuse light from under a rough cover
#else
#define HAS_BASE 0
#endif
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
#if HAS_PLASTIC || HAS_ROUGH_PLASTIC
#define HAS_UNDERCOVER 1        // a base under a cover of known internal reflection
#else
#define HAS_UNDERCOVER 0
#endif
#define HAS_LAMPS       (HAS_EMISSIVE || HAS_GLOW)
#define HAS_CLOSURE     (HAS_GLOSSY || HAS_PLASTIC || HAS_THIN_GLASS || HAS_ABSORPTION || HAS_GLOW)   // any row below

#include "material/ggx.h"

#define SMALLEST_ALPHA  1e-3f       // what float32 still resolves about a highlight

#define BLACK_3 f3(ZERO, ZERO, ZERO)
#define WHITE_3 f3(ONE, ONE, ONE)

// EACH(type, member, value of lanes without a material, value that a material gives).
#define CLOSURE(EACH) \
    WHEN(HAS_GLOSSY,       EACH(Alpha, alpha,        same_alpha(ONE),  alpha_of(material, u, v, scene))) \
    WHEN(HAS_METAL,        EACH(F3,    n,            WHITE_3,          coefficient(material->metal_n, scene))) /* n + ik */ \
    WHEN(HAS_METAL,        EACH(F3,    k,            WHITE_3,          coefficient(material->metal_k, scene))) \
    WHEN(HAS_UNDERCOVER,   EACH(F,     internal,     ZERO,             (F)(material->internal))) /* diffuse share */ \
    WHEN(HAS_ROUGH_PLASTIC, EACH(Cover, cover,       no_cover(),       known_cover(material->cover, material->cover_last))) \
    WHEN(HAS_THIN_GLASS,   EACH(F3,    depth,        BLACK_3,          coefficient(material->absorption, scene))) \
    WHEN(HAS_PRINCIPLED,   EACH(F,     metallic,     ZERO,             metallic_of(material, u, v, scene))) \
    WHEN(HAS_PRINCIPLED,   EACH(F,     specular,     ZERO,             (F)(material->specular))) \
    WHEN(HAS_TRANSMISSION, EACH(F,     transmission, ZERO,             (F)(material->transmission))) \
    WHEN(HAS_CLEARCOAT,    EACH(F,     coat,         ZERO,             coat_of(material, u, v, scene))) \
    WHEN(HAS_CLEARCOAT,    EACH(F,     coat_alpha,   ONE,              coat_alpha_of(material, u, v, scene))) \
    WHEN(HAS_SHEEN,        EACH(F3,    sheen,        BLACK_3,          sheen_of(material, u, v, scene))) \
    WHEN(HAS_SHEEN,        EACH(F,     sheen_alpha,  ONE,              (F)(material->sheen_alpha))) \
    WHEN(HAS_SHEEN,        EACH(F,     sheen_peak,   ZERO,             (F)(material->sheen_peak))) \
    WHEN(HAS_SHEEN,        EACH(F,     sheen_half,   ZERO,             (F)(material->sheen_half))) \
    WHEN(HAS_SHEEN,        EACH(Cover, sheen_cover,  no_cover(),       known_cover(material->sheen_cover, material->sheen_last))) \
    WHEN(HAS_ABSORPTION,   EACH(F3,    absorption,   BLACK_3,          coefficient(material->absorption, scene))) /* 1/m */ \
    WHEN(HAS_GLOW,         EACH(F3,    glow,         BLACK_3,          glow_of(material, u, v, scene)))  /* own radiance */

// A coefficient at the wavelengths of the path; w is the number of its spectrum.
static inline F3 coefficient(float4 rgb, Scene scene)
{
#if SPECTRAL_COLOURS
    return surface_colour(scene.spectral, f3_of(rgb), rgb.w, scene.colours);
#else
    return f3_of(rgb);
#endif
}

#if HAS_ROUGHNESS_TEXTURE || HAS_COAT_ROUGHNESS_TEXTURE
// Alpha where a texture gives the roughness, its root.
static inline F squared_roughness(int texture, F u, F v, Scene scene)
{
    F roughness = texture_scalar(texture, u, v, scene);
    return MAX(roughness * roughness, (F)(SMALLEST_ALPHA));
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

#if HAS_ROUGH_PLASTIC || HAS_SHEEN
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

#if HAS_PRINCIPLED
static inline F metallic_of(const __global Material *material, F u, F v, Scene scene)
{
#if HAS_METALLIC_TEXTURE
    if (material->metallic_texture >= 0)
        return texture_scalar(material->metallic_texture, u, v, scene);
#endif
    return (F)(material->metallic);
}
#endif

#if HAS_CLEARCOAT
static inline F coat_of(const __global Material *material, F u, F v, Scene scene)
{
#if HAS_COAT_TEXTURE
    if (material->coat_texture >= 0)
        return texture_scalar(material->coat_texture, u, v, scene);
#endif
    return (F)(material->coat);
}

static inline F coat_alpha_of(const __global Material *material, F u, F v, Scene scene)
{
#if HAS_COAT_ROUGHNESS_TEXTURE
    if (material->coat_roughness_texture >= 0)
        return squared_roughness(material->coat_roughness_texture, u, v, scene);
#endif
    return (F)(material->coat_alpha);
}
#endif

#if HAS_SHEEN
static inline F3 sheen_of(const __global Material *material, F u, F v, Scene scene)
{
    float4 sheen = material->sheen;
#if HAS_SHEEN_TEXTURE
    if (material->sheen_texture >= 0) {
        F3 color = texture_color(material->sheen_texture, u, v, scene);
#if SPECTRAL_COLOURS
        color = surface_colour(scene.spectral, color, sheen.w, scene.colours);
#endif
        return color;
    }
#endif
    return coefficient(sheen, scene);
}
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
