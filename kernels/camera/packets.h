// Packets of camera rays side by side: a surface of a lens is a long chain of roots and divisions that leaves room for others.
// Only the surfaces are written out for every packet: what comes before and behind them is compiled once.
// Fact: CAMERA_PACKETS; more than one of cameras that go through surface after surface alone.
#ifndef PACKETS_H
#define PACKETS_H
#include CAMERA_FILE
#include "camera/draw.h"

typedef struct {
    Draw draw;
#if CAMERA_PACKETS > 1
    Underway ray;
#else
    CameraRay ray;
#endif
} Packet;

static inline Packet enter_packet(Draw draw, const __global Camera *camera, const __global float *tables,
                                  const __global Surface *surfaces, const __global float *stop)
{
    Packet packet;
    packet.draw = draw;
#if CAMERA_PACKETS > 1
    packet.ray = enter_camera(draw.lane, draw.u, draw.wavelength, camera, tables);
#else
    packet.ray = camera_ray(draw.lane, draw.u, draw.wavelength, camera, tables, surfaces, stop);
#endif
    return packet;
}

static void cross_lens(Packet *packets, const __global Camera *camera, const __global Surface *surfaces,
                       const __global float *stop)
{
#if CAMERA_PACKETS > 1
    LensPath paths[CAMERA_PACKETS];
#pragma unroll
    for (uint i = 0; i < CAMERA_PACKETS; ++i)
        paths[i] = packets[i].ray.path;
    for (int k = 0; k < camera->own.realistic.surfaces; ++k)
#pragma unroll
        for (uint i = 0; i < CAMERA_PACKETS; ++i)
            cross_surface(&paths[i], surfaces + k, stop);
#pragma unroll
    for (uint i = 0; i < CAMERA_PACKETS; ++i) {
        paths[i].crossed = FALSE;       // where a camera ray fails is of no interest
        packets[i].ray.path = paths[i];
    }
#endif
}

static inline CameraRay leave_packet(const Packet *packet, const __global Camera *camera, const __global float *tables)
{
#if CAMERA_PACKETS > 1
    return leave_camera(packet->ray, leave_lens(&packet->ray.path), camera, tables);
#else
    return packet->ray;
#endif
}

#endif
