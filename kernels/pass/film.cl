// Adds a wave's radiances L to the film: one work item owns VW pixels and adds their samples in order.
// Fact: SPECTRUM.
#include "common/wavelength.h"
#include "integrator/film.h"
#include "integrator/state.h"

#if SPECTRUM
#define COLOURS , const __global float *colours     // common/wavelength.h
#define LIGHT(slot) film_value(READ_F3(L, slot), READ_F(WAVELENGTH_SAMPLE, slot), colours)
#else
#define COLOURS
#define LIGHT(slot) READ_F3(L, slot)
#endif

__kernel void film(__global const float *state,      // path state: L
                   __global float       *sums,       // [6][pixels]: r, g, b and their compensations
                   __global uint        *counters,
                   Wave                  wave,
                   uint                  capacity,   // slots in the state
                   uint                  pixels,     // pixels of the film incl. tile padding
                   const __global uint  *tiles       // that are rendered
                   COLOURS)
{
    uint first = get_global_id(0) * VW;
    uint pixel = film_place(first, wave, tiles);
    PixelSum sum = read_pixels(sums, pixel, pixels);
    for (uint k = 0; k < wave.samples; ++k) {
        uint slot = first + k * wave.pixels;
        sum = add_sample(sum, TRUE, scale(LIGHT(slot), READ_F(WEIGHT, slot)), counters);
    }
    write_pixels(sums, pixel, pixels, sum);
}
