// When the light of a path falls on its pixel, and where a moving camera is then. Times are seconds since the shutter opens.
// The course: time that the shutter is open, start of pixel (0, 0), how much later each column and row start; number of
// legs; then six rows for each leg of the camera's way: eye [m] (w: when the leg begins), its change (w: 1 / duration), view
// and its change, up and its change (rptcam_cl/cameras/trajectory.py).
// Fact: CAMERA_LEGS, 0 for a camera that stands still, 1 for one leg, 2 for more.
#ifndef COURSE_H
#define COURSE_H
#include "common/records.h"

// `u` chooses a moment of those during which the shutter is open.
static F moment_of(Lane lane, F u, const __global float4 *course)
{
    float4 shutter = course[0];
    return shutter.y + shutter.z * TO_F(lane.x) + shutter.w * TO_F(lane.y) + shutter.x * u;
}

#if CAMERA_LEGS
typedef struct { F3 right, up, back, eye; } Stand;

#if CAMERA_LEGS == 1
#define OF_LEG(k, member)  ((F)(course[2 + (k)].member))
#else
#define OF_LEG(k, member)  GATHER(F, course, leg + (k), .member)
#endif
#define ROW_OF_LEG(k, share) \
    f3(OF_LEG(k, x) + (share) * OF_LEG(k + 1, x), OF_LEG(k, y) + (share) * OF_LEG(k + 1, y), \
       OF_LEG(k, z) + (share) * OF_LEG(k + 1, z))

static Stand stand_at(F time, const __global float4 *course)
{
#if CAMERA_LEGS > 1
    I leg = (I)(2);
    int end = 2 + 6 * (int)course[1].x;
    for (int next = 8; next < end; next += 6)
        leg = time >= course[next].w ? (I)(next) : leg;
#endif
    F share = (time - OF_LEG(0, w)) * OF_LEG(1, w);
    Stand s;
    s.eye = ROW_OF_LEG(0, share);
    s.back = scale(normalized(ROW_OF_LEG(2, share)), (F)(-1.0f));
    s.right = normalized(cross3(ROW_OF_LEG(4, share), s.back));
    s.up = cross3(s.back, s.right);
    return s;
}
#endif

#endif
