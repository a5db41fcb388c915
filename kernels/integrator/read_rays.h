// The camera rays of a stream that the pass generate wrote.
#ifndef CAMERA_RAYS_H
#define CAMERA_RAYS_H
#include "integrator/ray_records.h"

#define RAYS_PARAMETERS  const __global float *rays,        /* eight floats per slot */
#define RAYS_START       start_rays(first, wave, tiles, rays)

#endif
