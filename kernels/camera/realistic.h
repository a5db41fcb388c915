// A ray from the film through every surface of the lens (Kolb, Mitchell, Hanrahan 1995). A ray that the lens blocks weighs
// zero, so the mean is the film's irradiance E = int L cos^4 / Z^2 dA over the pupil.
// a = (film half width, half height, film distance Z, scale of the weight) in mm; b = (mm to the camera's frame, z of the
// first vertex in the camera's frame); count = surfaces; pupil and tables as in lens/pupil.h.
#include "camera/film_point.h"
#include "lens/half_pupil.h"
#include "lens/pupil.h"
#include "lens/trace.h"

static CameraRay camera_ray(Lane lane, F4 u, F wavelength, const __global Camera *camera,
                            const __global float *tables, const __global Surface *surfaces,
                            const __global float *stop)
{
    CameraRay r;
    F fx = -film_x(lane, u.a, camera) * camera->a.x;      // a lens inverts: right in the picture is left on the film
    F fy = -film_y(lane, u.b, camera) * camera->a.y;
    Aim at = aim(fx, fy, u.c, u.d, camera, tables);
    F z = (F)(camera->a.z);
    F3 d = f3(at.x - fx, at.y - fy, z);
    F length2 = dot3(d, d);
    d = scale(d, ONE / sqrt(length2));
    LensRay out = trace_lens(f3(fx, fy, ZERO), d, wavelength, surfaces, camera->count, stop);
    F cos2_over_length2 = z / length2;                     // cos^2 / Z, as cos^2 = Z^2 / length^2
    F weight = camera->a.w * at.inverse_density * cos2_over_length2 * cos2_over_length2;
#if LENS_LOSSES
    weight *= out.transmittance;
#endif
    F mm = (F)(camera->b.x);
    r.o = keep3(out.passed, f3(out.p.x * mm, out.p.y * mm, camera->b.y - out.p.z * mm));
    r.d = select3(out.passed, f3(out.d.x, out.d.y, -out.d.z), f3(ZERO, ZERO, -ONE));    // travel is along -z
    r.weight = out.passed ? weight : ZERO;
#if HALF_PUPIL
    r.weight = of_half(r.weight, at.x, at.y, fx, fy, camera);
#endif
    r.status = at.inverse_density > 0.0f ? out.status : (I)(RAY_CLIPPED);
    return r;
}
