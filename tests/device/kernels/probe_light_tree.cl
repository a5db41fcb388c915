// Writes which emitter a number picks at a point on a surface, with what probability, and the probability of a given emitter.
#include "light/infinity.h"
#include "light/emitters.h"

__kernel void probe_light_tree(SCENE_PARAMETERS
                               const __global float *in,    // [8][count]: point, normal, number, emitter
                               __global float       *out,   // [3][count]
                               uint                  count)
{
    uint i = get_global_id(0) * VW;
    F given[8];
    for (int k = 0; k < 8; ++k)
        given[k] = LOAD_F(in + k * count, i);
    Scene scene = SCENE;
    F3 p = f3(given[0], given[1], given[2]);
    Receiver n = all_round();
    n.n = f3(given[3], given[4], given[5]);
#if LIGHT_LOBES
    n.mirrored = f3(given[4], given[5], given[3]);
    n.width = 0.02f;
    n.share = 0.7f;
#endif
    F pick;
    I e = pick_emitter(scene, p, n, given[6], &pick);
    I asked = TO_I(given[7]);
    I lamp = asked < scene.environment->lamps;
    F chance = pick_of_lamp(scene, lamp ? asked : FALSE, p, n);
    for (int k = scene.environment->lamps; k < scene.emitter_count; ++k)
        chance = asked == k ? pick_of_distant(scene, k, p, n) : chance;
    STORE_F(out + 0 * count, i, TO_F(e));
    STORE_F(out + 1 * count, i, pick);
    STORE_F(out + 2 * count, i, chance);
}
