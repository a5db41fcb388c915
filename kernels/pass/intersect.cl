// Finds what each path's ray meets first. Reads ray and ORIGIN; writes HIT and T. Packs without a living path are skipped.
#include "geometry/nearest.h"
#include "integrator/state.h"

SIXTEEN_TOGETHER
__kernel void intersect(SCENE_PARAMETERS
                        __global float *state,      // path state
                        uint            capacity)   // slots in the state
{
    uint slot = get_global_id(0) * VW;
    Ray ray;
    ray.origin = READ_I(ORIGIN, slot);
    if (!ANY(ray.origin != PATH_ENDED))
        return;
    ray.o = READ_F3(O, slot);
    ray.d = READ_F3(D, slot);
    ray.triangle = READ_TRIANGLE(TRIANGLE, slot);
#if HAS_MOTION
    ray.time = READ_TIME(slot);
#endif
    Hit hit = nearest_hit(ray, SCENE);
    WRITE_I(HIT, slot, hit.primitive);
    WRITE_F(T, slot, hit.t);
#if HAS_MESH
    WRITE_I(HIT_TRIANGLE, slot, hit.triangle);
    WRITE_F(B1, slot, hit.b1);
    WRITE_F(B2, slot, hit.b2);
#endif
}
