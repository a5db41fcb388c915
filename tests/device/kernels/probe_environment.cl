// Writes, for pairs of numbers, the direction that light sampling of the environment makes of them with its radiance and
// density, and the radiance and density that are found for that direction.
#include "geometry/primitives.h"
#include "light/environment.h"

__kernel void probe_environment(SCENE_PARAMETERS
                                const __global float *numbers,  // [2][count]
                                __global float       *out,      // [11][count]
                                uint                  count)
{
    uint i = get_global_id(0) * VW;
    F3 sampled;
    F pdf;
    F3 d = environment_sample(LOAD_F(numbers, i), LOAD_F(numbers + count, i), SCENE, &sampled, &pdf);
    F3 met = environment_radiance(d, SCENE);
    F values[11] = {d.x, d.y, d.z, sampled.x, sampled.y, sampled.z, pdf, met.x, met.y, met.z, environment_pdf(d, SCENE)};
    for (int k = 0; k < 11; ++k)
        STORE_F(out + k * count, i, values[k]);
}
