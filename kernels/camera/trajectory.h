// When the light of a path falls on its pixel, and where a moving camera is then. Times are seconds since the shutter opens.
// The trajectory: time that the shutter is open, start of pixel (0, 0), how much later each column and row start; number of
// segments; then six rows for each segment: eye [m] (w: when the segment begins), its change (w: 1 / duration), view and its
// change, up and its change (rptcam_cl/rendering/cameras/model.py).
// Fact: CAMERA_SEGMENTS, 0 for a camera that stands still, 1 for one segment, 2 for more.
#ifndef TRAJECTORY_H
#define TRAJECTORY_H
#include "common/records.h"

// `u` chooses a moment of those during which the shutter is open.
static inline F moment_of(Lane lane, F u, const __global float4 *trajectory)
{
    float4 shutter = trajectory[0];
    return shutter.y + shutter.z * TO_F(lane.x) + shutter.w * TO_F(lane.y) + shutter.x * u;
}

#if CAMERA_SEGMENTS
typedef struct { F3 right, up, back, eye; } Pose;

#if CAMERA_SEGMENTS == 1
#define OF_SEGMENT(k, member)  ((F)(trajectory[2 + (k)].member))
#else
#define OF_SEGMENT(k, member)  GATHER(F, trajectory, segment + (k), .member)
#endif
#define ROW_OF_SEGMENT(k, share) \
    f3(OF_SEGMENT(k, x) + (share) * OF_SEGMENT(k + 1, x), OF_SEGMENT(k, y) + (share) * OF_SEGMENT(k + 1, y), \
       OF_SEGMENT(k, z) + (share) * OF_SEGMENT(k + 1, z))

static Pose pose_at(F time, const __global float4 *trajectory)
{
#if CAMERA_SEGMENTS > 1
    I segment = (I)(2);
    int end = 2 + 6 * (int)trajectory[1].x;
    for (int next = 8; next < end; next += 6)
        segment = time >= trajectory[next].w ? (I)(next) : segment;
#endif
    F share = (time - OF_SEGMENT(0, w)) * OF_SEGMENT(1, w);
    Pose s;
    s.eye = ROW_OF_SEGMENT(0, share);
    s.back = scale(normalized(ROW_OF_SEGMENT(2, share)), (F)(-1.0f));
    s.right = normalized(cross3(ROW_OF_SEGMENT(4, share), s.back));
    s.up = cross3(s.back, s.right);
    return s;
}
#endif

#endif
