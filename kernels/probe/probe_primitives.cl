// What given rays meet first, and whether anything but their target lies before their reach.
#include "geometry/nearest.h"

__kernel void probe_primitives(SCENE_PARAMETERS
                               const __global float *rays,     // [9][count]: o, d, origin, reach, target
                               __global float       *hits,     // [2][count]: t, primitive
                               __global int         *blocked,  // 1 or 0
                               uint                  count)
{
    uint i = get_global_id(0) * VW;
    Scene scene = SCENE;
    Ray ray;
    ray.o = f3(LOAD_F(rays, i), LOAD_F(rays + count, i), LOAD_F(rays + 2 * count, i));
    ray.d = f3(LOAD_F(rays + 3 * count, i), LOAD_F(rays + 4 * count, i), LOAD_F(rays + 5 * count, i));
    ray.origin = AS_I(LOAD_F(rays + 6 * count, i));
    ray.triangle = (I)(NO_TRIANGLE);
    Hit hit = nearest_hit(ray, scene);
    STORE_F(hits, i, hit.t);
    STORE_F(hits + count, i, AS_F(hit.primitive));
    F reach = LOAD_F(rays + 7 * count, i);
    I dark = any_hit(ray, reach, AS_I(LOAD_F(rays + 8 * count, i)), (I)(NO_TRIANGLE), scene);
    STORE_I(blocked, i, dark != 0 ? (I)(1) : (I)(0));
}
