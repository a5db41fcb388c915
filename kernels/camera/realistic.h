// A ray from the film through every surface of the lens (Kolb, Mitchell, Hanrahan 1995). The ray aims at a circle on the
// plane of the rear vertex that holds every passing ray of this film radius; one that the lens blocks weighs zero, so the
// mean is the film's irradiance E = int L cos^4 / Z^2 dA whatever the circle.
// a = (film half width, half height, film distance Z, 1 / table step) in mm; b = (scale of the weight, mm to the camera's
// frame, z of the first vertex in the camera's frame, surfaces); tables = [centre offset, radius] per step of film radius.
#include "camera/film_point.h"
#include "lens/trace.h"

static CameraRay camera_ray(Lane lane, F4 u, const __global Camera *camera, const __global float *tables,
                            const __global Surface *surfaces)
{
    CameraRay r;
    F fx = -film_x(lane, u.a, camera) * camera->a.x;      // a lens inverts: right in the picture is left on the film
    F fy = -film_y(lane, u.b, camera) * camera->a.y;
    F radius = sqrt(fx * fx + fy * fy);
    F inverse = radius > 0.0f ? ONE / radius : ZERO;
    F ex = radius > 0.0f ? fx * inverse : ONE;
    F ey = fy * inverse;
    I row = TO_I(radius * camera->a.w) * 2;
    F offset = GATHER(F, tables, row, );
    F reach = GATHER(F, tables + 1, row, );
    F s, c;
    sincos_turns(u.c, &s, &c);
    F rho = reach * sqrt(u.d);
    F along_radius = offset + rho * c;
    F across = rho * s;
    F z = (F)(camera->a.z);
    F3 d = f3(ex * along_radius - ey * across - fx, ey * along_radius + ex * across - fy, z);
    F length2 = dot3(d, d);
    d = scale(d, ONE / sqrt(length2));
    LensRay out = trace_lens(f3(fx, fy, ZERO), d, surfaces, camera->count);
    F zz = z * z;
    F weight = camera->b.x * reach * reach * zz / (length2 * length2);      // pi rho^2 cos^4 / Z^2, and the exposure
    I lit = out.passed & (reach > 0.0f);
    F mm = (F)(camera->b.y);
    r.o = f3(out.p.x * mm, out.p.y * mm, camera->b.z - out.p.z * mm);
    r.d = f3(out.d.x, out.d.y, -out.d.z);                                   // travel is along -z of the camera
    r.weight = lit ? weight : ZERO;
    r.status = out.status;
    return r;
}
