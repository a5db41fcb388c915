// Which ways something of the scene stands on. A surface that lets light through does as well: light that it bends goes
// elsewhere. Nothing moves.
#define KIND_OF_SHADOW HIDDEN_FROM_CAMERA   // what stands between a lamp and the lens is what the camera sees there
#include "geometry/nearest.h"

__kernel void occluded(SCENE_PARAMETERS
                       const __global float *rays,      // [9][count]: origin, direction, reach, target, its triangle
                       __global int         *blocked,   // 1 where something does
                       uint                  count)     // padded to full packets of lanes
{
    uint i = get_global_id(0) * VW;
    Ray ray;
    ray.o = f3(LOAD_F(rays, i), LOAD_F(rays + count, i), LOAD_F(rays + 2 * count, i));
    ray.d = f3(LOAD_F(rays + 3 * count, i), LOAD_F(rays + 4 * count, i), LOAD_F(rays + 5 * count, i));
    ray.origin = (I)(NO_PRIMITIVE);
    ray.triangle = (I)(NO_TRIANGLE);
#if HAS_MOTION
    ray.time = ZERO;
#endif
    I target = TO_I(LOAD_F(rays + 7 * count, i));
    I triangle = TO_I(LOAD_F(rays + 8 * count, i));
    I dark = any_hit(ray, LOAD_F(rays + 6 * count, i), target, triangle, SCENE);
    STORE_I(blocked, i, dark != 0 ? (I)(1) : (I)(0));
}
