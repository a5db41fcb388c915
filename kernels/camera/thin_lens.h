// A perfect thin lens: every ray of a film point meets in one point of the plane of focus. tables = those of the
// aperture.
#include "camera/film_point.h"
#include "lens/aperture.h"
#include "lens/half_pupil.h"

static CameraRay camera_ray(Lane lane, F4 u, F wavelength, const __global Camera *camera,
                            const __global float *tables, const __global Surface *surfaces,
                            const __global float *stop)
{
    const __global ThinLensCamera *own = &camera->own.thin_lens;
    CameraRay r;
    F focus = (F)(own->focus_distance);
    F lx, ly;
    aperture_point(u.c, u.d, tables, &lx, &ly);
    r.o = f3(lx * own->aperture_radius, ly * own->aperture_radius, ZERO);
    F3 target = f3(film_x(lane, u.a, camera) * own->half_width * focus,
                   film_y(lane, u.b, camera) * own->half_height * focus, -focus);
    r.d = normalized(sub(target, r.o));
    r.weight = ONE;
#if HALF_PUPIL
    r.weight = of_half(r.weight, lx, ly, ZERO, ZERO, camera);
#endif
    r.status = (I)(RAY_OK);
    return r;
}
