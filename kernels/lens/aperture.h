// A uniform point of an aperture of radius 1, without rejection: of the disc, or of one of its parts, triangles or cells,
// picked by area. A part is eight floats: corner, two edges, share of its alias cell that it keeps, index that has the rest.
// Facts: APERTURE_PARTS (0: a disc), APERTURE_TRIANGLES.
#ifndef APERTURE_H
#define APERTURE_H
#include "common/math.h"

static void aperture_point(F u, F v, const __global float *parts, F *x, F *y)
{
#if APERTURE_PARTS
    F scaled = u * (float)APERTURE_PARTS;
    I part = MIN(TO_I(scaled), (I)(APERTURE_PARTS - 1));
    F rest = scaled - TO_F(part);
    F keep = GATHER(F, parts + 6, part * 8, );
    I stays = rest < keep;
    part = stays ? part : TO_I(GATHER(F, parts + 7, part * 8, ));
    F a = stays ? rest / keep : (rest - keep) / (1.0f - keep);
    F b = v;
#if APERTURE_TRIANGLES
    F s = sqrt(a);
    a = s * (1.0f - b);
    b = s * b;
#endif
    I at = part * 8;
    *x = GATHER(F, parts, at, ) + a * GATHER(F, parts + 2, at, ) + b * GATHER(F, parts + 4, at, );
    *y = GATHER(F, parts + 1, at, ) + a * GATHER(F, parts + 3, at, ) + b * GATHER(F, parts + 5, at, );
#else
    F s, c;
    sincos_turns(u, &s, &c);
    F r = sqrt(v);
    *x = r * c;
    *y = r * s;
#endif
}

#endif
