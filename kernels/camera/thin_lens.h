// A perfect thin lens: every ray of a film point meets in one point of the plane of focus. a = (tan x, tan y, distance of
// that plane, aperture radius); b = (blades, rotation in turns) where the aperture is a polygon.
#include "camera/film_point.h"

#if APERTURE_POLYGON
// A uniform point of the regular polygon with unit circumradius: a wedge, then its triangle (no rejection).
static void aperture_point(F u, F v, const __global Camera *camera, F *x, F *y)
{
    F blades = (F)(camera->b.x);
    F scaled = u * blades;
    F wedge = floor(scaled);
    wedge = MIN(wedge, blades - 1.0f);
    F s = sqrt(scaled - wedge);
    F sa, ca, sb, cb;
    sincos_turns(wedge / blades, &sa, &ca);
    sincos_turns((wedge + 1.0f) / blades, &sb, &cb);
    F px = s * (ca + v * (cb - ca));
    F py = s * (sa + v * (sb - sa));
    *x = px * camera->b.z - py * camera->b.w;
    *y = px * camera->b.w + py * camera->b.z;
}
#else
static void aperture_point(F u, F v, const __global Camera *camera, F *x, F *y)
{
    F s, c;
    sincos_turns(u, &s, &c);
    F r = sqrt(v);
    *x = r * c;
    *y = r * s;
}
#endif

static CameraRay camera_ray(Lane lane, F4 u, const __global Camera *camera, const __global float *tables,
                            const __global Surface *surfaces)
{
    CameraRay r;
    F focus = (F)(camera->a.z);
    F lx, ly;
    aperture_point(u.c, u.d, camera, &lx, &ly);
    r.o = f3(lx * camera->a.w, ly * camera->a.w, ZERO);
    F3 target = f3(film_x(lane, u.a, camera) * camera->a.x * focus, film_y(lane, u.b, camera) * camera->a.y * focus, -focus);
    r.d = normalized(sub(target, r.o));
    r.weight = ONE;
    r.status = (I)(RAY_OK);
    return r;
}
