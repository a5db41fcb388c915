// A ray from the film through the paraxial exit pupil, continued by first-order optics to the entrance pupil and the
// object point. The weight is the paraxial irradiance cos^4 A / Z^2 of the pupil's disk. From a film point [mm] and a
// point of the unit disk, linearly (rptcam_cl/cameras/thick_lens.py): b.zw the slope at the film, pupil.xy the height in
// the plane of the first vertex [mm], pupil.zw the slope in the scene.
// a = (film half width, half height [mm], scale of the weight); b.xy = (mm to the camera's frame, z of the first vertex).
#include "camera/film_point.h"
#include "lens/half_pupil.h"

static CameraRay camera_ray(Lane lane, F4 u, F wavelength, const __global Camera *camera,
                            const __global float *tables, const __global Surface *surfaces,
                            const __global float *stop)
{
    CameraRay r;
    F fx = -film_x(lane, u.a, camera) * camera->a.x;      // a lens inverts: right in the picture is left on the film
    F fy = -film_y(lane, u.b, camera) * camera->a.y;
    F s, c;
    sincos_turns(u.c, &s, &c);
    F rho = sqrt(u.d);
    F px = rho * c;
    F py = rho * s;
    F sx = camera->b.z * fx + camera->b.w * px;
    F sy = camera->b.z * fy + camera->b.w * py;
    F cos2 = ONE / (1.0f + sx * sx + sy * sy);
    F mm = (F)(camera->b.x);
    r.o = f3((camera->pupil.x * fx + camera->pupil.y * px) * mm, (camera->pupil.x * fy + camera->pupil.y * py) * mm,
             (F)(camera->b.y));
    r.d = normalized(f3(camera->pupil.z * fx + camera->pupil.w * px, camera->pupil.z * fy + camera->pupil.w * py, -ONE));
    r.weight = camera->a.z * cos2 * cos2;
#if HALF_PUPIL
    r.weight = of_half(r.weight, px, py, ZERO, ZERO, camera);
#endif
    r.status = (I)(RAY_OK);
    return r;
}
