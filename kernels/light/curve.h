// Picking cells by their shares. A curve is the running sum of the shares (one more number than cells) and a guide: for each
// k / count the last cell that starts at or before it.
#ifndef CURVE_H
#define CURVE_H
#include "common/math.h"

#define CURVE(cells)    (2 * (cells) + 1)       // numbers of a curve

// The cell where the running sum that starts at `curve` passes u, and where in 0 … 1 of all cells: the inverse of the sum, so
// that numbers which are spread evenly stay so (an alias table would tear them apart).
static I cell_at(const __global float *curves, I curve, int count, F u, F *place)
{
    I cell = TO_I(GATHER(F, curves, curve + (count + 1) + MIN(TO_I(u * (float)count), (I)(count - 1)), ));
    F end = GATHER(F, curves, curve + cell + 1, );
    I on = (end <= u) & (cell < count - 1);
    while (ANY(on)) {
        cell = on ? cell + 1 : cell;
        F next = GATHER(F, curves, curve + cell + 1, );
        end = on ? next : end;
        on = on & (end <= u) & (cell < count - 1);
    }
    F start = GATHER(F, curves, curve + cell, );
    F inside = (u - start) / MAX(end - start, (F)(SMALLEST));
    *place = (TO_F(cell) + MIN(MAX(inside, ZERO), ONE)) * (1.0f / (float)count);
    return cell;
}

#endif
