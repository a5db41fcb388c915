// The column of a ray through a medium: how far it would go, as dense as the medium is below the base of its layer, to lose
// as much light. Density is even up to the base and falls exponentially above it, so that the column and its inverse are
// closed forms. Sums of parts that are all positive: nothing cancels, however flat a ray runs.
// Fact: HAS_LAYERED_FOG; where no medium has a layer, columns are lengths.
#ifndef COLUMN_H
#define COLUMN_H
#include "material/medium.h"

#if HAS_LAYERED_FOG
#define THINNEST_HEIGHT 60.0f   // scale heights above the base, where 1e-26 of the density is left

// Of a ray: how high above the base it starts, and how much it rises per metre; both in scale heights.
typedef struct { F start, slope; } Ascent;

static inline Ascent ascent_of(Inside m, Ray ray)
{
    Ascent a;
    a.start = dot3(m.rise, ray.o) - m.base;
    a.slope = dot3(m.rise, ray.d);
    return a;
}

// Density at a distance, as a share of that below the base.
static inline F relative_density(Inside m, Ray ray, F t)
{
    Ascent a = ascent_of(m, ray);
    return exponential(-MAX(a.start + a.slope * t, ZERO));
}

static F column_of(Inside m, Ray ray, F length)
{
    Ascent a = ascent_of(m, ray);
    I climbs = a.slope >= 0.0f;
    I even = a.start < 0.0f;                // where it starts
    F steep = absolute(a.slope);
    F away = absolute(a.start);
    F first = away < steep * length ? away / MAX(steep, (F)(SMALLEST)) : length;    // to the base, where it nears that
    first = MIN(first, length);
    F second = length - first;
    F below = even ? (climbs ? first : length) : (climbs ? ZERO : second);
    F above = even ? (climbs ? second : ZERO) : (climbs ? length : first);
    F lowest = MAX(climbs ? a.start : a.start - steep * above, ZERO);
    return below + above * exponential(-lowest) * mean_transmittance(steep * above);
}

// Distance at which a ray has gone through a column; FARTHEST where it never does.
static F distance_after(Inside m, Ray ray, F column)
{
    Ascent a = ascent_of(m, ray);
    I climbs = a.slope >= 0.0f;
    F steep = MAX(absolute(a.slope), (F)(1e-30f));
    // Climb to the base, or sink to where something is scattered at all.
    F level = (climbs & (a.start < 0.0f)) ? MIN(-a.start / steep, (F)(FARTHEST)) : ZERO;
    F empty = climbs ? ZERO : MAX(a.start - THINNEST_HEIGHT, ZERO) / steep;
    F height = MAX(a.start, ZERO);
    height = climbs ? height : MIN(height, (F)(THINNEST_HEIGHT));
    // Solve density (1 - exp(-slope t)) / slope = column, which is density t where the slope is small.
    F density = MAX(exponential(-height), (F)(SMALLEST));
    F rest = MAX(column - level, ZERO);
    F z = rest * steep / density;
    z = climbs ? -z : z;
    F w = z / (2.0f + z);
    F w2 = w * w;
    F series = 1.0f + w2 * (0.333333333f + w2 * (0.2f + w2 * (0.142857143f + w2 * 0.111111111f)));
    F flat = rest / density * (1.0f - w) * series;
    F curved = logarithm(MAX(1.0f + z, (F)(SMALLEST))) / (climbs ? -steep : steep);
    F changing = absolute(z) < 0.4f ? flat : curved;
    // Go on where that ends: below the base, or nowhere.
    F fall = height / steep;
    F fallen = fall * mean_transmittance(height);
    F up = column <= level ? column : (z > -1.0f ? level + changing : (F)(FARTHEST));
    F down = empty + (column > fallen ? fall + (column - fallen) : changing);
    return MIN(MAX(climbs ? up : down, ZERO), (F)(FARTHEST));
}
#else
#define column_of(medium, ray, length)      (length)
#define distance_after(medium, ray, column) (column)
#endif

#endif
