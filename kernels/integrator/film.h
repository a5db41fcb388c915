// The film: per pixel a Kahan sum of samples added in their order, so that it depends neither on the wave size nor on the
// number of samples (a float sum stops growing at 2^24 samples). A sample that is not finite is dropped and counted behind
// the rays by status. A limit scales brighter samples down, which is biased; how much that took is kept.
// Where the light of groups of lamps is kept apart, six planes of each group follow.
// Facts: CLAMP, the bits of the limit as a float, or 0 for none; LIGHT_GROUPS.
#ifndef FILM_H
#define FILM_H
#include "common/math.h"

typedef struct {
    F3 sum, rest;
#if CLAMP
    F  removed;     // of the mean of the channels; a plain sum, as it is for the statistics alone
#endif
} PixelSum;

// Three sums and their compensations, six planes from `planes` on.
static inline PixelSum read_sums(__global const float *planes, uint pixel, uint pixels)
{
    PixelSum s;
    s.sum = f3(LOAD_F(planes, pixel), LOAD_F(planes + pixels, pixel), LOAD_F(planes + 2 * pixels, pixel));
    s.rest = f3(LOAD_F(planes + 3 * pixels, pixel), LOAD_F(planes + 4 * pixels, pixel), LOAD_F(planes + 5 * pixels, pixel));
    return s;
}

static inline void write_sums(__global float *planes, uint pixel, uint pixels, PixelSum s)
{
    STORE_F(planes, pixel, s.sum.x);
    STORE_F(planes + pixels, pixel, s.sum.y);
    STORE_F(planes + 2 * pixels, pixel, s.sum.z);
    STORE_F(planes + 3 * pixels, pixel, s.rest.x);
    STORE_F(planes + 4 * pixels, pixel, s.rest.y);
    STORE_F(planes + 5 * pixels, pixel, s.rest.z);
}

static inline PixelSum read_pixels(__global const float *sums, uint pixel, uint pixels)
{
    PixelSum s = read_sums(sums, pixel, pixels);
#if CLAMP
    s.removed = LOAD_F(sums + 6 * pixels, pixel);
#endif
    return s;
}

static inline void write_pixels(__global float *sums, uint pixel, uint pixels, PixelSum s)
{
    write_sums(sums, pixel, pixels, s);
#if CLAMP
    STORE_F(sums + 6 * pixels, pixel, s.removed);
#endif
}

static inline I bad_value(F3 value)
{
    return not_finite(value.x) | not_finite(value.y) | not_finite(value.z);
}

static inline F largest_of(F3 value)
{
    return max3(f3(absolute(value.x), absolute(value.y), absolute(value.z)));
}

static inline PixelSum add_compensated(PixelSum s, I lanes, F3 value)
{
    F3 y = sub(value, s.rest);
    F3 t = add(s.sum, y);
    s.rest = select3(lanes, sub(sub(t, s.sum), y), s.rest);
    s.sum = select3(lanes, t, s.sum);
    return s;
}

static PixelSum add_sample(PixelSum s, I lanes, F3 value, __global uint *counters)
{
    I bad = lanes & bad_value(value);
    if (ANY(bad)) {
        atomic_add(counters + RAY_STATUS_COUNT, COUNT(bad));
        lanes = lanes & NOT(bad);
    }
#if CLAMP
    F most = largest_of(value);
    I bright = lanes & (most > as_float(CLAMP));
    if (ANY(bright)) {
        F keep = bright ? as_float(CLAMP) / most : ONE;
        s.removed += bright ? (1.0f - keep) * (absolute(value.x) + absolute(value.y) + absolute(value.z)) / 3.0f : ZERO;
        value = scale(value, keep);
    }
#endif
    return add_compensated(s, lanes, value);
}

#if LIGHT_GROUPS
#if CLAMP
#define GROUP_PLANES 7      // where those of the groups begin
#else
#define GROUP_PLANES 6
#endif

static inline __global float *planes_of_group(__global float *sums, uint pixels, int group)
{
    return sums + (size_t)(GROUP_PLANES + 6 * group) * pixels;
}

// Adds what a group has of a sample of the lanes, which is dropped and limited as the whole sample is.
static PixelSum add_of_group(PixelSum s, I lanes, F3 whole, F3 value)
{
#if CLAMP
    F most = largest_of(whole);
    value = scale(value, most > as_float(CLAMP) ? as_float(CLAMP) / most : ONE);
#endif
    return add_compensated(s, lanes & NOT(bad_value(whole)), value);
}
#endif

#endif
