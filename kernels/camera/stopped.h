// Counts the rays that a lens stops, by reason. Those that passed are the rest.
#ifndef STOPPED_H
#define STOPPED_H
#include "camera/film_point.h"

typedef struct { uint of[RAY_STATUS_COUNT]; } Stopped;

static inline Stopped none_stopped(void)
{
    Stopped stopped;
    for (int status = 0; status < RAY_STATUS_COUNT; ++status)
        stopped.of[status] = 0u;
    return stopped;
}

static inline void count_stopped(Stopped *stopped, Lane lane, CameraRay ray)
{
    if (ANY(ray.status != RAY_OK))
        for (int status = RAY_OK + 1; status < RAY_STATUS_COUNT; ++status)
            stopped->of[status] += COUNT(lane.inside & (ray.status == status));
}

// Work items wait for each other here: once for many rays.
static void add_stopped(Stopped stopped, __global uint *counters)
{
    for (int status = RAY_OK + 1; status < RAY_STATUS_COUNT; ++status)
        if (stopped.of[status] != 0u)
            atomic_add(counters + status, stopped.of[status]);
}

#endif
