// Surfaces with holes: whether a ray finds one there. A mask is there from its cutoff on; otherwise the ray passes with the
// probability that the opacity leaves. The choice depends only on the bits of the ray and on what it meets, so it is the
// same however often and in whatever order the surface is tested.
#ifndef OPACITY_H
#define OPACITY_H
#include "common/rng.h"
#include "material/texture.h"

static inline int has_holes(const __global Material *material)
{
    return material->opacity < 1.0f || material->opacity_texture >= 0;
}

static inline F ray_chance(F3 o, F3 d, I primitive, I triangle)
{
#ifdef CHANCE_OF_ALL_RAYS
    return (F)(CHANCE_OF_ALL_RAYS);
#else
    U4 h = hash4(AS_U(d.x) ^ AS_U(primitive) * 0x9e3779b9u, AS_U(d.y) ^ AS_U(triangle) * 0x85ebca6bu, AS_U(d.z),
                 (uint2)(0u, 0u));
    h = hash4(AS_U(o.x) ^ h.a, AS_U(o.y) ^ h.b, AS_U(o.z) ^ h.c, (uint2)(1u, 0u));
    return unit_float(h.a);
#endif
}

static inline I is_there(const __global Material *material, F u, F v, F chance, Scene scene)
{
    F opacity = (F)(material->opacity);
#if HAS_TEXTURE
    if (material->opacity_texture >= 0)
        opacity = texture_scalar(material->opacity_texture, u, v, scene);
#endif
    return material->cutoff > 0.0f ? opacity >= material->cutoff : chance < opacity;
}

#endif
