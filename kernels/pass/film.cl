// Adds a wave's radiances to the film: one work item owns VW pixels and adds their samples in order by Kahan's sum, so the
// film does not depend on the wave size. A value that is not finite is dropped and counted.
#include "common/records.h"

__kernel void film(__global const float *state,      // path state: L
                   __global float       *sums,       // [6][pixels]: r, g, b and their compensations
                   __global uint        *not_finite_count,
                   Wave                  wave,
                   uint                  capacity,   // slots in the state
                   uint                  pixels)     // pixels of the film incl. tile padding
{
    uint first = get_global_id(0) * VW;
    uint pixel = wave.first_pixel + first;
    F3 sum = f3(LOAD_F(sums, pixel), LOAD_F(sums + pixels, pixel), LOAD_F(sums + 2 * pixels, pixel));
    F3 rest = f3(LOAD_F(sums + 3 * pixels, pixel), LOAD_F(sums + 4 * pixels, pixel), LOAD_F(sums + 5 * pixels, pixel));
    for (uint k = 0; k < wave.samples; ++k) {
        uint slot = first + k * wave.pixels;
        F3 value = READ_F3(L, slot);
        I bad = not_finite(value.x) | not_finite(value.y) | not_finite(value.z);
        if (ANY(bad)) {
            value = keep3(NOT(bad), value);
            atomic_add(not_finite_count, COUNT(bad));
        }
        F3 y = sub(value, rest);
        F3 t = add(sum, y);
        rest = sub(sub(t, sum), y);
        sum = t;
    }
    STORE_F(sums, pixel, sum.x);
    STORE_F(sums + pixels, pixel, sum.y);
    STORE_F(sums + 2 * pixels, pixel, sum.z);
    STORE_F(sums + 3 * pixels, pixel, rest.x);
    STORE_F(sums + 4 * pixels, pixel, rest.y);
    STORE_F(sums + 5 * pixels, pixel, rest.z);
}
