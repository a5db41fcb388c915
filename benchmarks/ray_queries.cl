// What rays meet among the triangles of a scene, by the walks that render: the nearest one, or whether there is any.
#include "common/scene.h"
#include "geometry/mesh.h"

__kernel void ray_queries(SCENE_PARAMETERS
                          const __global float *rays,      // [7][count]: o, d, reach
                          __global float       *hits,      // [2][count]: t, triangle; of shadow rays whether blocked
                          int                   shadow,    // whether anything before reach counts, or the nearest
                          uint                  count)
{
    uint i = get_global_id(0) * VW;
    Scene scene = SCENE;
    Ray ray;
    ray.o = f3(LOAD_F(rays, i), LOAD_F(rays, count + i), LOAD_F(rays, 2 * count + i));
    ray.d = f3(LOAD_F(rays, 3 * count + i), LOAD_F(rays, 4 * count + i), LOAD_F(rays, 5 * count + i));
    ray.origin = (I)(NO_PRIMITIVE);
    ray.triangle = (I)(NO_TRIANGLE);
    F reach = LOAD_F(rays, 6 * count + i);
    if (shadow) {
        I blocked = blocked_by_meshes(ray, reach, ray.origin, ray.triangle, TRUE, scene);
        STORE_F(hits, i, blocked ? ONE : ZERO);
        return;
    }
    Hit hit;
    hit.t = reach;
    hit.primitive = (I)(NO_PRIMITIVE);
    hit.triangle = (I)(NO_TRIANGLE);
    hit.b1 = ZERO;
    hit.b2 = ZERO;
    nearest_in_meshes(ray, TRUE, scene, &hit);
    STORE_F(hits, i, hit.t);
    STORE_I((__global int *)hits, count + i, hit.triangle);
}
