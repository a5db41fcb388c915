// Adds the light samples that nothing blocks. Reads the shadow ray (FROM, S, W, REACH, TARGET, C); adds to radiance L.
#if HAS_MEDIA
#define MEETS_BOUNDARIES
#include "integrator/media.h"
#endif
#include "geometry/nearest.h"
#include "integrator/state.h"
#if LAMPS_BEHIND_GLASS
#define GROUPS_IN_STATE
#include "integrator/glass.h"
#endif

SIXTEEN_TOGETHER
__kernel void shadow(SCENE_PARAMETERS
                     __global float *state,      // path state
                     uint            capacity    // slots in the state
#if HAS_DENSITY
                   , Wave            wave,
                     uint            depth,      // of the vertex that was lit, from 1
                     const __global uint *tiles  // that are rendered
#endif
#if LAMPS_BEHIND_GLASS
                   , int             left        // edges that the paths may have from there on
#endif
                     )
{
    uint slot = slot_of_item(state, capacity, 1);
    if (slot == NO_SLOT)
        return;
    F reach = READ_F(REACH, slot);
    I wanted = reach > 0.0f;
    if (!ANY(wanted))
        return;
    Ray ray;
    ray.origin = READ_I(FROM, slot);
    ray.triangle = READ_TRIANGLE(FROM_TRIANGLE, slot);
#if HAS_MOTION
    ray.time = READ_TIME(slot);
#endif
    ray.o = READ_F3(S, slot);
    ray.d = READ_F3(W, slot);
    Scene scene = SCENE;
    I passed;
    I blocked = blocked_before(ray, reach, READ_I(TARGET, slot), READ_TRIANGLE(TARGET_TRIANGLE, slot), 1, &passed, scene);
    I lit = wanted & NOT(blocked);
    WRITE_F(REACH, slot, ZERO);
#if LAMPS_BEHIND_GLASS
    lit = wanted;
#endif
    if (!ANY(lit))
        return;
#if HAS_MEDIA
#if SPECTRAL_COLOURS
    scene.spectral = spectral_colours_of(READ_F(WAVELENGTH_SAMPLE, slot), scene.colours);
#endif
#if HAS_DENSITY
    Lane lane = lane_of(slot, wave, tiles);
    Chance chance = chance_of(lane.pixel, lane.sample, (U)(FROM_A_SURFACE + depth), wave.seed);
#endif
    F3 through = shadow_transmittance(ray, READ_I(FROM_MEDIUM, slot), reach, lit, scene WITH_CHANCE(chance));
    slot = slot_again(state, capacity);     // so that what is read from here on needs no register before
#endif
    F3 radiance = READ_F3(L, slot);
    F3 light = READ_F3(C, slot);
#if LIGHT_PASSES
    light = scale(light, passed ? ONE : READ_F(MIS, slot));
#endif
#if LAMPS_BEHIND_GLASS
    I bent = wanted & blocked;
    if (ANY(bent)) {
#if SPECTRAL_COLOURS
        scene.spectral = spectral_colours_of(READ_F(WAVELENGTH_SAMPLE, slot), scene.colours);
#endif
#if HAS_DISPERSION
        scene.inverse = inverse_wavelength(READ_F(WAVELENGTH_SAMPLE, slot), scene.colours);
#endif
        ShadowRay aimed;
        aimed.ray = ray;
        aimed.share = READ_F3(SHARE, slot);
        aimed.chance = READ_F(CHANCE, slot);
        aimed.target = READ_I(TARGET, slot);
        aimed.target_triangle = READ_TRIANGLE(TARGET_TRIANGLE, slot);
        F wavelength_sample = GLASS_WAVELENGTH(READ_F(WAVELENGTH_SAMPLE, slot));
        light = select3(bent, light_through_glass(aimed, bent, (I)(left), wavelength_sample, scene), light);
    }
#endif
#if HAS_MEDIA
    light = mul(light, through);
#endif
    WRITE_F3(L, slot, add(radiance, keep3(lit, light)));
#if LIGHT_GROUPS
    I group = READ_I(LIT_BY, slot);
    for (int g = 0; g < LIGHT_GROUPS; ++g)
        write_group(state, capacity, slot, g, add(read_group(state, capacity, slot, g), keep3(lit & (group == g), light)));
#endif
}
