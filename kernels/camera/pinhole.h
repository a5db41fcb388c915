// Perspective through a point; rays start at the near plane.
#include "camera/film_point.h"

static CameraRay camera_ray(Lane lane, F4 u, F wavelength, const __global Camera *camera,
                            const __global float *tables, const __global Surface *surfaces,
                            const __global float *stop)
{
    const __global PinholeCamera *own = &camera->own.pinhole;
    CameraRay r;
#if FILM_MOVED
    F3 film = moved_film(film_x(lane, u.a, camera), film_y(lane, u.b, camera), camera);
    F per_distance = ONE / (ONE + film.z);
    F3 d = f3(-film.x * per_distance, -film.y * per_distance, -ONE);
#else
    F3 d = f3(film_x(lane, u.a, camera) * own->half_width, film_y(lane, u.b, camera) * own->half_height, -ONE);
#endif
    r.o = scale(d, (F)(own->near_distance));
    r.d = normalized(d);
    r.weight = ONE;
    r.status = (I)(RAY_OK);
    return r;
}
