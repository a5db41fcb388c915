// What single rays meet among the triangles of a scene, by the walks that render: the nearest one, or whether there is any.
#include "common/scene.h"
#include "geometry/mesh.h"

static OneRay ray_at(const __global float *rays, uint i, uint count)
{
    OneRay ray;
    ray.o = (float3)(rays[i], rays[count + i], rays[2 * count + i]);
    ray.d = (float3)(rays[3 * count + i], rays[4 * count + i], rays[5 * count + i]);
    ray.origin = NO_PRIMITIVE;
    ray.triangle = NO_TRIANGLE;
    return ray;
}

__kernel void ray_queries(SCENE_PARAMETERS
                          const __global float *rays,      // [7][count]: o, d, reach
                          __global float       *hits,      // [2][count]: t, triangle; of shadow rays whether blocked
                          int                   shadow,    // whether anything before reach counts, or the nearest
                          uint                  count)
{
    uint i = get_global_id(0);
    Scene scene = SCENE;
    OneRay ray = ray_at(rays, i, count);
    float reach = rays[6 * count + i];
    if (shadow) {
        hits[i] = meets_triangle(ray, in_world(ray), reach, NO_PRIMITIVE, NO_TRIANGLE, scene) ? 1.0f : 0.0f;
        return;
    }
    TriangleHit hit;
    hit.t = reach;
    hit.triangle = NO_TRIANGLE;
    hit.b1 = 0.0f;
    hit.b2 = 0.0f;
    nearest_triangle(ray, in_world(ray), scene, &hit);
    hits[i] = hit.t;
    hits[count + i] = as_float(hit.triangle);
}
