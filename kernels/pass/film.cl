// Adds a wave's radiances L to the film: one work item owns VW pixels and adds their samples in order.
#include "integrator/film.h"
#include "integrator/state.h"

static F3 weighted(__global const float *state, uint slot, uint capacity)
{
    return scale(READ_F3(L, slot), READ_F(WEIGHT, slot));
}

__kernel void film(__global const float *state,      // path state: L
                   __global float       *sums,       // [6][pixels]: r, g, b and their compensations
                   __global uint        *counters,
                   Wave                  wave,
                   uint                  capacity,   // slots in the state
                   uint                  pixels,     // pixels of the film incl. tile padding
                   const __global uint  *tiles)      // that are rendered
{
    uint first = get_global_id(0) * VW;
    uint pixel = film_place(first, wave, tiles);
    PixelSum sum = read_pixels(sums, pixel, pixels);
    for (uint k = 0; k < wave.samples; ++k)
        sum = add_sample(sum, TRUE, weighted(state, first + k * wave.pixels, capacity), counters);
    write_pixels(sums, pixel, pixels, sum);
}
