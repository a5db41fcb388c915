// The camera rays of a stream that are made all together: a work item takes those of its pixels through the camera before it
// takes the first to the film, several of a pixel side by side, and the records are still in its cache when it needs them.
// Fact: CAMERA_PACKETS, how many of a pixel.
#ifndef CAMERA_RAYS_H
#define CAMERA_RAYS_H
#include "camera/into_world.h"
#include "camera/packets.h"
#include "camera/stopped.h"
#include "integrator/ray_records.h"

#define RAYS_PARAMETERS                                                                                                \
    const __global Camera *camera, const __global float *tables, const __global Surface *surfaces,                     \
    const __global float *stop, const __global float *filter, __global float *rays TRAJECTORY_PARAMETER,
#if SPECTRUM
#define COLOURS_OF_RAYS  scene.colours
#else
#define COLOURS_OF_RAYS  0
#endif
#define RAYS_START                                                                                                     \
    kept_rays(first, wave, tiles, camera, tables, surfaces, stop, filter, COLOURS_OF_RAYS, counters, rays TRAJECTORY)

static CameraRays kept_rays(uint first, Wave wave, const __global uint *tiles, const __global Camera *camera,
                            const __global float *tables, const __global Surface *surfaces, const __global float *stop,
                            const __global float *filter, const __global float *colours, __global uint *counters,
                            __global float *records TRAJECTORY_PARAMETER)
{
    Lane lane = lane_of(first, wave, tiles);
    uint place = record_of(first, wave);
    Stopped stopped = none_stopped();
    for (uint step = 0; step < wave.samples; step += CAMERA_PACKETS) {
        Packet packets[CAMERA_PACKETS];
#pragma nounroll
        for (uint i = 0; i < CAMERA_PACKETS; ++i) {
            Lane here = lane;
            here.sample = (U)(wave.first_sample + step + i);
            here.inside = step + i < wave.samples ? lane.inside : FALSE;
            Draw draw = draw_of(here, wave.seed, camera, filter, colours);
            packets[i] = enter_packet(draw, camera, tables, surfaces, stop);
        }
        cross_lens(packets, camera, surfaces, stop);
#pragma nounroll
        for (uint i = 0; i < CAMERA_PACKETS; ++i) {
            Draw draw = packets[i].draw;
            CameraRay ray = leave_packet(&packets[i], camera, tables);
            count_stopped(&stopped, draw.lane, ray);
            if (step + i < wave.samples)
                write_record(into_world(draw, ray, wave.seed, camera TRAJECTORY), place + (step + i) * RAYS_TOGETHER,
                             records);
        }
    }
    add_stopped(stopped, counters);
    return start_rays(first, wave, tiles, records);
}

#endif
