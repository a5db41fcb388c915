// Film coordinates of a lane: [-1, 1] to the right and upwards in the upright picture (row 0 on top), jittered within the
// pixel (box filter). `flip: false` shows the picture as it lies on the film and only changes the sign.
// Fact: FILM_MOVED, whether the film stands otherwise than straight across the axis with its centre on it.
#ifndef FILM_POINT_H
#define FILM_POINT_H
#include "common/records.h"
#include "common/sampler.h"

static inline F film_x(Lane lane, F jitter, const __global Camera *camera)
{
    return (2.0f * (TO_F(lane.x) + jitter) - camera->width) * camera->per_width;
}

static inline F film_y(Lane lane, F jitter, const __global Camera *camera)
{
    return (camera->height - 2.0f * (TO_F(lane.y) + jitter)) * camera->per_height;
}

#if FILM_MOVED
// The point of a moved film that shows (x, y) of the picture: to the right, up, and behind where the film's centre stands.
static inline F3 moved_film(F x, F y, const __global Camera *camera)
{
    return f3(camera->film_centre.x - x * camera->film_across.x - y * camera->film_up.x,
              camera->film_centre.y - x * camera->film_across.y - y * camera->film_up.y,
              camera->film_centre.z - x * camera->film_across.z - y * camera->film_up.z);
}
#endif

typedef struct {
    F3 o, d;      // camera frame, metres; d unit
    F  weight;    // 0 for a ray that the lens blocks
    I  status;    // RAY_…
} CameraRay;

typedef struct {
    F3 o, d;      // metres, about the eye; d unit
    F  weight;    // 0 where there is no ray
#if MOVES
    F  time;      // since the shutter opens [s]
#endif
} WorldRay;

#endif
