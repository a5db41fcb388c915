// The wavelength of a path. A path's hue, 0 to 1, chooses among cells that are equally likely; `colours` holds for each cell
// (rptcam_cl/plan/spectrum.py) the wavelength [nm] where it starts and what light of the cell adds to red, green and blue of
// the film, and one row more.
// Fact: SPECTRUM.
#ifndef WAVELENGTH_H
#define WAVELENGTH_H
#include "common/math.h"

#if SPECTRUM
static F wavelength_of(F hue, const __global float *colours)
{
    F place = hue * (float)HUE_CELLS;
    I cell = TO_I(place);
    F start = GATHER(F, colours, cell * 4, );
    F end = GATHER(F, colours, cell * 4 + 4, );
    return start + (place - TO_F(cell)) * (end - start);
}

// What a path's light adds to the film: its red, green and blue, each by how much of it has the path's wavelength.
static F3 film_value(F3 light, F hue, const __global float *colours)
{
    I cell = TO_I(hue * (float)HUE_CELLS) * 4;
    return mul(light,
               f3(GATHER(F, colours, cell + 1, ), GATHER(F, colours, cell + 2, ), GATHER(F, colours, cell + 3, )));
}
#endif

#endif
