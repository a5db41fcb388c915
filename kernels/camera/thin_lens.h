// A perfect thin lens: every ray of a film point meets in one point of the plane of focus. tables = those of the
// aperture.
#include "camera/film_point.h"
#include "lens/aperture.h"
#include "lens/half_pupil.h"
#define PUPIL_HOLDS(fx, fy, x, y) aperture_holds(x, y, tables)
#include "lens/lamp_aim.h"

static CameraRay camera_ray(Lane lane, F4 u, F wavelength, const __global Camera *camera,
                            const __global float *tables, const __global Surface *surfaces,
                            const __global float *stop)
{
    const __global ThinLensCamera *own = &camera->own.thin_lens;
    CameraRay r;
    F focus = (F)(own->focus_distance);
    F lx, ly;
    r.weight = ONE;
#if LAMP_AIM
    F tx = film_x(lane, u.a, camera) * own->half_width;
    F ty = film_y(lane, u.b, camera) * own->half_height;
    LampAim lamps = aim_at_lamps(lane, tx, ty, wavelength, u.c, u.d, camera, tables);
    aperture_point(lamps.u, u.d, tables, &lx, &ly);
    if (ANY(lamps.rest < 1.0f)) {
        lx = lamps.aims ? lamps.x : lx;
        ly = lamps.aims ? lamps.y : ly;
        I open = NOT(lamps.aims);
        if (ANY(lamps.aims))
            open |= aperture_holds(lx, ly, tables);
        F area = (F)(tables[camera->lamp_table]);
        r.weight = open ? ONE / (lamps.rest + area * density_of_lamps(&lamps, lx, ly, camera, tables)) : ZERO;
    }
#else
    aperture_point(u.c, u.d, tables, &lx, &ly);
#endif
    r.o = f3(lx * own->aperture_radius, ly * own->aperture_radius, ZERO);
#if FILM_MOVED
    // Each film point has a plane of its own: 1 / focus = 1 / focal length - 1 / film distance, perhaps beyond infinity.
    F3 film = moved_film(film_x(lane, u.a, camera), film_y(lane, u.b, camera), camera);
    F per_distance = ONE / (ONE + film.z);
    F vergence = ONE / focus + film.z * per_distance * camera->film_centre.w;
    r.d = normalized(f3(-film.x * per_distance - r.o.x * vergence, -film.y * per_distance - r.o.y * vergence, -ONE));
#else
    F3 target = f3(film_x(lane, u.a, camera) * own->half_width * focus,
                   film_y(lane, u.b, camera) * own->half_height * focus, -focus);
    r.d = normalized(sub(target, r.o));
#endif
#if HALF_PUPIL
    r.weight = of_half(r.weight, lx, ly, ZERO, ZERO, camera);
#endif
    r.status = (I)(RAY_OK);
    return r;
}
