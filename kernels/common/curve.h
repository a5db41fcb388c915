// Picking cells by their shares. A curve is a pair of numbers for each cell and one pair more: the running sum of the shares
// before cell k, and as a guide the last cell that starts at or before k / count. Side by side, because where shares are
// even the two are read together.
#ifndef CURVE_H
#define CURVE_H
#include "common/math.h"

#define CURVE(cells)    (2 * ((cells) + 1))      // numbers of a curve

// The cell where the running sum of the curve that starts at `curve` passes u, its share, and where in 0 … 1 inside of it:
// the inverse of the sum, so that numbers which are spread evenly stay so (an alias table would tear them apart).
static I cell_at(const __global float *curves, I curve, int count, F u, F *inside, F *share)
{
    I cell = TO_I(GATHER(F, curves, curve + 2 * MIN(TO_I(u * (float)count), (I)(count - 1)) + 1, ));
    F end = GATHER(F, curves, curve + 2 * cell + 2, );
    I on = (end <= u) & (cell < count - 1);
    while (ANY(on)) {
        cell = on ? cell + 1 : cell;
        F next = GATHER(F, curves, curve + 2 * cell + 2, );
        end = on ? next : end;
        on = on & (end <= u) & (cell < count - 1);
    }
    F start = GATHER(F, curves, curve + 2 * cell, );
    *share = end - start;
    *inside = MIN(MAX((u - start) / MAX(*share, (F)(SMALLEST)), ZERO), ONE);
    return cell;
}

#endif
