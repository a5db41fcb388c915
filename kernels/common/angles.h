// Angles of directions, in turns.
#ifndef ANGLES_H
#define ANGLES_H
#include "common/math.h"

// The angle of (x, y) from the x axis towards y, -1/2 to 1/2: a fit to atan on 0 … 1 and its mirrors (error below 1e-7).
static F turns_of(F x, F y)
{
    F ax = absolute(x);
    F ay = absolute(y);
    I steep = ay > ax;
    F a = (steep ? ax : ay) / MAX((steep ? ay : ax), (F)(SMALLEST));
    F z = a * a;
    F t = a * (0.159154847f + z * (-0.0530406535f + z * (0.0316405445f + z * (-0.0214578807f
        + z * (0.0133339604f + z * (-0.00587792415f + z * 0.00124718901f))))));
    t = steep ? 0.25f - t : t;
    t = x < 0.0f ? 0.5f - t : t;
    return with_sign(t, y);
}

// The same from 0 to 1.
static inline F turns_around(F x, F y)
{
    F t = turns_of(x, y);
    return t < 0.0f ? t + 1.0f : t;
}

// How far a direction, at a height above the horizon and this far from the axis, is on the way from straight down to
// straight up, by angle: 0 to 1.
static inline F share_upwards(F height, F aside) { return 0.5f + 2.0f * turns_of(aside, height); }

#endif
