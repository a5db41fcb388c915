// Packets of camera rays side by side: a surface of a lens is a long chain of roots and divisions that leaves room for others.
// Fact: CAMERA_PACKETS; more than one of cameras that go through surface after surface alone.
#ifndef PACKETS_H
#define PACKETS_H
#include CAMERA_FILE
#include "camera/draw.h"

static void camera_rays(const Draw *draws, const __global Camera *camera, const __global float *tables,
                        const __global Surface *surfaces, const __global float *stop, CameraRay *out)
{
#if CAMERA_PACKETS > 1
    Underway rays[CAMERA_PACKETS];
#pragma unroll
    for (uint i = 0; i < CAMERA_PACKETS; ++i)
        rays[i] = enter_camera(draws[i].lane, draws[i].u, draws[i].wavelength, camera, tables);
    for (int k = 0; k < camera->own.realistic.surfaces; ++k)
#pragma unroll
        for (uint i = 0; i < CAMERA_PACKETS; ++i)
            cross_surface(&rays[i].path, surfaces + k, stop);
#pragma unroll
    for (uint i = 0; i < CAMERA_PACKETS; ++i)
        out[i] = leave_camera(rays[i], leave_lens(&rays[i].path), camera);
#else
    out[0] = camera_ray(draws[0].lane, draws[0].u, draws[0].wavelength, camera, tables, surfaces, stop);
#endif
}

#endif
