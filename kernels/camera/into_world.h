// A camera ray placed in the world at its time, with what its sample counts on the film.
// Facts: MOVES, CAMERA_SEGMENTS, FILTER.
#ifndef INTO_WORLD_H
#define INTO_WORLD_H
#include "camera/draw.h"
#if MOVES
#include "camera/trajectory.h"
#define TRAJECTORY_PARAMETER , const __global float4 *trajectory      // of shutter and camera
#define TRAJECTORY , trajectory
#else
#define TRAJECTORY_PARAMETER
#define TRAJECTORY
#endif

static inline F3 from_camera(const __global Camera *c, F3 v)
{
    return f3(c->right.x * v.x + c->up.x * v.y + c->back.x * v.z, c->right.y * v.x + c->up.y * v.y + c->back.y * v.z,
              c->right.z * v.x + c->up.z * v.y + c->back.z * v.z);
}

static WorldRay into_world(Draw draw, CameraRay ray, uint2 seed, const __global Camera *camera TRAJECTORY_PARAMETER)
{
    WorldRay r;
#if MOVES
    r.time = moment_of(draw.lane, path_numbers(draw.lane.pixel, draw.lane.sample, seed).b, trajectory);
#endif
#if CAMERA_SEGMENTS
    Pose pose = pose_at(r.time, trajectory);
    r.o = add(pose.eye, from_frame(pose.right, pose.up, pose.back, ray.o));
    r.d = from_frame(pose.right, pose.up, pose.back, ray.d);
#else
    r.o = from_camera(camera, ray.o);
    r.d = from_camera(camera, ray.d);
#endif
    r.weight = (draw.lane.inside & (ray.weight > 0.0f)) ? ray.weight * camera->exposure : ZERO;
#if FILTER
    r.weight *= draw.sign;
#endif
    return r;
}

#endif
