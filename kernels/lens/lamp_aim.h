// Aiming at lamps out of focus. A small lamp that the film sees unsharp fills a small part of the pupil, which rays that are
// spread over all of it hardly ever find. So some of the rays of a film point aim where the lamp should be. The density of a
// ray is the sum over both ways to choose it, whatever the tables say, which therefore change noise and never the mean.
// Tables (rptcam_cl/rendering/cameras/lamp_aim.py), from camera->lamp_table on:
//   area of the aperture of a thin lens;
//   per block of pixels: where its lamps stand, and how many;
//   per lamp of a block, LAMP floats: the share of the rays; the place in the pupil as an affine map of the film point (u: of
//   1, x, y; v: likewise) and what an inverse wavelength adds (u, v); the map from the unit disk or square to the lamp's part
//   of the pupil (row u, row v), whether it is a disk; the circle of the pupil within which the lamp shows (u, v, square of
//   the radius); how far beyond the pupil's outline that is, 0 where the block sees no outline.
// PUPIL_HOLDS(fx, fy, u, v): whether the pupil that a film point sees holds a place, defined by the camera.
// Facts: LAMP_AIM; LAMP_COLOURS, whether rays have a wavelength.
#ifndef LAMP_AIM_H
#define LAMP_AIM_H
#include "common/records.h"

#if LAMP_AIM
#define LAMP 18
#define BESIDE 0.35f      // of its share, for a lamp less than half of which shows at the rim of the pupil

// How a ray was chosen, and the film point and colour on which that depends.
typedef struct {
    F fx, fy, colour;
    I block;            // where the block of the lane stands in the tables
    I aims;             // whether the ray aims at a lamp
    F u;                // first number of the pupil anew, for those that do not
    F x, y;             // place in the pupil, for those that do
    F rest;             // probability of no lamp
    I which;            // place of the chosen lamp in its block, -1 without one
} LampAim;

static inline I block_of(Lane lane, const __global Camera *camera)
{
    I x = MIN(lane.x >> camera->lamp_shift, (I)(camera->lamp_across - 1));
    I y = MIN(lane.y >> camera->lamp_shift, (I)(camera->lamp_down - 1));
    return (y * camera->lamp_across + x) * 2 + (camera->lamp_table + 1);
}

// The middle of a lamp in the pupil, and the probability that a ray aims at it.
static F lamp_share(const __global float *lamp, const LampAim *a, I mine, F *x, F *y, const __global Camera *camera,
                    const __global float *tables)
{
    *x = lamp[1] + lamp[2] * a->fx + lamp[3] * a->fy;
    *y = lamp[4] + lamp[5] * a->fx + lamp[6] * a->fy;
#if LAMP_COLOURS
    *x += lamp[7] * a->colour;
    *y += lamp[8] * a->colour;
#endif
    F off_x = *x - lamp[14];
    F off_y = *y - lamp[15];
    F off2 = off_x * off_x + off_y * off_y;
    I shows = mine & (off2 < lamp[16]);
    F share = shows ? (F)(lamp[0]) : ZERO;
    if (lamp[17] > 0.0f && ANY(shows)) {
        F inwards = MAX(1.0f - lamp[17] / sqrt(MAX(off2, (F)(SMALLEST))), ZERO);
        share *= PUPIL_HOLDS(a->fx, a->fy, *x, *y) ? ONE : (F)(BESIDE);
        share = PUPIL_HOLDS(a->fx, a->fy, lamp[14] + inwards * off_x, lamp[15] + inwards * off_y) ? share : ZERO;
    }
    return share;
}

// Takes part of the first number's range for every lamp that the film point (fx, fy) may see, and gives the rest back.
static LampAim aim_at_lamps(Lane lane, F fx, F fy, F wavelength, F u, F v, const __global Camera *camera,
                            const __global float *tables)
{
    LampAim a;
    a.fx = fx;
    a.fy = fy;
#if LAMP_COLOURS
    a.colour = DISPERSION_SCALE / wavelength - DISPERSION_SHIFT;
#endif
    a.block = block_of(lane, camera);
    a.aims = FALSE;
    a.which = (I)(-1);
    a.x = a.y = a.rest = ZERO;
    I count = TO_I(GATHER(F, tables + 1, a.block, ));
    I left = count > 0;
    while (ANY(left)) {
        int block = first_of(a.block, left);
        I mine = left & (a.block == block);
        const __global float *lamp = tables + camera->lamp_table + (int)tables[block];
        for (int k = 0; k < (int)tables[block + 1]; ++k, lamp += LAMP) {
            F x, y;
            F share = lamp_share(lamp, &a, mine, &x, &y, camera, tables);
            I here = (u >= a.rest) & (u < a.rest + share);
            if (ANY(here)) {
                F along = MIN((u - a.rest) / share, (F)(0.99999994f));
                F s, c;
                sincos_turns(along, &s, &c);
                F r = sqrt(v);
                F p = lamp[13] > 0.0f ? r * c : 2.0f * along - 1.0f;
                F q = lamp[13] > 0.0f ? r * s : 2.0f * v - 1.0f;
                a.x = here ? x + lamp[9] * p + lamp[10] * q : a.x;
                a.y = here ? y + lamp[11] * p + lamp[12] * q : a.y;
                a.which = here ? (I)(k) : a.which;
            }
            a.rest += share;
        }
        left = left & NOT(mine);
    }
    a.aims = a.which >= 0;
    a.u = a.aims ? u : MIN((u - a.rest) / (1.0f - a.rest), (F)(0.99999994f));
    a.rest = 1.0f - a.rest;
    return a;
}

// Density with which rays that aim at lamps go through a place of the pupil.
static F density_of_lamps(const LampAim *a, F px, F py, const __global Camera *camera, const __global float *tables)
{
    F sum = ZERO;
    I left = a->rest < 1.0f;
    while (ANY(left)) {
        int block = first_of(a->block, left);
        I mine = left & (a->block == block);
        const __global float *lamp = tables + camera->lamp_table + (int)tables[block];
        for (int k = 0; k < (int)tables[block + 1]; ++k, lamp += LAMP) {
            F x, y;
            F share = lamp_share(lamp, a, mine, &x, &y, camera, tables);
            float determinant = lamp[9] * lamp[12] - lamp[10] * lamp[11];
            float inverse = 1.0f / determinant;
            F p = (lamp[12] * (px - x) - lamp[10] * (py - y)) * inverse;
            F q = (lamp[9] * (py - y) - lamp[11] * (px - x)) * inverse;
            I inside = lamp[13] > 0.0f ? p * p + q * q < 1.0f : (absolute(p) < 1.0f) & (absolute(q) < 1.0f);
            inside |= a->which == k;                     // whatever rounding says
            float density = fabs(inverse) / (lamp[13] > 0.0f ? PI_F : 4.0f);
            sum += inside ? share * density : ZERO;
        }
        left = left & NOT(mine);
    }
    return sum;
}
#endif

#endif
