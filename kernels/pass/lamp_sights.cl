// Which lines of sight nothing blocks. A surface that lets light through blocks as well: light that it bends goes elsewhere.
#include "geometry/nearest.h"

__kernel void lamp_sights(SCENE_PARAMETERS
                          const __global float *lines,       // [7][capacity]: o, d, how far
                          __global float       *shows,       // 1 or 0
                          uint                  capacity)    // padded number of lines
{
    uint i = get_global_id(0) * VW;
    Scene scene = SCENE;
    Ray ray;
    ray.o = f3(LOAD_F(lines, i), LOAD_F(lines + capacity, i), LOAD_F(lines + 2 * capacity, i));
    ray.d = f3(LOAD_F(lines + 3 * capacity, i), LOAD_F(lines + 4 * capacity, i), LOAD_F(lines + 5 * capacity, i));
    ray.origin = (I)(NO_PRIMITIVE);
    ray.triangle = (I)(NO_TRIANGLE);
#if HAS_MOTION
    ray.time = ZERO;
#endif
    I dark = any_hit(ray, LOAD_F(lines + 6 * capacity, i), (I)(NO_PRIMITIVE), (I)(NO_TRIANGLE), scene);
    STORE_F(shows, i, dark ? ZERO : ONE);
}
