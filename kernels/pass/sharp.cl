// What given rays meet: one each, for layers that know no blur. A ray that departs from a surface goes on beyond it.
#define CHANCE_OF_ALL_RAYS 0.49999997f  // surfaces with holes are there from an opacity of one half on: nothing is random
#define KIND_OF_RAY(T, origin) (T)(HIDDEN_FROM_CAMERA)
#include "geometry/nearest.h"
#include "material/vertex.h"

__kernel void sharp(SCENE_PARAMETERS
                    const __global int   *owners,      // per primitive: object and material identifier
                    const __global float *rays,        // [7][capacity]: o, d, time
                    const __global int   *origins,     // [2][capacity]: primitive and triangle that a ray departs from
                    __global float       *points,      // [10][capacity]: position, normal, the surface's own, and how far
                                                       // along that rays depart from a mesh
                    __global int         *hits,        // [4][capacity]: primitive, triangle, object, material; -1 for none
                    uint                  capacity)    // padded number of rays
{
    uint i = get_global_id(0) * VW;
    Scene scene = SCENE;
    Ray ray;
    ray.o = f3(LOAD_F(rays, i), LOAD_F(rays + capacity, i), LOAD_F(rays + 2 * (size_t)capacity, i));
    ray.d = f3(LOAD_F(rays + 3 * (size_t)capacity, i), LOAD_F(rays + 4 * (size_t)capacity, i),
               LOAD_F(rays + 5 * (size_t)capacity, i));
    ray.origin = LOAD_I(origins, i);
    ray.triangle = LOAD_I(origins + capacity, i);
#if HAS_MOTION
    ray.time = LOAD_F(rays + 6 * (size_t)capacity, i);
#endif
    Hit hit = nearest_hit(ray, scene);
    I on = (hit.primitive >= 0) & (ray.origin != PATH_ENDED);
    hit.t = on ? hit.t : ZERO;
#if VW == 1     // read again, since compilers for GPUs hold it in registers otherwise
    const volatile __global float *again = rays + i;
    ray.o = f3(again[0], again[capacity], again[2 * (size_t)capacity]);
    ray.d = f3(again[3 * (size_t)capacity], again[4 * (size_t)capacity], again[5 * (size_t)capacity]);
#endif
    Vertex vertex = vertex_of(ray, hit, on, (F)(0.5f), scene);
    F3 found[3] = {vertex.p, vertex.n, vertex.ng};
    for (int k = 0; k < 3; ++k) {
        STORE_F(points + (size_t)(3 * k) * capacity, i, found[k].x);
        STORE_F(points + (size_t)(3 * k + 1) * capacity, i, found[k].y);
        STORE_F(points + (size_t)(3 * k + 2) * capacity, i, found[k].z);
    }
#if HAS_MESH
    STORE_F(points + 9 * (size_t)capacity, i, vertex.offset);
#else
    STORE_F(points + 9 * (size_t)capacity, i, ZERO);
#endif
    I row = on ? hit.primitive * 2 : FALSE;
    I none = (I)(-1);
    STORE_I(hits, i, on ? hit.primitive : none);
    STORE_I(hits + capacity, i, on ? hit.triangle : none);
    STORE_I(hits + 2 * (size_t)capacity, i, on ? GATHER(I, owners, row, ) : none);
    STORE_I(hits + 3 * (size_t)capacity, i, on ? GATHER(I, owners, row + 1, ) : none);
}
