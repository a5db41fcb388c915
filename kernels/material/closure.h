// What a vertex is made of besides its kind and colour. Members that no material of the scene needs are not there.
#ifndef CLOSURE_H
#define CLOSURE_H
#include "material/cover.h"
#include "material/texture.h"

#define HAS_BASE        (HAS_ROUGH_PLASTIC || HAS_PRINCIPLED)         // diffuse light from under a rough cover
#define HAS_REFRACTION  (HAS_ROUGH_DIELECTRIC || HAS_TRANSMISSION)    // by facets
#define HAS_GLOSSY      (HAS_CONDUCTOR || HAS_METAL || HAS_ROUGH_DIELECTRIC || HAS_BASE)
#define HAS_LAMPS       (HAS_EMISSIVE || HAS_GLOW)
#define HAS_CLOSURE      (HAS_GLOSSY || HAS_PLASTIC || HAS_THIN_GLASS || HAS_ABSORPTION || HAS_GLOW)

#include "material/ggx.h"

#define SMALLEST_ALPHA  1e-3f       // what float32 still resolves about a highlight

typedef struct {
#if HAS_GLOSSY
    Alpha alpha;
#endif
#if HAS_METAL
    F3 n, k;            // refractive index n + i k
#endif
#if HAS_PLASTIC || HAS_ROUGH_PLASTIC
    F  internal;        // share of diffuse light that the cover sends back down
#endif
#if HAS_ROUGH_PLASTIC
    Cover cover;
#endif
#if HAS_THIN_GLASS
    F3 depth;           // optical depth of the pane at normal incidence
#endif
#if HAS_PRINCIPLED
    F  metallic, specular;
#endif
#if HAS_TRANSMISSION
    F  transmission;
#endif
#if HAS_CLEARCOAT
    F  coat, coat_alpha;
#endif
#if HAS_ABSORPTION
    F3 absorption;      // [1/m] behind the surface
#endif
#if HAS_GLOW
    F3 glow;            // radiance that a surface emits besides what it scatters
#endif
} Closure;

#define TAKE(member, value)   (closure->member = mine ? (F)(value) : closure->member)
#if SPECTRAL_COLOURS
#define TAKE_COLOUR(member, rgb, number) \
    (closure->member = select3(mine, surface_colour(scene.spectral, rgb, number, scene.colours), closure->member))
#else
#define TAKE_COLOUR(member, rgb, number) (closure->member = select3(mine, rgb, closure->member))
#endif

static Closure empty_closure(void)
{
    Closure closure;
#if HAS_GLOSSY
    closure.alpha.x = ONE;
#endif
#if HAS_ANISOTROPY
    closure.alpha.y = ONE;
#endif
#if HAS_METAL
    closure.n = closure.k = f3(ONE, ONE, ONE);
#endif
#if HAS_PLASTIC || HAS_ROUGH_PLASTIC
    closure.internal = ZERO;
#endif
#if HAS_ROUGH_PLASTIC
    closure.cover.c0 = closure.cover.c1 = closure.cover.c2 = closure.cover.c3 = closure.cover.c4 = ZERO;
#endif
#if HAS_THIN_GLASS
    closure.depth = f3(ZERO, ZERO, ZERO);
#endif
#if HAS_PRINCIPLED
    closure.metallic = closure.specular = ZERO;
#endif
#if HAS_TRANSMISSION
    closure.transmission = ZERO;
#endif
#if HAS_CLEARCOAT
    closure.coat = ZERO;
    closure.coat_alpha = ONE;
#endif
#if HAS_ABSORPTION
    closure.absorption = f3(ZERO, ZERO, ZERO);
#endif
#if HAS_GLOW
    closure.glow = f3(ZERO, ZERO, ZERO);
#endif
    return closure;
}

// Fills the lanes `mine`, which share a material, at texture coordinates.
static void take_closure(Closure *closure, I mine, const __global Material *material, F u, F v, Scene scene)
{
#if HAS_GLOSSY
    F stretch = ONE;
#if HAS_ROUGHNESS_TEXTURE
    if (material->roughness_texture >= 0) {
        F roughness = texture_scalar(material->roughness_texture, u, v, scene);
        stretch = MAX(roughness * roughness, (F)(SMALLEST_ALPHA));
    }
#endif
    TAKE(alpha.x, material->alpha * stretch);
#endif
#if HAS_ANISOTROPY
    TAKE(alpha.y, MAX(material->alpha_across * stretch, (F)(SMALLEST_ALPHA)));
#endif
#if HAS_METAL
    TAKE_COLOUR(n, f3_of(material->metal_n), material->metal_n.w);
    TAKE_COLOUR(k, f3_of(material->metal_k), material->metal_k.w);
#endif
#if HAS_PLASTIC || HAS_ROUGH_PLASTIC
    TAKE(internal, material->internal);
#endif
#if HAS_ROUGH_PLASTIC
    TAKE(cover.c0, material->cover.x);
    TAKE(cover.c1, material->cover.y);
    TAKE(cover.c2, material->cover.z);
    TAKE(cover.c3, material->cover.w);
    TAKE(cover.c4, material->cover_last);
#endif
#if HAS_THIN_GLASS
    TAKE_COLOUR(depth, f3_of(material->absorption), material->absorption.w);
#endif
#if HAS_PRINCIPLED
    F metallic = (F)(material->metallic);
#if HAS_METALLIC_TEXTURE
    if (material->metallic_texture >= 0)
        metallic = texture_scalar(material->metallic_texture, u, v, scene);
#endif
    TAKE(metallic, metallic);
    TAKE(specular, material->specular);
#endif
#if HAS_TRANSMISSION
    TAKE(transmission, material->transmission);
#endif
#if HAS_CLEARCOAT
    TAKE(coat, material->coat);
    TAKE(coat_alpha, material->coat_alpha);
#endif
#if HAS_ABSORPTION
    TAKE_COLOUR(absorption, f3_of(material->absorption), material->absorption.w);
#endif
#if HAS_GLOW
    F3 glow = f3_of(material->glow);
#if HAS_TEXTURE
    if (material->glow_texture >= 0)
        glow = texture_color(material->glow_texture, u, v, scene);
#endif
#if SPECTRAL_COLOURS
    glow = light_colour(scene.spectral, glow, material->glow.w, scene.colours);
#endif
    closure->glow = select3(mine, glow, closure->glow);
#endif
}

#endif
