// What given rays meet, and where they would go on from there.
#include "geometry/nearest.h"
#include "integrator/path.h"

__kernel void probe_hits(SCENE_PARAMETERS
                         const __global float *rays,     // [9][count]: o, d, origin, triangle, reach
                         __global float       *hits,     // [12][count]: t, primitive, triangle, b1, b2, p, ng, offset
                         __global int         *blocked,  // whether something lies before reach
                         uint                  count)
{
    uint i = get_global_id(0) * VW;
    Scene scene = SCENE;
    Ray ray;
    ray.o = f3(LOAD_F(rays, i), LOAD_F(rays + count, i), LOAD_F(rays + 2 * count, i));
    ray.d = f3(LOAD_F(rays + 3 * count, i), LOAD_F(rays + 4 * count, i), LOAD_F(rays + 5 * count, i));
    ray.origin = AS_I(LOAD_F(rays + 6 * count, i));
    ray.triangle = AS_I(LOAD_F(rays + 7 * count, i));
    Hit hit = nearest_hit(ray, scene);
    Vertex vertex = vertex_of(ray, hit, hit.primitive >= 0, ZERO, scene);
    STORE_F(hits, i, hit.t);
    STORE_F(hits + count, i, AS_F(hit.primitive));
    STORE_F(hits + 2 * count, i, AS_F(hit.triangle));
    STORE_F(hits + 3 * count, i, hit.b1);
    STORE_F(hits + 4 * count, i, hit.b2);
    STORE_F(hits + 5 * count, i, vertex.p.x);
    STORE_F(hits + 6 * count, i, vertex.p.y);
    STORE_F(hits + 7 * count, i, vertex.p.z);
    STORE_F(hits + 8 * count, i, vertex.ng.x);
    STORE_F(hits + 9 * count, i, vertex.ng.y);
    STORE_F(hits + 10 * count, i, vertex.ng.z);
    STORE_F(hits + 11 * count, i, vertex.offset);
    F reach = LOAD_F(rays + 8 * count, i);
    I dark = any_hit(ray, reach, (I)(NO_PRIMITIVE), (I)(NO_TRIANGLE), scene);
    STORE_I(blocked, i, dark != 0 ? (I)(1) : (I)(0));
}
