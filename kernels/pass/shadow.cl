// Adds the light samples that nothing blocks. Reads the shadow ray (FROM, S, W, REACH, TARGET, C); adds to radiance L.
#include "geometry/nearest.h"
#include "integrator/state.h"

SIXTEEN_TOGETHER
__kernel void shadow(SCENE_PARAMETERS
                     __global float *state,      // path state
                     uint            capacity)   // slots in the state
{
    uint slot = get_global_id(0) * VW;
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
    I blocked = any_hit(ray, reach, READ_I(TARGET, slot), READ_TRIANGLE(TARGET_TRIANGLE, slot), SCENE);
    I lit = wanted & NOT(blocked);
    WRITE_F(REACH, slot, ZERO);
    if (!ANY(lit))
        return;
    F3 radiance = READ_F3(L, slot);
    F3 light = READ_F3(C, slot);
    WRITE_F3(L, slot, add(radiance, keep3(lit, light)));
}
