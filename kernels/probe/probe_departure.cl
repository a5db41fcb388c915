// Leaves the points that rays meet on a mesh in given directions, turned to the side of the normal, and says what is met.
#include "geometry/nearest.h"
#include "integrator/path.h"

__kernel void probe_departure(SCENE_PARAMETERS
                              const __global float *rays,      // [9][count]: o, d, next direction
                              __global int         *again,     // 1: met the mesh again, 0: left it, -1: never met it
                              uint                  count)
{
    uint i = get_global_id(0) * VW;
    Scene scene = SCENE;
    Ray ray;
    ray.o = f3(LOAD_F(rays, i), LOAD_F(rays + count, i), LOAD_F(rays + 2 * count, i));
    ray.d = f3(LOAD_F(rays + 3 * count, i), LOAD_F(rays + 4 * count, i), LOAD_F(rays + 5 * count, i));
    ray.origin = (I)(NO_PRIMITIVE);
    ray.triangle = (I)(NO_TRIANGLE);
    Hit hit = nearest_hit(ray, scene);
    I on = hit.primitive >= 0;
    Vertex vertex = vertex_of(ray, hit, on, ZERO, scene);
    F3 next = f3(LOAD_F(rays + 6 * count, i), LOAD_F(rays + 7 * count, i), LOAD_F(rays + 8 * count, i));
    next = scale(next, with_sign(ONE, dot3(next, vertex.ng)));
    ray.o = departure(vertex, next);
    ray.d = next;
    ray.origin = on ? hit.primitive : (I)(PATH_ENDED);
    ray.triangle = hit.triangle;
    Hit second = nearest_hit(ray, scene);
    STORE_I(again, i, on ? (second.primitive >= 0 ? (I)(1) : (I)(0)) : (I)(-1));
}
