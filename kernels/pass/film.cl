// Adds a wave's radiances L to the film: one work item owns VW pixels and adds their samples in order.
// Facts: SPECTRUM, LIGHT_GROUPS.
#include "common/wavelength.h"
#include "integrator/film.h"
#include "integrator/state.h"

#if SPECTRUM
#define COLOURS , const __global float *colours     // common/wavelength.h
#define ON_FILM(light, slot) film_value(light, READ_F(WAVELENGTH_SAMPLE, slot), colours)
#else
#define COLOURS
#define ON_FILM(light, slot) (light)
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
        sum = add_sample(sum, TRUE, scale(ON_FILM(READ_F3(L, slot), slot), READ_F(WEIGHT, slot)), counters);
    }
    write_pixels(sums, pixel, pixels, sum);
#if LIGHT_GROUPS
#pragma nounroll
    for (int g = 0; g < LIGHT_GROUPS; ++g) {
        __global float *planes = planes_of_group(sums, pixels, g);
        sum = read_sums(planes, pixel, pixels);
        for (uint k = 0; k < wave.samples; ++k) {
            uint slot = first + k * wave.pixels;
            F weight = READ_F(WEIGHT, slot);
            sum = add_of_group(sum, TRUE, scale(ON_FILM(READ_F3(L, slot), slot), weight),
                               scale(ON_FILM(read_group(state, capacity, slot, g), slot), weight));
        }
        write_sums(planes, pixel, pixels, sum);
    }
#endif
}
