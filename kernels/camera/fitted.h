// A ray from the film through the polynomials of a lens, in place of its surfaces.
// Camera as in camera/aimed.h; surfaces: those whose rims block light.
#include "camera/aimed.h"
#include "lens/surface.h"
#include "lens/ray_map.h"

static inline CameraRay camera_ray(Lane lane, F4 u, F wavelength, const __global Camera *camera,
                                   const __global float *tables, const __global Surface *surfaces,
                                   const __global float *stop)
{
    const __global float *map = tables + camera->own.realistic.first_polynomial;
    Aimed ray = aimed_ray(lane, u, wavelength, camera, tables);
    MapPoint at = map_point(ray.fx, ray.fy, ray.at.x, ray.at.y, wavelength, map);
    F3 p, d;
    const __global float *rims = mapped_ray(at, map, &p, &d);
    I passed = within_mapped_rims(at, rims, surfaces, stop);
    return behind_lens(ray, p, d, passed, passed ? (I)(RAY_OK) : (I)(RAY_CLIPPED), camera, tables);
}
