// Picking cells by their shares. A curve is a pair of numbers for each cell and one pair more: the running sum of the shares
// before cell k, and as a guide the last cell that starts at or before k / count. Side by side, so that two neighbouring pairs
// are read as one.
#ifndef CURVE_H
#define CURVE_H
#include "common/math.h"
#include "common/transpose.h"

#define CURVE(cells)    (2 * ((cells) + 1))      // numbers of a curve

// The cell where the running sum of the curve that starts at `curve` passes u, its share, and where in 0 … 1 inside of it:
// the inverse of the sum, so that numbers which are spread evenly stay so (an alias table would tear them apart).
static I cell_at(const __global float *curves, I curve, int count, F u, F *inside, F *share)
{
    I start, guide, end, after;
    const __global uint *words = (const __global uint *)curves;
    load_four(words, curve + 2 * MIN(TO_I(u * (float)count), (I)(count - 1)), &start, &guide, &end, &after);
    I cell = TO_I(AS_F(guide)), last = TO_I(AS_F(after));
    I on = cell < last;
    while (ANY(on)) {       // halves what is left: between bright parts of a picture lie many cells without a share
        I middle = (cell + last + 1) >> 1;
        I before = GATHER(F, curves, curve + 2 * middle, ) <= u;
        cell = (on & before) ? middle : cell;
        last = (on & NOT(before)) ? middle - 1 : last;
        on = cell < last;
    }
    load_four(words, curve + 2 * cell, &start, &guide, &end, &after);
    *share = AS_F(end) - AS_F(start);
    *inside = MIN(MAX((u - AS_F(start)) / MAX(*share, (F)(SMALLEST)), ZERO), ONE);
    return cell;
}

#endif
