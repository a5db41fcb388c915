// Writes, for points with three numbers, what light sampling makes of them; and for points with a direction, which lamp that
// meets, how far away, and with what density light sampling would have chosen the direction.
#include "light/emitters.h"
#include "geometry/nearest.h"

__kernel void probe_emitter(SCENE_PARAMETERS
                            const __global float *in,       // [9][count]: point, numbers, direction
                            __global float       *out,      // [10][count]
                            uint                  count)
{
    uint i = get_global_id(0) * VW;
    F given[9];
    for (int k = 0; k < 9; ++k)
        given[k] = LOAD_F(in + k * count, i);
    Scene scene = SCENE;
    F3 p = f3(given[0], given[1], given[2]);
    Receiver up = all_round();
    up.n = f3(ZERO, ZERO, ONE);
    LightSample s = sample_emitter(scene, p, up, given[3], given[4], given[5]);
    Ray ray;
    ray.o = p;
    ray.d = f3(given[6], given[7], given[8]);
    ray.origin = (I)(NO_PRIMITIVE);
    ray.triangle = (I)(NO_TRIANGLE);
#if HAS_MOTION
    ray.time = ZERO;
#endif
    Hit hit = nearest_hit(ray, scene);
    I met = hit.primitive >= 0;
    I e = GATHER(I, scene.primitives, (met ? hit.primitive : FALSE), .emitter);
    e = MAX(e, FALSE);
    F pdf = met ? emitter_pdf(scene.emitters, e, emitter_pick(scene, e, p, up), p, ray.d, hit.t, ONE) : ZERO;
    F values[10] = {s.direction.x, s.direction.y, s.direction.z, s.reach, s.pdf, s.radiance.x, TO_F(s.primitive),
                    TO_F(hit.primitive), hit.t, pdf};
    for (int k = 0; k < 10; ++k)
        STORE_F(out + k * count, i, values[k]);
}
