// Takes each path through media to what it meets first, and adds the light that they emit and scatter towards it on the way:
// in place of intersect where a scene has media. Reads the path; writes HIT and T, B, L and MEDIUM.
// Facts: HAS_MEDIA, HAS_BOUNDARY, HAS_EMITTERS, SPECTRUM.
#define GROUPS_IN_STATE
#define MEETS_BOUNDARIES
#include "integrator/media.h"
#include "integrator/state.h"

__kernel void travel(SCENE_PARAMETERS
                     __global float *state,      // path state
                     uint            capacity,   // slots in the state
                     Wave            wave,
                     Limits          limits,
                     uint            depth,      // of the vertex that follows, from 1
                     const __global uint *tiles) // that are rendered
{
    uint slot = slot_of_item(state, capacity, depth > 1u);
    // Read the path.
    Path path;
    if (slot == NO_SLOT || !ANY(READ_I(ORIGIN, slot) != PATH_ENDED))
        return;
    path.ray = read_ray(state, capacity, slot);
    Lane lane = lane_of(slot, wave, tiles);
    path.pixel = lane.pixel;
    path.sample = lane.sample;
    path.depth = (U)(depth);
    path.beta = READ_F3(B, slot);
    path.radiance = READ_F3(L, slot);
#if LIGHT_GROUPS
    path.groups = (GroupLight){state, capacity, slot};
#endif
    Scene scene = SCENE;
#if HAS_BEAMS
    path.pdf = depth == 1u ? ZERO : READ_F(PDF, slot);
#endif
    path.medium = depth == 1u ? (I)(scene.media_at_camera) : READ_I(MEDIUM, slot);
#if HAS_ENTRIES
    path.entry = READ_F3(ENTRY, slot);     // of no account at depth 1, which begins in no such medium
#endif
#if SPECTRAL_COLOURS
    scene.spectral = spectral_colours_of(READ_F(WAVELENGTH_SAMPLE, slot), scene.colours);
#endif
    // Take it through media.
    Hit hit = travel_on(&path, scene, rules_of(wave, limits));
    // Write what it met.
    slot = slot_again(state, capacity);
    WRITE_I(ORIGIN, slot, path.ray.origin);
    WRITE_F3(B, slot, path.beta);
    WRITE_F3(L, slot, path.radiance);
    WRITE_I(MEDIUM, slot, path.medium);
    write_hit(state, capacity, slot, hit);
}
