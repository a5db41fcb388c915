// Shares of light that facets scatter once, from tables (rptcam_cl/rendering/plan/materials.py), at the direction in which light
// leaves: by the cosine and the azimuth that it has where the facets' slopes are stretched to alpha 1, which turns all that
// alpha makes narrow into smooth curves.
// Facts: FACET_SHARES; HAS_BRUSHED_SHARE (metal) and HAS_BRUSHED_BASE (what lies under brushed facets), by both alphas; HAS_AGAIN
// (rough glass, of which the tables have what its facets scatter again). Each material has tables of its own, but where textures give
// both alphas.
#ifndef FACET_SHARES_H
#define FACET_SHARES_H
#include "common/angles.h"
#include "material/ggx.h"

#if FACET_SHARES
#define SHARE_DIRECTIONS (SHARE_COSINES * SHARE_TURNS)

// Where a number of 0 to 1 lies among `count` entries: the one before it, and how far it is to the next.
static inline F among(F x, I count, I *before)
{
    F place = MIN(MAX(x, ZERO), ONE) * TO_F(count - 1);
    *before = MAX(MIN(TO_I(place), count - 2), (I)(0));
    return place - TO_F(*before);
}

typedef struct { F cosine, turn; } Stretched;      // 0 to 1: by the angle whose cosine is 1 - 2 z, z the cosine or a quarter turn's part

static inline F by_angle(F z) { return 2.0f * turns_of(1.0f - 2.0f * z, 2.0f * root(z * (1.0f - z))); }

// A direction of that cosine to the normal, `x` of it along the tangent.
static Stretched stretched(F cosine, F x, Alpha alpha)
{
    F z2 = cosine * cosine;
    F x2 = MIN(x * x, 1.0f - z2);
    F y2 = 1.0f - z2 - x2;
    x2 *= alpha.x * alpha.x;
    y2 *= ACROSS(alpha) * ACROSS(alpha);
    F z = sqrt(z2 / MAX(x2 + y2 + z2, (F)(SMALLEST)));
    Stretched out;
    out.cosine = by_angle(z);
    out.turn = by_angle(4.0f * turns_of(root(x2), root(y2)));
    return out;
}

// Between the entries of a plane of directions that starts at `first`.
static F share_of_direction(const __global float *table, I first, Stretched w, I turns)
{
    I row, column;
    F down = among(w.cosine, (I)(SHARE_COSINES), &row);
    F across = among(w.turn, turns, &column);
    I at = first + row * turns + column;
    I next = at + (turns > 1 ? (I)(1) : (I)(0));
    F a = GATHER(F, table, at, );
    F b = GATHER(F, table, next, );
    at += turns;
    next += turns;
    a += across * (b - a);
    b = GATHER(F, table, at, );
    b += across * (GATHER(F, table, next, ) - b);
    return a + down * (b - a);
}

#if HAS_BRUSHED_SHARE || HAS_BRUSHED_BASE
// Of brushed facets by the tables at `first` for `count` alphas each way, the alphas of textures or those of the material alone.
// `risen` is the share of those that reflect more the more light grazes them: of a dielectric `share` and `risen` by f0, of plastic
// `risen` alone. `rise` is what one facet reflects at the cosine of the direction. Likewise their means over even light.
typedef struct { F once, once_mean, risen, risen_mean; } Brushed;

static Brushed brushed_shares(const __global float *table, I first, I count, Stretched w, Alpha alpha, F rise)
{
    I along, across;
    F x = among(alpha.x, count, &along);
    F y = among(alpha.y, count, &across);
    I step = count > 1 ? (I)(1) : (I)(0);
    I planes = count * count;
    Brushed out;
    out.once = out.once_mean = out.risen = out.risen_mean = ZERO;
    for (int corner = 0; corner < 4; ++corner) {
        F weight = ((corner & 1) ? x : 1.0f - x) * ((corner & 2) ? y : 1.0f - y);
        I plane = (along + (corner & 1) * step) * count + across + (corner >> 1) * step;
        I at = first + plane * SHARE_DIRECTIONS;
        out.once += weight * share_of_direction(table, at, w, (I)(SHARE_TURNS));
        I mean = first + planes * SHARE_DIRECTIONS + plane;
        out.once_mean += weight * GATHER(F, table, mean, );
#if HAS_BRUSHED_BASE
        at += planes * (SHARE_DIRECTIONS + 1);
        mean += planes * (SHARE_DIRECTIONS + 1);
        out.risen += weight * share_of_direction(table, at, w, (I)(SHARE_TURNS));
        out.risen_mean += weight * GATHER(F, table, mean, );
#endif
    }
    out.risen = out.once * MIN(MAX(out.risen + rise, ZERO), ONE);
    return out;
}
#endif

#if HAS_AGAIN
#define GAIN_REFLECTED 0
#define GAIN_PASSED    1
#define REFLECTS_MORE  2    // odds of being reflected, over those by light that is scattered once

// What rough glass k gains at one of the two directions of its BSDF, by that one's side and what becomes of the light, at `level` (0 to
// 1) of the alphas that a texture gives.
static F glass_gain(const __global float *table, const __global Material *materials, I k, I inside, I what, Stretched w, F level)
{
    I plane = (inside ? (I)(3) : (I)(0)) + what;
    I levels = GATHER(I, materials, k, .share_levels), turns = GATHER(I, materials, k, .share_turns);
    I size = SHARE_COSINES * turns;
    I low;
    F up = among(level, levels, &low);
    I at = levels > 0 ? GATHER(I, materials, k, .share_table) + (plane * levels + low) * size : (I)(0);
    F a = share_of_direction(table, at, w, turns);
    at += levels > 1 ? size : (I)(0);
    return a + up * (share_of_direction(table, at, w, turns) - a);
}
#endif
#endif

#endif
