// One vertex of every living path: emission and environment, a light sample for the shadow pass, the next direction,
// Russian roulette. Reads the path, HIT and T; writes the path and the shadow ray.
// Facts: HAS_<material>, HAS_TEXTURE, HAS_EMITTERS, ENVIRONMENT, SPECTRUM.
#include "integrator/path.h"
#include "integrator/state.h"

__kernel void shade(SCENE_PARAMETERS
                    __global float *state,      // path state
                    uint            capacity,   // slots in the state
                    Wave            wave,
                    Limits          limits,
                    uint            edge,       // edges of the paths so far
                    const __global uint *tiles) // that are rendered
{
    uint slot = get_global_id(0) * VW;
    Path path;
    path.ray.self = READ_I(SELF, slot);
    if (!ANY(path.ray.self != PATH_ENDED))
        return;
    Lane lane = lane_of(slot, wave, tiles);
    path.pixel = lane.pixel;
    path.sample = lane.sample;
    path.edge = (U)(edge);
    path.ray.part = READ_PART(PART, slot);
    path.ray.o = READ_F3(O, slot);
    path.ray.d = READ_F3(D, slot);
#if HAS_MOTION
    path.ray.time = READ_TIME(slot);
#endif
    path.beta = READ_F3(B, slot);
#if SPECTRUM
    path.hue = READ_F(HUE, slot);
#endif
    path.radiance = READ_F3(L, slot);
#if HAS_EMITTERS
    path.pdf = READ_F(PDF, slot);
#endif
    Hit hit;
    hit.t = READ_F(T, slot);
    hit.primitive = READ_I(HIT, slot);
    hit.part = READ_PART(HIT_PART, slot);
#if HAS_MESH
    hit.b1 = READ_F(B1, slot);
    hit.b2 = READ_F(B2, slot);
#endif
    Scene scene = SCENE;
#if HUES
    scene.hues = hues_of(path.hue, scene.colours);
#endif
#if HAS_DISPERSION
    scene.inverse = inverse_wavelength(path.hue, scene.colours);
#endif
    ShadowRay shadow = shade_vertex(&path, hit, scene, rules_of(wave, limits));
#if HAS_DISPERSION
    WRITE_F(HUE, slot, path.hue);
#endif
    WRITE_F3(L, slot, path.radiance);
    WRITE_I(SELF, slot, path.ray.self);
    WRITE_PART(PART, slot, path.ray.part);
    WRITE_F3(O, slot, path.ray.o);
    WRITE_F3(D, slot, path.ray.d);
    WRITE_F3(B, slot, path.beta);
#if HAS_EMITTERS
    WRITE_F(PDF, slot, path.pdf);
    WRITE_F(REACH, slot, shadow.reach);
    if (ANY(shadow.reach > 0.0f)) {
        WRITE_I(FROM, slot, shadow.ray.self);
        WRITE_I(TARGET, slot, shadow.target);
        WRITE_PART(FROM_PART, slot, shadow.ray.part);
        WRITE_PART(TARGET_PART, slot, shadow.target_part);
        WRITE_F3(S, slot, shadow.ray.o);
        WRITE_F3(W, slot, shadow.ray.d);
        WRITE_F3(C, slot, shadow.light);
    }
#endif
}
