// Half of a pupil, as a phase detector sees it: the camera rays on the other side of a line weigh zero. Both halves take the
// same random numbers, so that every sample belongs to exactly one of them.
// half_plane = (normal of the line, its offset along that, how far the line moves with the film point). The line lies in the
// coordinates in which the camera chooses its point of the pupil; rptcam_cl/cameras/half_pupil.py places it.
// Fact: HALF_PUPIL, without which the whole pupil counts.
#ifndef HALF_PUPIL_H
#define HALF_PUPIL_H
#include "common/records.h"

#if HALF_PUPIL
static F of_half(F weight, F px, F py, F fx, F fy, const __global Camera *camera)
{
    float4 line = camera->half_plane;
    I beyond = line.x * (px + line.w * fx) + line.y * (py + line.w * fy) > line.z;
    return (camera->half_beyond ? beyond : NOT(beyond)) ? weight : ZERO;
}
#endif

#endif
