// A parallel view: rays start in the near plane and go along the axis.
#include "camera/film_point.h"

static CameraRay camera_ray(Lane lane, F4 u, F wavelength, const __global Camera *camera,
                            const __global float *tables, const __global Surface *surfaces,
                            const __global float *stop)
{
    const __global PinholeCamera *own = &camera->own.pinhole;   // its halves are lengths here
    CameraRay r;
    r.o = f3(film_x(lane, u.a, camera) * own->half_width, film_y(lane, u.b, camera) * own->half_height,
             (F)(-own->near_distance));
    r.d = f3(ZERO, ZERO, -ONE);
    r.weight = ONE;
    r.status = (I)(RAY_OK);
    return r;
}
