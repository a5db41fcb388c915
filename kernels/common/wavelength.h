// The wavelengths of a path. Its wavelength sample, 0 to 1, chooses among cells that are equally likely. `colours` holds
// (rptcam_cl/rendering/plan/plan.py) for each cell the wavelength [nm] where it starts and what light of the cell adds to red,
// green and blue of the film, and one row more. Spectral light is followed at two wavelengths more, a third and two
// thirds of the cells ahead (hero wavelengths: Wilkie et al. 2014); the table then goes on with the share of each cell's
// light that a red, a green and a blue surface reflect and the light of white, then with the spectra of the scene.
// The sign bit of the sample is set once glass has split the path: only then RGB light is weighted by its wavelength, and
// of spectral light the first wavelength alone stays.
// Facts: SPECTRUM, WAVELENGTH_CELLS, SPECTRAL_COLOURS (whether colours are wanted at these wavelengths), HAS_SPECTRA,
// LENS_SPLITS.
#ifndef WAVELENGTH_H
#define WAVELENGTH_H
#include "common/math.h"
#include "common/sampler.h"

#if LENS_SPLITS && SPECTRUM == SPECTRUM_SPECTRAL
#define FIRST_BETA f3((F)(3.0f), ZERO, ZERO)      // the lens lets one of three wavelengths pass on a path
#else
#define FIRST_BETA f3(ONE, ONE, ONE)
#endif

#if SPECTRUM
static inline F wavelength_sample_of(U pixel, U sample, uint2 seed)
{
    F wavelength_sample = path_numbers(pixel, sample, seed).a;
#if LENS_SPLITS
    wavelength_sample = AS_F(AS_I(wavelength_sample) | SIGN_BIT);
#endif
    return wavelength_sample;
}

static inline F wavelength_of(F wavelength_sample, const __global float *colours)
{
    F place = absolute(wavelength_sample) * (float)WAVELENGTH_CELLS;
    I cell = TO_I(place);
    F start = GATHER(F, colours, cell * 4, );
    F end = GATHER(F, colours, cell * 4 + 4, );
    return start + (place - TO_F(cell)) * (end - start);
}

// As polynomials of indices take it.
static inline F inverse_wavelength(F wavelength_sample, const __global float *colours)
{
    return (float)DISPERSION_SCALE / wavelength_of(wavelength_sample, colours) - (float)DISPERSION_SHIFT;
}

static inline F3 cell_weight(I cell, const __global float *colours)
{
    return f3(GATHER(F, colours, cell * 4 + 1, ), GATHER(F, colours, cell * 4 + 2, ),
              GATHER(F, colours, cell * 4 + 3, ));
}

#if SPECTRUM == SPECTRUM_SPECTRAL
// The cells of a path's three wavelengths.
typedef struct { I x, y, z; } Cells;

static inline Cells cells_of(F wavelength_sample)
{
    Cells c;
    c.x = TO_I(absolute(wavelength_sample) * (float)WAVELENGTH_CELLS);
    c.y = c.x + WAVELENGTH_CELLS / 3;
    c.z = c.x + 2 * (WAVELENGTH_CELLS / 3);
    c.y = c.y < WAVELENGTH_CELLS ? c.y : c.y - WAVELENGTH_CELLS;
    c.z = c.z < WAVELENGTH_CELLS ? c.z : c.z - WAVELENGTH_CELLS;
    return c;
}

// What a path's light at its three wavelengths adds to the film.
static inline F3 film_value(F3 light, F wavelength_sample, const __global float *colours)
{
    Cells c = cells_of(wavelength_sample);
    F3 sum = scale(cell_weight(c.x, colours), light.x);
    sum = add(sum, scale(cell_weight(c.y, colours), light.y));
    sum = add(sum, scale(cell_weight(c.z, colours), light.z));
    return scale(sum, (F)(1.0f / 3.0f));
}
#else
// How much of red, green and blue light has the path's wavelength: 1 in the mean.
static inline F3 share_of_wavelength(F wavelength_sample, const __global float *colours)
{
    return cell_weight(TO_I(absolute(wavelength_sample) * (float)WAVELENGTH_CELLS), colours);
}

