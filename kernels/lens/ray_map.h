// Polynomials in place of the surfaces of a lens (rptcam_cl/rendering/cameras/ray_map.py). With x the film point and y the place in
// the pupil, both scaled, heights and sideways directions are A x + B y; A, B and what lies along the axis are polynomials
// in x.x, x.y, y.y and the colour. `map` holds 1 / scale of x, how far y moves with x, 1 / scale of y, a free place; per
// term A and B of the point, A and B of the direction, and both along the axis; then per term A and B of the height at each
// rim.
// Facts: MAP_ORDER, MAP_RIM_ORDER (1 to 4), MAP_RIMS, MAP_COLOURS (whether rays have a wavelength).
#ifndef RAY_MAP_H
#define RAY_MAP_H
#include "common/records.h"

#define MAP_HEAD 4
#define MAP_RAY  6

// Terms up to a degree in xx, xy, yy, as `exponents` has them.
#define TERMS_0(T) T(ONE)
#define TERMS_1(T) TERMS_0(T) T(xx) T(xy) T(yy)
#define TERMS_2(T) TERMS_1(T) T(xx * xx) T(xx * xy) T(xx * yy) T(xy * xy) T(xy * yy) T(yy * yy)
#define TERMS_3(T) TERMS_2(T) T(xx * xx * xx) T(xx * xx * xy) T(xx * xx * yy) T(xx * xy * xy) T(xx * xy * yy) \
    T(xx * yy * yy) T(xy * xy * xy) T(xy * xy * yy) T(xy * yy * yy) T(yy * yy * yy)
#define TERMS_4(T) TERMS_3(T) T(xx * xx * xx * xx) T(xx * xx * xx * xy) T(xx * xx * xx * yy) T(xx * xx * xy * xy) \
    T(xx * xx * xy * yy) T(xx * xx * yy * yy) T(xx * xy * xy * xy) T(xx * xy * xy * yy) T(xx * xy * yy * yy) \
    T(xx * yy * yy * yy) T(xy * xy * xy * xy) T(xy * xy * xy * yy) T(xy * xy * yy * yy) T(xy * yy * yy * yy) \
    T(yy * yy * yy * yy)

// The same and, with every power of the colour, those of one degree less.
#if MAP_COLOURS
#define NEXT_POWER power *= colour;
#define GRADED_1(T) TERMS_1(T) NEXT_POWER TERMS_0(T)
#define GRADED_2(T) TERMS_2(T) NEXT_POWER TERMS_1(T) NEXT_POWER TERMS_0(T)
#define GRADED_3(T) TERMS_3(T) NEXT_POWER TERMS_2(T) NEXT_POWER TERMS_1(T) NEXT_POWER TERMS_0(T)
#define GRADED_4(T) TERMS_4(T) NEXT_POWER TERMS_3(T) NEXT_POWER TERMS_2(T) NEXT_POWER TERMS_1(T) NEXT_POWER TERMS_0(T)
#define POWER(term) (power * (term))
#else
#define GRADED_1 TERMS_1
#define GRADED_2 TERMS_2
#define GRADED_3 TERMS_3
#define GRADED_4 TERMS_4
#define POWER(term) (term)
#endif
#define JOINED(a, b)     a##b
#define GRADED_OF(order) JOINED(GRADED_, order)

// A film point and a place in the pupil with their invariants.
typedef struct {
    F x0, x1, y0, y1;
    F xx, xy, yy;
    F colour;
} MapPoint;

static MapPoint map_point(F fx, F fy, F u, F v, F wavelength, const __global float *map)
{
    MapPoint at;
    at.x0 = fx * map[0];
    at.x1 = fy * map[0];
    at.y0 = (u - map[1] * fx) * map[2];
    at.y1 = (v - map[1] * fy) * map[2];
    at.xx = at.x0 * at.x0 + at.x1 * at.x1;
    at.xy = at.x0 * at.y0 + at.x1 * at.y1;
    at.yy = at.y0 * at.y0 + at.y1 * at.y1;
#if MAP_COLOURS
    at.colour = DISPERSION_SCALE / wavelength - DISPERSION_SHIFT;
#endif
    return at;
}

#define ADD_RAY(term) { F t = POWER(term); for (int k = 0; k < MAP_RAY; ++k) sums[k] += t * c[k]; c += MAP_RAY; }
#define ADD_RIM(term) { F t = POWER(term); for (int k = 0; k < 2 * MAP_RIMS; ++k) sums[k] += t * c[k]; c += 2 * MAP_RIMS; }

// Where a ray leaves the first surface, z from its vertex towards the scene, and its unit direction. Returns what follows in
// the table.
static const __global float *mapped_ray(MapPoint at, const __global float *map, F3 *p, F3 *d)
{
    F xx = at.xx, xy = at.xy, yy = at.yy, sums[MAP_RAY];
    const __global float *c = map + MAP_HEAD;
    for (int k = 0; k < MAP_RAY; ++k)
        sums[k] = ZERO;
#if MAP_COLOURS
    F colour = at.colour, power = ONE;
#endif
    GRADED_OF(MAP_ORDER)(ADD_RAY)
    *p = f3(sums[0] * at.x0 + sums[1] * at.y0, sums[0] * at.x1 + sums[1] * at.y1, sums[4]);
    *d = normalized(f3(sums[2] * at.x0 + sums[3] * at.y0, sums[2] * at.x1 + sums[3] * at.y1, sums[5]));
    return c;
}

// Whether a ray passes every rim, and the stop in its shape; `c` is the part of the table that follows the rays.
static I within_mapped_rims(MapPoint at, const __global float *c, const __global Surface *rims, const __global float *stop)
{
    F xx = at.xx, xy = at.xy, yy = at.yy, sums[2 * MAP_RIMS];
    for (int k = 0; k < 2 * MAP_RIMS; ++k)
        sums[k] = ZERO;
#if MAP_COLOURS
    F colour = at.colour, power = ONE;
#endif
    GRADED_OF(MAP_RIM_ORDER)(ADD_RIM)
    I within = TRUE;
    for (int k = 0; k < MAP_RIMS; ++k) {
        F3 height = f3(sums[2 * k] * at.x0 + sums[2 * k + 1] * at.y0, sums[2 * k] * at.x1 + sums[2 * k + 1] * at.y1, ZERO);
        within = within & within_rim(rims + k, stop, height);
    }
    return within;
}

#endif
