// How lamps without size shine in directions: spots that fade at the edge of their cone, and measured luminaires.
#ifndef POINT_H
#define POINT_H
#include "common/angles.h"
#include "light/emitter.h"
#include "material/image.h"

#if EMITTER_SPOTS
// Share of the intensity on the axis towards a point that sees the lamp in direction `to`: a smooth step in the cosine. u.w
// is 1 - cos of the cone, v.w what its fading part takes of it, inverted.
static inline F spot_share(const __global Emitter *es, I e, F3 to)
{
    F3 off = f3(to.x + OF_EMITTER(F, normal.x), to.y + OF_EMITTER(F, normal.y), to.z + OF_EMITTER(F, normal.z));
    F x = (OF_EMITTER(F, u.w) - 0.5f * dot3(off, off)) * OF_EMITTER(F, v.w);
    x = MIN(MAX(x, ZERO), ONE);
    return x * x * (3.0f - 2.0f * x);
}
#endif

#if EMITTER_PROFILES
// Intensity of measured lamps: a picture over the turns about the axis and the angle from it. Lanes are taken lamp by lamp.
static F profile_intensity(Scene scene, I e, I mine, F3 to)
{
    F value = ZERO;
    while (ANY(mine)) {
        int index = first_of(e, mine);
        I now = mine & (e == index);
        const __global Emitter *lamp = scene.emitters + index;
        F x = -dot3(to, f3_of(lamp->u));
        F y = -dot3(to, f3_of(lamp->v));
        F angle = share_upwards(dot3(to, f3_of(lamp->normal)), sqrt(x * x + y * y));
        const __global Texture *t = scene.textures + lamp->texture;
        value = now ? image_at(t, scene.texels, turns_around(x, y), angle).x * t->a.x : value;
        mine = mine & NOT(now);
    }
    return value;
}
#endif

#if EMITTER_SIZELESS
// Weight of lamps without size at the squared distance d2.
static void sample_point(Scene scene, I e, F pick, I kind, F d2, LightSample *s, F *weight)
{
    const __global Emitter *es = scene.emitters;
#if EMITTER_POINTS
    I point = kind == EMITTER_POINT;
    *weight = point ? ONE / (d2 * pick) : *weight;
#endif
#if EMITTER_SPOTS
    I spot = kind == EMITTER_SPOT;
    if (ANY(spot))
        *weight = spot ? spot_share(es, e, s->direction) / (d2 * pick) : *weight;
#endif
#if EMITTER_PROFILES
    I measured = kind == EMITTER_PROFILE;
    if (ANY(measured))
        *weight = measured ? profile_intensity(scene, e, measured, s->direction) / (d2 * pick) : *weight;
#endif
}
#endif

#endif
