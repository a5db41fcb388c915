// Perspective through a point; rays start at the near plane.
#include "camera/film_point.h"

static CameraRay camera_ray(Lane lane, F4 u, F wavelength, const __global Camera *camera,
                            const __global float *tables, const __global Surface *surfaces,
                            const __global float *stop)
{
    const __global PinholeCamera *own = &camera->own.pinhole;
    CameraRay r;
    F3 d = f3(film_x(lane, u.a, camera) * own->half_width, film_y(lane, u.b, camera) * own->half_height, -ONE);
    r.o = scale(d, (F)(own->near_distance));
    r.d = normalized(d);
    r.weight = ONE;
    r.status = (I)(RAY_OK);
    return r;
}
