// A ray from the film through every surface of the lens (Kolb, Mitchell, Hanrahan 1995). A ray that the lens blocks weighs
// zero, so the mean is the film's irradiance E = int L cos^4 / Z^2 dA over the pupil.
// a = (film half width, half height, film distance Z, scale of the weight) in mm; b = (mm to the camera's frame, z of the
// first vertex in the camera's frame); count = surfaces; pupil and tables as in lens/pupil.h.
#include "camera/film_point.h"
#include "lens/half_pupil.h"
#include "lens/pupil.h"
#include "lens/trace.h"

// A ray on its way through the lens, and what its weight needs.
typedef struct {
    LensPath path;
    Aim      at;
    F        fx, fy, length2;
} Underway;

static Underway enter_camera(Lane lane, F4 u, F wavelength, const __global Camera *camera, const __global float *tables)
{
    Underway ray;
    ray.fx = -film_x(lane, u.a, camera) * camera->a.x;      // a lens inverts: right in the picture is left on the film
    ray.fy = -film_y(lane, u.b, camera) * camera->a.y;
    ray.at = aim(ray.fx, ray.fy, u.c, u.d, camera, tables);
    F3 d = f3(ray.at.x - ray.fx, ray.at.y - ray.fy, (F)(camera->a.z));
    ray.length2 = dot3(d, d);
    ray.path = enter_lens(f3(ray.fx, ray.fy, ZERO), scale(d, ONE / sqrt(ray.length2)), wavelength);
    return ray;
}

static CameraRay leave_camera(Underway ray, LensRay out, const __global Camera *camera)
{
    CameraRay r;
    F cos2_over_length2 = camera->a.z / ray.length2;        // cos^2 / Z, as cos^2 = Z^2 / length^2
    F weight = camera->a.w * ray.at.inverse_density * cos2_over_length2 * cos2_over_length2;
#if LENS_LOSSES
    weight *= out.transmittance;
#endif
    F mm = (F)(camera->b.x);
    r.o = keep3(out.passed, f3(out.p.x * mm, out.p.y * mm, camera->b.y - out.p.z * mm));
    r.d = select3(out.passed, f3(out.d.x, out.d.y, -out.d.z), f3(ZERO, ZERO, -ONE));    // travel is along -z
    r.weight = out.passed ? weight : ZERO;
#if HALF_PUPIL
    r.weight = of_half(r.weight, ray.at.x, ray.at.y, ray.fx, ray.fy, camera);
#endif
    r.status = ray.at.inverse_density > 0.0f ? out.status : (I)(RAY_CLIPPED);
    return r;
}

static CameraRay camera_ray(Lane lane, F4 u, F wavelength, const __global Camera *camera,
                            const __global float *tables, const __global Surface *surfaces,
                            const __global float *stop)
{
    Underway ray = enter_camera(lane, u, wavelength, camera, tables);
    for (int k = 0; k < camera->count; ++k)
        cross_surface(&ray.path, surfaces + k, stop);
    return leave_camera(ray, leave_lens(&ray.path), camera);
}
