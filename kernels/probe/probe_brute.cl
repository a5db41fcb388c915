// The nearest triangle by testing every block, with the very triangle test of the trees.
#include "common/scene.h"
#include "geometry/mesh.h"

__kernel void probe_brute(SCENE_PARAMETERS
                          const __global float *rays,      // [9][count]: o, d, origin, triangle, reach
                          __global float       *hits,      // [2][count]: t, triangle
                          uint                  block_count,
                          uint                  count)
{
    uint i = get_global_id(0);
    Scene scene = SCENE;
    BoxRay r = box_ray(rays[i], rays[count + i], rays[2 * count + i], rays[3 * count + i], rays[4 * count + i],
                       rays[5 * count + i]);
    OneRay ray;
    TriangleHit hit;
    hit.t = NEVER;
    hit.triangle = NO_TRIANGLE;
    for (uint k = 0; k < block_count; ++k)
        hit_block((int)k, r, NO_TRIANGLE, ray, 0, scene, &hit);
    hits[i] = hit.t;
    hits[count + i] = as_float(hit.triangle);
}
