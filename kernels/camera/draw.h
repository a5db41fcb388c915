// The random numbers and the wavelength of a camera ray, taken in the same way by every pass that needs them.
// Facts: FILTER, SPECTRUM.
#ifndef DRAW_H
#define DRAW_H
#include "camera/film_point.h"
#include "camera/filter.h"
#include "common/wavelength.h"

// What a ray is made of before it enters the camera.
typedef struct {
    Lane lane;
    F4   u;
    F    wavelength;
#if FILTER
    F    sign;
#endif
#if SPECTRUM
    F    wavelength_sample;
#endif
} Draw;

static inline Draw draw_of(Lane lane, uint2 seed, const __global Camera *camera, const __global float *filter,
                           const __global float *colours)
{
    Draw draw;
    draw.lane = lane;
    draw.u = random4(lane.pixel, lane.sample, (U)(0u), seed);
#if FILTER
    draw.sign = filter_sign(&draw.u.a, filter) * filter_sign(&draw.u.b, filter);
#endif
#if SPECTRUM
    draw.wavelength_sample = wavelength_sample_of(lane.pixel, lane.sample, seed);
    draw.wavelength = wavelength_of(draw.wavelength_sample, colours);
#else
    draw.wavelength = (F)(camera->wavelength);
#endif
    return draw;
}

#endif
