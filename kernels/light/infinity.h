// What arrives from infinity: the environment and the disks of suns.
#ifndef INFINITY_H
#define INFINITY_H
#include "light/environment.h"

// MIS weight (power heuristic, Veach 1997, ch. 9) of a direction of density `own` that light sampling would have chosen with
// density `other`; own is 0 where light sampling cannot compete.
static F against_lights(F own, F other)
{
    F own2 = own * own;
    return own > 0.0f ? own2 / (own2 + other * other) : ONE;
}

#if EMITTER_SUNS
// Of suns whose disk a direction meets, weighted.
static F3 suns_radiance(F3 d, F own, Scene scene)
{
    F3 sum = f3(ZERO, ZERO, ZERO);
    int first = scene.environment->first_sun;
    for (int i = first; i < first + scene.environment->suns; ++i) {
        const __global Emitter *sun = scene.emitters + i;
        F3 off = sub(d, f3_of(sun->normal));
        float versine = sun->a.w / (1.0f + sqrt(1.0f - sun->a.w));      // 1 - cos of its radius; a.w is its squared sine
        I inside = dot3(off, off) <= 2.0f * versine;
        if (ANY(inside)) {
            F weight = against_lights(own, (F)(sun->pick / (2.0f * PI_F * versine)));
            F3 radiance = f3_of(sun->radiance);
#if SPECTRAL_COLOURS
            radiance = light_colour(scene.spectral, radiance, sun->radiance.w, scene.colours);
#endif
            sum = add(sum, keep3(inside, scale(radiance, weight)));
        }
    }
    return sum;
}
#endif

// Radiance that a path meets which leaves the scene along d, weighted against light sampling.
static F3 light_from_infinity(F3 d, F own, Scene scene)
{
    F3 sum = f3(ZERO, ZERO, ZERO);
#if ENVIRONMENT
    sum = environment_radiance(d, scene);
#endif
#if ENVIRONMENT_SAMPLED
    sum = scale(sum, against_lights(own, environment_pdf(d, scene) * scene.environment->pick));
#endif
#if EMITTER_SUNS
    sum = add(sum, suns_radiance(d, own, scene));
#endif
    return sum;
}

#endif
