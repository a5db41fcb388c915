// Reconstruction filters by importance sampling: a sample belongs to its own pixel, and its place round the pixel's centre
// is drawn from the filter's magnitude along each axis (Ernst, Stamminger, Greiner 2006), so that no sample is shared and
// noise stays white. Negative lobes weigh with their sign. The table (rptcam_cl/rendering/cameras/model.py): where the filter
// changes its sign [pixels from the centre], the weight |f| has more than f, then the place for u = 0, 1 / FILTER, ..., 1.
// Facts: FILTER, cells of the table; 0 for a box of one pixel, which needs none.
#ifndef FILTER_H
#define FILTER_H
#include "common/math.h"

#if FILTER
// Turns a number in [0, 1) into a place in the pixel, 0.5 being its centre, and returns the weight there.
static inline F filter_sign(F *u, const __global float *filter)
{
    F scaled = *u * (float)FILTER;
    I cell = TO_I(scaled);
    F low = GATHER(F, filter + 2, cell, );
    F place = low + (scaled - TO_F(cell)) * (GATHER(F, filter + 3, cell, ) - low);
    *u = 0.5f + place;
    return absolute(place) < filter[0] ? (F)(filter[1]) : (F)(-filter[1]);
}
#endif

#endif
