// Half of a pupil, as a phase detector sees it: the camera rays on the other side of a line weigh zero. Both halves take the
// same random numbers, so that every sample belongs to exactly one of them.
// The line moves with the film point and lies in the
// coordinates in which the camera chooses its point of the pupil; rptcam_cl/rendering/cameras/film_pupil.py places it.
// Fact: HALF_PUPIL, without which the whole pupil counts.
#ifndef HALF_PUPIL_H
#define HALF_PUPIL_H
#include "common/records.h"

#if HALF_PUPIL
static inline F of_half(F weight, F px, F py, F fx, F fy, const __global Camera *camera)
{
    HalfPupil line = camera->half_pupil;
    I beyond = line.normal_x * (px + line.share * fx) + line.normal_y * (py + line.share * fy) > line.offset;
    return (line.beyond ? beyond : NOT(beyond)) ? weight : ZERO;
}
#endif

#endif
