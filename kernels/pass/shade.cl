// One vertex of every living path: emission and environment, a light sample for the shadow pass, the next direction,
// Russian roulette. Reads the path, HIT and T; writes the path and the shadow ray.
// Facts: HAS_<material>, HAS_TEXTURE, HAS_EMITTERS, ENVIRONMENT, SPECTRUM.
#define GROUPS_IN_STATE
#include "integrator/path.h"
#include "integrator/state.h"

#if LIGHT_TREE
static inline Receiver read_receiver(const __global float *state, uint capacity, uint slot)
{
    Receiver receiver;
    receiver.n = READ_F3(N, slot);
#if LIGHT_LOBES
    receiver.mirrored = READ_F3(MIRRORED, slot);
    receiver.width = READ_F(LOBE_WIDTH, slot);
    receiver.share = READ_F(LOBE_SHARE, slot);
#endif
    return receiver;
}

static inline void write_receiver(__global float *state, uint capacity, uint slot, Receiver receiver)
{
    WRITE_F3(N, slot, receiver.n);
#if LIGHT_LOBES
    WRITE_F3(MIRRORED, slot, receiver.mirrored);
    WRITE_F(LOBE_WIDTH, slot, receiver.width);
    WRITE_F(LOBE_SHARE, slot, receiver.share);
#endif
}
#endif

__kernel void shade(SCENE_PARAMETERS
                    __global float *state,      // path state
                    uint            capacity,   // slots in the state
                    Wave            wave,
                    Limits          limits,
                    uint            depth,       // of the vertex, from 1
                    const __global uint *tiles,     // that are rendered
                    const __global float *survival_scale) // of roulette, by cell of the film
{
    uint slot = slot_of_item(state, capacity, 1);
    // Read the path and its hit.
    Path path;
    if (slot == NO_SLOT || !ANY(READ_I(ORIGIN, slot) != PATH_ENDED))
        return;
    path.ray = read_ray(state, capacity, slot);
    Lane lane = lane_of(slot, wave, tiles);
    path.pixel = lane.pixel;
    path.sample = lane.sample;
    path.survival_scale = survival_scale_at(lane, limits, survival_scale);
    path.depth = (U)(depth);
    path.beta = READ_F3(B, slot);
#if SPECTRUM
    path.wavelength_sample = READ_F(WAVELENGTH_SAMPLE, slot);
#endif
    path.radiance = READ_F3(L, slot);
#if LIGHT_GROUPS
    path.groups = (GroupLight){state, capacity, slot};
#endif
#if CAUSTICS
    path.since_receiver = depth == 1u ? FALSE : READ_I(SINCE_RECEIVER, slot);
#endif
#if HAS_MEDIA
    path.medium = READ_I(MEDIUM, slot);
#if HAS_ENTRIES
    path.entry = depth == 1u ? f3(ZERO, ZERO, ZERO) : READ_F3(ENTRY, slot);
#endif
#endif
#if HAS_EMITTERS
    path.pdf = READ_F(PDF, slot);
#endif
#if LAMPS_BEHIND_GLASS
    path.scattered = (Departure){path.ray.o, path.ray.d, ZERO};
    if (depth > 1u)
        path.scattered = (Departure){READ_F3(LAST, slot), READ_F3(LAST_W, slot), READ_F(LAST_PDF, slot)};
#endif
#if LIGHT_TREE
    path.receiver = depth == 1u ? all_round() : read_receiver(state, capacity, slot);
#endif
    Hit hit;
    hit.t = READ_F(T, slot);
    hit.primitive = READ_I(HIT, slot);
    hit.triangle = READ_TRIANGLE(HIT_TRIANGLE, slot);
#if HAS_MESH || HAS_CURVE
    hit.b1 = READ_F(B1, slot);
#endif
#if HAS_MESH
    hit.b2 = READ_F(B2, slot);
#endif
    // Shade the vertex at the wavelengths of the path.
    Scene scene = SCENE;
#if SPECTRAL_COLOURS
    scene.spectral = spectral_colours_of(path.wavelength_sample, scene.colours);
#endif
#if HAS_DISPERSION
    scene.inverse = inverse_wavelength(path.wavelength_sample, scene.colours);
#endif
    ShadowRay shadow = shade_vertex(&path, hit, scene, rules_of(wave, limits));
    // Write the path, and the shadow ray.
    slot = slot_again(state, capacity);
#if HAS_DISPERSION
    WRITE_F(WAVELENGTH_SAMPLE, slot, path.wavelength_sample);
#endif
    WRITE_F3(L, slot, path.radiance);
    WRITE_I(ORIGIN, slot, path.ray.origin);
    WRITE_TRIANGLE(TRIANGLE, slot, path.ray.triangle);
    WRITE_F3(O, slot, path.ray.o);
    WRITE_F3(D, slot, path.ray.d);
    WRITE_F3(B, slot, path.beta);
#if LAMPS_BEHIND_GLASS
    WRITE_F3(LAST, slot, path.scattered.o);
    WRITE_F3(LAST_W, slot, path.scattered.d);
    WRITE_F(LAST_PDF, slot, path.scattered.pdf);
#endif
#if LIGHT_TREE
    write_receiver(state, capacity, slot, path.receiver);
#endif
#if CAUSTICS
    WRITE_I(SINCE_RECEIVER, slot, path.since_receiver);
#endif
#if HAS_MEDIA
    WRITE_I(MEDIUM, slot, path.medium);
#if HAS_ENTRIES
    WRITE_F3(ENTRY, slot, path.entry);
#endif
#endif
#if HAS_EMITTERS
    WRITE_F(PDF, slot, path.pdf);
    WRITE_F(REACH, slot, shadow.reach);
    if (ANY(shadow.reach > 0.0f)) {
        WRITE_I(FROM, slot, shadow.ray.origin);
        WRITE_I(TARGET, slot, shadow.target);
        WRITE_TRIANGLE(FROM_TRIANGLE, slot, shadow.ray.triangle);
        WRITE_TRIANGLE(TARGET_TRIANGLE, slot, shadow.target_triangle);
        WRITE_F3(S, slot, shadow.ray.o);
        WRITE_F3(W, slot, shadow.ray.d);
        WRITE_F3(C, slot, shadow.light);
#if LIGHT_PASSES
        WRITE_F(MIS, slot, shadow.mis);
#endif
#if LAMPS_BEHIND_GLASS
        WRITE_F3(SHARE, slot, shadow.share);
        WRITE_F(CHANCE, slot, shadow.chance);
#endif
#if LIGHT_GROUPS
        WRITE_I(LIT_BY, slot, shadow.group);
#endif
#if HAS_MEDIA
        WRITE_I(FROM_MEDIUM, slot, shadow.medium);
#endif
    }
#endif
}
