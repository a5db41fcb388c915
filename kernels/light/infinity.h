// What arrives from infinity: the environment and the disks of suns.
#ifndef INFINITY_H
#define INFINITY_H
#include "light/environment.h"
#include "light/groups.h"
#include "light/emitter.h"
#if LIGHT_TREE
#include "light/light_tree.h"
#endif

#define EVERY_GROUP (-1)

// Where a path was scattered last, but for clear glass behind which light samples look for lamps: what a light sample may have
// done as well.
typedef struct {
    F3 o, d;        // the way it took
    F  pdf;         // its density; 0: light sampling cannot compete
} Departure;

// MIS weight (power heuristic, Veach 1997, ch. 9) of a direction of density `own` that light sampling would have chosen with
// density `other`; own is 0 where light sampling cannot compete. Where rays of one kind meet what those of the other pass, light
// sampling alone counts.
static inline F against_lights(F own, F other)
{
#if LAMPS_BY_SAMPLES
    return ((own > 0.0f) & (other > 0.0f)) ? ZERO : ONE;
#else
    F own2 = own * own;
    return own > 0.0f ? own2 / (own2 + other * other) : ONE;
#endif
}

// Probability with which light sampling picks an emitter at infinity, at p on a surface.
static inline F pick_from_afar(int e, F3 p, Receiver receiver, Scene scene)
{
#if LIGHT_TREE
    return pick_of_distant(scene, e, p, receiver);
#else
    return (F)(scene.emitters[e].pick);
#endif
}

#if EMITTER_SUNS
static inline float versine_of(const __global Emitter *sun) { return sun->a.w / (1.0f + sqrt(1.0f - sun->a.w)); }

// Lanes whose direction meets the disk of a sun: 1 - cos of its radius is a.w, the squared sine, over 1 + cos.
static inline I meets_sun(const __global Emitter *sun, F3 d)
{
    F3 off = sub(d, f3_of(sun->normal));
    return dot3(off, off) <= 2.0f * versine_of(sun);
}

static inline F3 sun_radiance(const __global Emitter *sun, Scene scene)
{
#if SPECTRAL_COLOURS
    return light_colour(scene.spectral, f3_of(sun->radiance), sun->radiance.w, scene.colours);
#else
    return f3_of(sun->radiance);
#endif
}

// Of suns whose disk a direction meets, weighted; `kind` says what a ray is, one of HIDDEN_…; of one group or of EVERY_GROUP.
static F3 suns_radiance(Departure from, Receiver receiver, F3 d, I kind, int group, Scene scene)
{
    F3 sum = f3(ZERO, ZERO, ZERO);
    int first = scene.environment->first_sun;
    for (int i = first; i < first + scene.environment->suns; ++i) {
        const __global Emitter *sun = scene.emitters + i;
#if LIGHT_GROUPS
        if (group != EVERY_GROUP && group != scene.emitter_groups[i])
            continue;
#endif
        I inside = meets_sun(sun, d);
#if HIDDEN_SUNS
        inside = inside & ((kind & sun->hidden) == 0);
#endif
        if (ANY(inside)) {
            F other = pick_from_afar(i, from.o, receiver, scene) / (2.0f * PI_F * versine_of(sun));
#if LAMPS_BEHIND_GLASS
            other = meets_sun(sun, from.d) ? other : ZERO;
#endif
            sum = add(sum, keep3(inside, scale(sun_radiance(sun, scene), against_lights(from.pdf, other))));
        }
    }
    return sum;
}
#endif

// Radiance that a path meets which leaves the scene along d, weighted against light sampling where it comes from; without suns
// in the lanes `sunless`; `sun_rival` is the density that competes with light samples of suns. `kind` says what a ray is, one of
// HIDDEN_…. Of one group or of EVERY_GROUP.
static inline F3 light_from_infinity(Departure from, F sun_rival, Receiver receiver, F3 d, I sunless, I kind, int group,
                                     Scene scene)
{
    F3 sum = f3(ZERO, ZERO, ZERO);
#if ENVIRONMENT
    sum = environment_radiance(d, scene);
#endif
#if ENVIRONMENT_SAMPLED
    F pick = pick_from_afar(scene.environment->emitter, from.o, receiver, scene);
    sum = scale(sum, against_lights(from.pdf, environment_pdf(from.d, scene) * pick));
#endif
#if ENVIRONMENT && LIGHT_GROUPS
    sum = keep3((I)(group == EVERY_GROUP || group == scene.sky_group ? -1 : 0), sum);
#endif
#if HIDDEN_SKY
    sum = keep3(kind != HIDDEN_FROM_CAMERA, sum);
#endif
#if EMITTER_SUNS
    from.pdf = sun_rival;
#if CAUSTICS
    sum = add(sum, keep3(NOT(sunless), suns_radiance(from, receiver, d, kind, group, scene)));
#else
    sum = add(sum, suns_radiance(from, receiver, d, kind, group, scene));
#endif
#endif
    return sum;
}

#endif
