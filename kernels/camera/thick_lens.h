// A ray from the film through the paraxial exit pupil, continued by first-order optics to the entrance pupil and the
// object point. The weight is the paraxial irradiance cos^4 A / Z^2 of the pupil's disk.
// All is linear in the film point [mm] and in the point of the unit disk that the pupil is
// (rptcam_cl/rendering/cameras/ideal.py).
#include "camera/film_point.h"
#include "lens/half_pupil.h"
#define PUPIL_HOLDS(fx, fy, x, y) ((x) * (x) + (y) * (y) < 1.0f)
#include "lens/lamp_aim.h"

static CameraRay camera_ray(Lane lane, F4 u, F wavelength, const __global Camera *camera,
                            const __global float *tables, const __global Surface *surfaces,
                            const __global float *stop)
{
    const __global ThickLensCamera *own = &camera->own.thick_lens;
    CameraRay r;
    // A lens inverts: right in the picture is left on the film.
#if FILM_MOVED
    F3 film = moved_film(film_x(lane, u.a, camera), film_y(lane, u.b, camera), camera);
    F fx = film.x;
    F fy = film.y;
#else
    F fx = -film_x(lane, u.a, camera) * own->film_half_width;
    F fy = -film_y(lane, u.b, camera) * own->film_half_height;
#endif
    F turn = u.c;
#if LAMP_AIM
    LampAim lamps = aim_at_lamps(lane, fx, fy, wavelength, u.c, u.d, camera, tables);
    turn = lamps.u;
#endif
    F s, c;
    sincos_turns(turn, &s, &c);
    F rho = sqrt(u.d);
    F px = rho * c;
    F py = rho * s;
    F chosen = ONE;
#if LAMP_AIM
    if (ANY(lamps.rest < 1.0f)) {
        px = lamps.aims ? lamps.x : px;
        py = lamps.aims ? lamps.y : py;
        I open = NOT(lamps.aims) | (px * px + py * py < 1.0f);
        chosen = open ? ONE / (lamps.rest + PI_F * density_of_lamps(&lamps, px, py, camera, tables)) : ZERO;
    }
#endif
#if FILM_MOVED
    // Where the ray from this film point to that of the pupil meets the plane across the axis through the film's centre.
    F nearer = ONE / (ONE + film.z * own->film_slope_per_film);
    fx = (fx - film.z * own->film_slope_per_pupil * px) * nearer;
    fy = (fy - film.z * own->film_slope_per_pupil * py) * nearer;
#endif
    F sx = own->film_slope_per_film * fx + own->film_slope_per_pupil * px;
    F sy = own->film_slope_per_film * fy + own->film_slope_per_pupil * py;
    F cos2 = ONE / (1.0f + sx * sx + sy * sy);
    F mm = (F)(own->metres_per_mm);
    r.o = f3((own->height_per_film * fx + own->height_per_pupil * px) * mm,
             (own->height_per_film * fy + own->height_per_pupil * py) * mm,
             (F)(own->first_vertex_z));
    r.d = normalized(f3(own->slope_per_film * fx + own->slope_per_pupil * px,
                        own->slope_per_film * fy + own->slope_per_pupil * py, -ONE));
#if FILM_MOVED
    F facing = camera->film_normal.z + sx * camera->film_normal.x + sy * camera->film_normal.y;
    r.weight = own->weight * nearer * nearer * cos2 * cos2 * MAX(facing, ZERO);
#else
    r.weight = own->weight * cos2 * cos2;
#endif
    r.weight *= chosen;
#if HALF_PUPIL
    r.weight = of_half(r.weight, px, py, ZERO, ZERO, camera);
#endif
    r.status = (I)(RAY_OK);
    return r;
}