// What a path's light adds to the film. What glass of the scene has split is weighted already.
static inline F3 film_value(F3 light, F wavelength_sample, const __global float *colours)
{
#if LENS_SPLITS
    light = mul(light, share_of_wavelength(wavelength_sample, colours));
#endif
    return light;
}
#endif
#endif

#if SPECTRAL_COLOURS
// What colours are at the wavelengths of a path.
typedef struct {
    F3    red, green, blue;     // reflectances of surfaces of these colours
    F3    white;                // light of 1, 1, 1
    Cells cells;
} SpectralColours;

#define SURFACE_COLOURS ((WAVELENGTH_CELLS + 1) * 4)
#define SPECTRA         (SURFACE_COLOURS + WAVELENGTH_CELLS * 4)

static inline F3 at_cells(Cells c, int stride, int place, const __global float *table)
{
    return f3(GATHER(F, table, c.x * stride + place, ), GATHER(F, table, c.y * stride + place, ),
              GATHER(F, table, c.z * stride + place, ));
}

static inline SpectralColours spectral_colours_of(F wavelength_sample, const __global float *colours)
{
    SpectralColours h;
    h.cells = cells_of(wavelength_sample);
    h.red = at_cells(h.cells, 4, SURFACE_COLOURS, colours);
    h.green = at_cells(h.cells, 4, SURFACE_COLOURS + 1, colours);
    h.blue = at_cells(h.cells, 4, SURFACE_COLOURS + 2, colours);
    h.white = at_cells(h.cells, 4, SURFACE_COLOURS + 3, colours);
    return h;
}

// A coefficient or a share of light given as red, green and blue (Mallett and Yuksel 2019).
static inline F3 surface_in(SpectralColours h, F3 rgb)
{
    return add(add(scale(h.red, rgb.x), scale(h.green, rgb.y)), scale(h.blue, rgb.z));
}

// Light given as red, green and blue.
static inline F3 light_in(SpectralColours h, F3 rgb) { return mul(surface_in(h, rgb), h.white); }

// The same where a spectrum may be known: `number` counts the scene's from 1, and is 0 where there is none.
#if HAS_SPECTRA
static inline F3 known_at(SpectralColours h, int number, const __global float *colours)
{
    return at_cells(h.cells, 1, SPECTRA + (number - 1) * WAVELENGTH_CELLS, colours);
}
#endif

static inline F3 surface_colour(SpectralColours h, F3 rgb, float number, const __global float *colours)
{
#if HAS_SPECTRA
    if (number > 0.0f)
        return known_at(h, (int)number, colours);
#endif
    return surface_in(h, rgb);
}

static inline F3 light_colour(SpectralColours h, F3 rgb, float number, const __global float *colours)
{
#if HAS_SPECTRA
    if (number > 0.0f)
        return known_at(h, (int)number, colours);
#endif
    return light_in(h, rgb);
}

#if HAS_SPECTRA
// Of lamps that differ between lanes.
static inline F3 lamp_colour(SpectralColours h, F3 rgb, F number, const __global float *colours)
{
    F3 light = light_in(h, rgb);
    I known = number > 0.0f;
    if (ANY(known)) {
        I place = (I)(SPECTRA) + (TO_I(MAX(number, ONE)) - 1) * WAVELENGTH_CELLS;
        light = select3(known, f3(GATHER(F, colours, place + h.cells.x, ), GATHER(F, colours, place + h.cells.y, ),
                                  GATHER(F, colours, place + h.cells.z, )), light);
    }
    return light;
}
#else
#define lamp_colour(h, rgb, number, colours) light_in(h, rgb)
#endif
#endif

#endif
