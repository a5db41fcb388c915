// The camera rays of a stream whose camera has no lens: made in the lanes that start them.
#ifndef CAMERA_RAYS_H
#define CAMERA_RAYS_H
#include CAMERA_FILE
#include "camera/into_world.h"

#define RAYS_PARAMETERS                                                                                                \
    const __global Camera *camera, const __global float *tables, const __global float *filter TRAJECTORY_PARAMETER,
#if SPECTRUM
#define RAYS_START  start_rays(first, wave, tiles, camera, tables, filter, scene.colours TRAJECTORY)
#else
#define RAYS_START  start_rays(first, wave, tiles, camera, tables, filter, 0 TRAJECTORY)
#endif

typedef struct {
    const __global Camera *camera;
    const __global float  *tables, *filter, *colours;
#if MOVES
    const __global float4 *trajectory;
#endif
    uint2 seed;
    Lane  lane;         // its sample is that of the last ray
    U     end;          // behind the last sample
} CameraRays;

static CameraRays start_rays(uint first, Wave wave, const __global uint *tiles, const __global Camera *camera,
                             const __global float *tables, const __global float *filter,
                             const __global float *colours TRAJECTORY_PARAMETER)
{
    CameraRays rays;
    rays.camera = camera;
    rays.tables = tables;
    rays.filter = filter;
    rays.colours = colours;
#if MOVES
    rays.trajectory = trajectory;
#endif
    rays.seed = wave.seed;
    rays.lane = lane_of(first, wave, tiles);
    rays.lane.sample = (U)(wave.first_sample - 1u);
    rays.end = rays.lane.sample + (rays.lane.inside ? (U)(wave.samples) : (U)(0u));
    return rays;
}

static inline I rays_left(CameraRays rays) { return rays.lane.sample != rays.end; }

// The next rays of the lanes `start`.
static inline WorldRay take_rays(CameraRays *rays, I start)
{
    rays->lane.sample = start ? rays->lane.sample + 1u : rays->lane.sample;
    Draw draw = draw_of(rays->lane, rays->seed, rays->camera, rays->filter, rays->colours);
    CameraRay ray = camera_ray(draw.lane, draw.u, draw.wavelength, rays->camera, rays->tables, 0, 0);
#if MOVES
    const __global float4 *trajectory = rays->trajectory;
#endif
    return into_world(draw, ray, rays->seed, rays->camera TRAJECTORY);
}

#endif
