// The film: per pixel a Kahan sum of samples added in their order, so that it depends neither on the wave size nor on the
// number of samples (a float sum stops growing at 2^24 samples). A sample that is not finite is dropped and counted behind
// the rays by status.
#ifndef FILM_H
#define FILM_H
#include "common/math.h"

typedef struct { F3 sum, rest; } PixelSum;

static PixelSum read_pixels(__global const float *sums, uint pixel, uint pixels)
{
    PixelSum s;
    s.sum = f3(LOAD_F(sums, pixel), LOAD_F(sums + pixels, pixel), LOAD_F(sums + 2 * pixels, pixel));
    s.rest = f3(LOAD_F(sums + 3 * pixels, pixel), LOAD_F(sums + 4 * pixels, pixel), LOAD_F(sums + 5 * pixels, pixel));
    return s;
}

static void write_pixels(__global float *sums, uint pixel, uint pixels, PixelSum s)
{
    STORE_F(sums, pixel, s.sum.x);
    STORE_F(sums + pixels, pixel, s.sum.y);
    STORE_F(sums + 2 * pixels, pixel, s.sum.z);
    STORE_F(sums + 3 * pixels, pixel, s.rest.x);
    STORE_F(sums + 4 * pixels, pixel, s.rest.y);
    STORE_F(sums + 5 * pixels, pixel, s.rest.z);
}

static PixelSum add_sample(PixelSum s, I lanes, F3 value, __global uint *counters)
{
    I bad = lanes & (not_finite(value.x) | not_finite(value.y) | not_finite(value.z));
    if (ANY(bad)) {
        atomic_add(counters + RAY_STATUS_COUNT, COUNT(bad));
        lanes = lanes & NOT(bad);
    }
    F3 y = sub(value, s.rest);
    F3 t = add(s.sum, y);
    s.rest = select3(lanes, sub(sub(t, s.sum), y), s.rest);
    s.sum = select3(lanes, t, s.sum);
    return s;
}

#endif
