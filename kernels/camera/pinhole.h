// Perspective through a point; `near` moves the start of the ray to the near plane.
#include "camera/film_point.h"

static CameraRay camera_ray(Lane lane, F4 u, F wavelength, const __global Camera *camera,
                            const __global float *tables, const __global Surface *surfaces,
                            const __global float *stop)
{
    CameraRay r;
    F3 d = f3(film_x(lane, u.a, camera) * camera->a.x, film_y(lane, u.b, camera) * camera->a.y, -ONE);
    r.o = scale(d, (F)(camera->a.z));
    r.d = normalized(d);
    r.weight = ONE;
    r.status = (I)(RAY_OK);
    return r;
}
