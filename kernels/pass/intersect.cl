// Finds what each path's ray meets first. Reads ray and ORIGIN; writes HIT and T. Packs without a living path are skipped.
#include "geometry/nearest.h"
#include "integrator/state.h"

SIXTEEN_TOGETHER
__kernel void intersect(SCENE_PARAMETERS
                        __global float *state,      // path state
                        uint            capacity)   // slots in the state
{
    uint slot = get_global_id(0) * VW;
    if (!ANY(READ_I(ORIGIN, slot) != PATH_ENDED))
        return;
    Hit hit = nearest_hit(read_ray(state, capacity, slot), SCENE);
    write_hit(state, capacity, slot, hit);
}
