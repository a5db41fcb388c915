// The whole sphere in longitude and latitude; the middle of the picture looks forward (-z), the top row up (+y).
#include "camera/film_point.h"

static CameraRay camera_ray(Lane lane, F4 u, F wavelength, const __global Camera *camera,
                            const __global float *tables, const __global Surface *surfaces,
                            const __global float *stop)
{
    CameraRay r;
    F sin_longitude, cos_longitude, sin_latitude, cos_latitude;
    F x = film_x(lane, u.a, camera) * 0.5f;
    F y = film_y(lane, u.b, camera) * 0.25f;
    sincos_turns(absolute(x), &sin_longitude, &cos_longitude);
    sincos_turns(absolute(y), &sin_latitude, &cos_latitude);
    r.o = f3(ZERO, ZERO, ZERO);
    r.d = f3(cos_latitude * with_sign(sin_longitude, x), with_sign(sin_latitude, y), -cos_latitude * cos_longitude);
    r.weight = ONE;
    r.status = (I)(RAY_OK);
    return r;
}
