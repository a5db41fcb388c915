// A uniform point of an aperture of radius 1, without rejection, by warps that keep areas and tear nothing apart which the
// sampler spreads evenly: u turns and v goes outwards, through the disc or a fan of triangles; in a mask, u goes through the
// rows and v along one. Tables come from rptcam_cl/rendering/cameras/ideal.py:
//   APERTURE_PARTS  the curve of so many triangles, and of each one its apex and two edges, from there and then on
//   APERTURE_ROWS   the curve of so many rows of a mask, from the bottom, and those of as many cells of each row
#ifndef APERTURE_H
#define APERTURE_H
#include "common/curve.h"

static void aperture_point(F u, F v, const __global float *tables, F *x, F *y)
{
#if APERTURE_PARTS
    F along, share;
    I at = cell_at(tables, FALSE, APERTURE_PARTS, u, &along, &share) * 6 + CURVE(APERTURE_PARTS);
    F out = sqrt(v);
    *x = GATHER(F, tables, at, ) + out * (GATHER(F, tables + 2, at, ) + along * GATHER(F, tables + 4, at, ));
    *y = GATHER(F, tables + 1, at, ) + out * (GATHER(F, tables + 3, at, ) + along * GATHER(F, tables + 5, at, ));
#elif APERTURE_ROWS
    F of_row, of_cell, share;
    I row = cell_at(tables, FALSE, APERTURE_ROWS, u, &of_row, &share);
    I column = cell_at(tables, (row + 1) * CURVE(APERTURE_ROWS), APERTURE_ROWS, v, &of_cell, &share);
    *x = (TO_F(column) + of_cell) * (2.0f / APERTURE_ROWS) - 1.0f;
    *y = (TO_F(row) + of_row) * (2.0f / APERTURE_ROWS) - 1.0f;
#else
    F s, c;
    sincos_turns(u, &s, &c);
    F r = sqrt(v);
    *x = r * c;
    *y = r * s;
#endif
}

#if LAMP_AIM
static I aperture_holds(F x, F y, const __global float *tables)
{
#if APERTURE_PARTS
    I inside = FALSE;
    for (int k = 0; k < APERTURE_PARTS; ++k) {
        const __global float *part = tables + CURVE(APERTURE_PARTS) + 6 * k;
        F px = x - part[0], py = y - part[1];
        float far_x = part[2] + part[4], far_y = part[3] + part[5];        // from the apex to its other corner
        float area = part[2] * far_y - part[3] * far_x;
        F a = (px * far_y - py * far_x) / area;
        F b = (part[2] * py - part[3] * px) / area;
        inside |= (a >= 0.0f) & (b >= 0.0f) & (a + b <= 1.0f);
    }
    return inside;
#elif APERTURE_ROWS
    I column = TO_I((x + 1.0f) * (0.5f * APERTURE_ROWS));
    I row = TO_I((y + 1.0f) * (0.5f * APERTURE_ROWS));
    I within = (absolute(x) < 1.0f) & (absolute(y) < 1.0f) & (column < APERTURE_ROWS) & (row < APERTURE_ROWS);
    I at = within ? (row + 1) * CURVE(APERTURE_ROWS) + 2 * column : FALSE;
    return within & (GATHER(F, tables + 2, at, ) > GATHER(F, tables, at, ));
#else
    return x * x + y * y < 1.0f;
#endif
}
#endif

#endif
