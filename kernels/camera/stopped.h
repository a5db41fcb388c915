// Counts the rays that a lens stops, by reason. Those that passed are the rest.
#ifndef STOPPED_H
#define STOPPED_H
#include "camera/film_point.h"

static void count_stopped(Lane lane, CameraRay ray, __global uint *counters)
{
    if (ANY(ray.status != RAY_OK))
        for (int status = RAY_OK + 1; status < RAY_STATUS_COUNT; ++status) {
            uint n = COUNT(lane.inside & (ray.status == status));
            if (n != 0u)
                atomic_add(counters + status, n);
        }
}

#endif
