// Shares of light that facets scatter once, from tables (rptcam_cl/rendering/plan/materials.py), at the direction in which light
// leaves: by the cosine and the azimuth that it has where the facets' slopes are stretched to alpha 1, which turns all that
// alpha makes narrow into smooth curves.
// Facts: FACET_SHARES; HAS_BRUSHED_SHARE (brushed facets, by both alphas), HAS_BRUSHED_BASE (above a diffuse base); HAS_AGAIN
// (rough glass, on either side). Each material has tables of its own, but where textures give
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
#if HAS_ANISOTROPY
    out.turn = by_angle(4.0f * turns_of(root(x2), root(y2)));
#else
    out.turn = ZERO;
#endif
    return out;
}

// Between which entries of a plane of directions that one lies, and how far: `beside` and `below` are steps to the next ones.
typedef struct { I first, beside, below; F down, across; } Entry;

static Entry entry_of(Stretched w, I turns)
{
    I row, column;
    Entry entry;
    entry.down = among(w.cosine, (I)(SHARE_COSINES), &row);
    entry.across = among(w.turn, turns, &column);
    entry.first = row * turns + column;
    entry.beside = turns > 1 ? (I)(1) : (I)(0);
    entry.below = turns;
    return entry;
}

// Of the plane that starts at `plane`.
static F share_at(const __global float *table, I plane, Entry entry)
{
    I at = plane + entry.first;
    F a = GATHER(F, table, at, );
    F below = GATHER(F, table, at + entry.below, );
#if HAS_ANISOTROPY
    if (ANY(entry.beside > 0)) {
        at += entry.beside;
        F b = GATHER(F, table, at, );
        a += entry.across * (b - a);
        b = GATHER(F, table, at + entry.below, );
        below += entry.across * (b - below);
    }
#endif
    return a + entry.down * (below - a);
}

#if HAS_BRUSHED_SHARE
// Of brushed facets by the tables at `first` for `count` alphas each way, the alphas of textures or those of the material alone:
// the share that meets further facets, where they absorb nothing. `risen` is the share that is reflected once by those that reflect
// more the more light grazes them: of a dielectric by f0, of plastic `risen` alone. `rise` is what one facet reflects at the cosine
// of the direction. Likewise their means over even light.
typedef struct { F again, again_mean, risen, risen_mean; } Brushed;

static Brushed brushed_shares(const __global float *table, I first, I count, Stretched w, Alpha alpha, F rise)
{
    I along, across;
    F x = among(alpha.x, count, &along);
    F y = among(alpha.y, count, &across);
    I step = count > 1 ? (I)(1) : (I)(0);
    Entry entry = entry_of(w, (I)(SHARE_TURNS));
    I planes = count * count;
    Brushed out;
    out.again = out.again_mean = out.risen = out.risen_mean = ZERO;
    for (int corner = 0; corner < 4; ++corner) {
        F weight = ((corner & 1) ? x : 1.0f - x) * ((corner & 2) ? y : 1.0f - y);
        I plane = (along + (corner & 1) * step) * count + across + (corner >> 1) * step;
        I at = first + plane * SHARE_DIRECTIONS;
        out.again += weight * share_at(table, at, entry);
        I mean = first + planes * SHARE_DIRECTIONS + plane;
        out.again_mean += weight * GATHER(F, table, mean, );
#if HAS_BRUSHED_BASE
        at += planes * (SHARE_DIRECTIONS + 1);
        mean += planes * (SHARE_DIRECTIONS + 1);
        out.risen += weight * share_at(table, at, entry);
        out.risen_mean += weight * GATHER(F, table, mean, );
#endif
    }
    out.risen = (1.0f - out.again) * MIN(MAX(out.risen + rise, ZERO), ONE);
    return out;
}
#endif

#if HAS_AGAIN
// Of a table of rough glass: where it starts, and at which of its levels of alpha a texture is. Lanes of 0 have none.
typedef struct {
    I table;
#if HAS_ROUGHNESS_TEXTURE
    I levels;
    F level;    // 0 to 1
#endif
#if HAS_ANISOTROPY
    I turns;
#endif
} Glass;

static inline Glass no_glass(void)
{
    Glass glass;
    glass.table = FALSE;
#if HAS_ROUGHNESS_TEXTURE
    glass.levels = (I)(1);
    glass.level = ZERO;
#endif
#if HAS_ANISOTROPY
    glass.turns = (I)(1);
#endif
    return glass;
}

static inline Glass select_Glass(I mine, Glass a, Glass b)
{
    a.table = mine ? a.table : b.table;
#if HAS_ROUGHNESS_TEXTURE
    a.levels = mine ? a.levels : b.levels;
    a.level = mine ? a.level : b.level;
#endif
#if HAS_ANISOTROPY
    a.turns = mine ? a.turns : b.turns;
#endif
    return a;
}

#if HAS_ANISOTROPY
#define TURNS_OF(glass) ((glass).turns)
#else
#define TURNS_OF(glass) ((I)(1))
#endif
#if HAS_ROUGHNESS_TEXTURE
#define LEVELS_OF(glass) ((glass).levels)
#else
#define LEVELS_OF(glass) ((I)(1))
#endif

// Share of the light of a direction, on its side of rough glass, that meets further facets.
static F glass_again(const __global float *table, Glass glass, I inside, Entry entry)
{
    I size = SHARE_COSINES * TURNS_OF(glass);
    I first = glass.table + (inside ? LEVELS_OF(glass) * size : FALSE);
#if HAS_ROUGHNESS_TEXTURE
    I low;
    F up = among(glass.level, glass.levels, &low);
    first = glass.table > 0 ? first + low * size : FALSE;
    F share = share_at(table, first, entry);
    I step = glass.levels > 1 ? size : FALSE;
    return ANY(step > 0) ? share + up * (share_at(table, first + step, entry) - share) : share;
#else
    return share_at(table, glass.table > 0 ? first : FALSE, entry);
#endif
}

#define AGAIN_MEAN 0    // of even light, outside and inside,
#define AGAIN_BACK 2    // and what of it leaves on the side on which it came

static F glass_number(const __global float *table, Glass glass, I what)
{
    I levels = LEVELS_OF(glass);
    I at = glass.table + levels * (2 * SHARE_COSINES * TURNS_OF(glass) + what);
#if HAS_ROUGHNESS_TEXTURE
    I low;
    F up = among(glass.level, levels, &low);
    at += low;
    F number = GATHER(F, table, at, );
    at += levels > 1 ? (I)(1) : (I)(0);
    F next = GATHER(F, table, at, );
    return number + up * (next - number);
#else
    return GATHER(F, table, at, );
#endif
}
#endif
#endif

#endif
