// A ray from the film through every surface of the lens (Kolb, Mitchell, Hanrahan 1995).
// Camera as in camera/aimed.h.
#include "camera/aimed.h"
#include "lens/trace.h"

// A ray on its way through the lens, and what its weight needs.
typedef struct {
    Aimed    aimed;
    LensPath path;
} Underway;

static inline Underway enter_camera(Lane lane, F4 u, F wavelength, const __global Camera *camera, const __global float *tables)
{
    Underway ray;
    ray.aimed = aimed_ray(lane, u, wavelength, camera, tables);
    F3 d = scale(ray.aimed.away, ONE / sqrt(ray.aimed.length2));
    // It starts where it aims, on the plane of the first vertex that it meets.
    ray.path = enter_lens(f3(ray.aimed.at.x, ray.aimed.at.y, (F)(camera->own.realistic.film_distance)), d, wavelength);
    return ray;
}

static inline CameraRay leave_camera(Underway ray, LensRay out, const __global Camera *camera,
                                     const __global float *tables)
{
    CameraRay r = behind_lens(ray.aimed, out.p, out.d, out.passed, out.status, camera, tables);
#if LENS_LOSSES
    r.weight *= out.transmittance;
#endif
    return r;
}

static CameraRay camera_ray(Lane lane, F4 u, F wavelength, const __global Camera *camera,
                            const __global float *tables, const __global Surface *surfaces,
                            const __global float *stop)
{
    Underway ray = enter_camera(lane, u, wavelength, camera, tables);
    for (int k = 0; k < camera->own.realistic.surfaces; ++k)
        cross_surface(&ray.path, surfaces + k, stop);
    return leave_camera(ray, leave_lens(&ray.path), camera, tables);
}
