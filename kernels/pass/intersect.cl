// Finds what each path's ray meets first. Reads ray and ORIGIN; writes HIT and T. Packs without a living path are skipped.
#include "geometry/nearest.h"
#include "integrator/state.h"

SIXTEEN_TOGETHER
__kernel void intersect(SCENE_PARAMETERS
                        __global float *state,      // path state
                        uint            capacity,   // slots in the state
                        uint            depth)      // of the vertex that follows, from 1
{
    uint slot = slot_of_item(state, capacity, depth > 1u);
    if (slot == NO_SLOT || !ANY(READ_I(ORIGIN, slot) != PATH_ENDED))
        return;
    Hit hit = nearest_hit(read_ray(state, capacity, slot), SCENE);
    write_hit(state, capacity, slot_again(state, capacity), hit);
}
