// Adds samples that the host can make too to a few pixels of a film; the last one is not a number.
#include "common/rng.h"
#include "integrator/film.h"

__kernel void probe_film(__global float *sums,      // [6][pixels]
                         __global uint  *counters,
                         uint            pixels,
                         uint            first,     // sample of this launch
                         uint            samples,   // of this launch
                         uint            last)      // sample of all launches
{
    uint pixel = get_global_id(0) * VW;
    PixelSum sum = read_pixels(sums, pixel, pixels);
    U lane = AS_U(LANES) + pixel;
    for (uint k = first; k < first + samples; ++k) {
        U word = (lane + k * pixels) * 2654435761u;
        F even = unit_float(word);
        F rare = AS_I(word >> 20) == 0 ? (F)(1000.0f) : even;
        F tenth_or_none = k == last ? (F)(NAN) : (F)(0.1f);
        sum = add_sample(sum, TRUE, f3(even, rare, tenth_or_none), counters);
    }
    write_pixels(sums, pixel, pixels, sum);
}
