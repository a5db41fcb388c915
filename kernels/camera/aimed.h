// What cameras with a lens share: the ray from a film point to where it aims, and what it weighs behind the lens. The mean
// is the film's irradiance E = int L cos^4 / Z^2 dA over the pupil, as a ray that the lens blocks weighs zero.
// Z is the distance from the film to the last vertex [mm]; the tables are as in lens/pupil.h. Facts: FILM_MOVED;
// LENS_FOLD, whether mirrors fold the axis.
#ifndef AIMED_H
#define AIMED_H
#include "camera/film_point.h"
#include "lens/half_pupil.h"
#include "lens/pupil.h"
#include "lens/stigmatic.h"
#define PUPIL_HOLDS(fx, fy, x, y) (inverse_density_at(fx, fy, x, y, &camera->own.realistic, tables) > 0.0f)
#include "lens/lamp_aim.h"

typedef struct {
    Aim at;
    F   fx, fy;
    F3  away;         // to the plane of the last vertex, z along the travel
#if FILM_MOVED
    F   depth;        // of the film point, behind the film distance
#endif
    F   length2;
} Aimed;

static Aimed aimed_ray(Lane lane, F4 u, F wavelength, const __global Camera *camera, const __global float *tables)
{
    const __global RealisticCamera *own = &camera->own.realistic;
    Aimed ray;
    // A lens inverts: right in the picture is left on the film.
#if FILM_MOVED
    F3 film = moved_film(film_x(lane, u.a, camera), film_y(lane, u.b, camera), camera);
    ray.fx = film.x;
    ray.fy = film.y;
    ray.depth = film.z;
    F distance = own->film_distance + film.z;
#else
    F distance = (F)(own->film_distance);
    ray.fx = -film_x(lane, u.a, camera) * own->film_half_width;
    ray.fy = -film_y(lane, u.b, camera) * own->film_half_height;
#endif
#if LAMP_AIM
    LampAim lamps = aim_at_lamps(lane, ray.fx, ray.fy, wavelength, u.c, u.d, camera, tables);
    ray.at = aim(ray.fx, ray.fy, lamps.u, u.d, own, tables);
    if (ANY(lamps.rest < 1.0f)) {
        F x = lamps.aims ? lamps.x : ray.at.x;
        F y = lamps.aims ? lamps.y : ray.at.y;
        F other = ANY(lamps.aims) ? inverse_density_at(ray.fx, ray.fy, x, y, own, tables) : ZERO;
        F alone = lamps.aims ? other : ray.at.inverse_density;
        ray.at.x = x;
        ray.at.y = y;
        ray.at.inverse_density = alone / (lamps.rest + alone * density_of_lamps(&lamps, x, y, camera, tables));
    }
#else
    ray.at = aim(ray.fx, ray.fy, u.c, u.d, own, tables);
#endif
    ray.away = f3(ray.at.x - ray.fx, ray.at.y - ray.fy, distance);
    ray.length2 = dot3(ray.away, ray.away);
    return ray;
}

#if LENS_FOLD
static inline F along_row(float4 row, F3 d) { return row.x * d.x + row.y * d.y + row.z * d.z; }
static inline F row_at(float4 row, F3 p) { return along_row(row, p) + row.w; }
#endif

// `p` and `d` on the scene side of the lens, z along the travel from the first vertex.
static CameraRay behind_lens(Aimed ray, F3 p, F3 d, I passed, I status, const __global Camera *camera,
                             const __global float *tables)
{
    const __global RealisticCamera *own = &camera->own.realistic;
    CameraRay r;
#if FILM_MOVED
    // The cosine at the film is another than that at the pupil; a ray from behind the film brings nothing.
    F facing = ray.away.z * camera->film_normal.z - ray.away.x * camera->film_normal.x
               - ray.away.y * camera->film_normal.y;
    F per_length2 = ONE / ray.length2;
    F weight = own->gain * ray.at.inverse_density * MAX(facing, ZERO) * ray.away.z * per_length2 * per_length2;
#else
    F cos2_over_length2 = own->film_distance / ray.length2;        // cos^2 / Z, as cos^2 = Z^2 / length^2
    F weight = own->gain * ray.at.inverse_density * cos2_over_length2 * cos2_over_length2;
#endif
    F mm = (F)(own->metres_per_mm);
#if LENS_FOLD
    F3 at = p;
    at.z = -p.z;
    p = f3(row_at(camera->fold_x, at), row_at(camera->fold_y, at), -row_at(camera->fold_z, at));
    d.z = -d.z;
    d = f3(along_row(camera->fold_x, d), along_row(camera->fold_y, d), -along_row(camera->fold_z, d));
#endif
    r.o = keep3(passed, f3(p.x * mm, p.y * mm, own->first_vertex_z - p.z * mm));
    d = f3(d.x, d.y, -d.z);     // travel is along -z
#if STIGMATIC
    d = towards_conjugate(ray.fx, ray.fy, r.o, d, camera, tables);
#endif
    r.d = select3(passed, d, f3(ZERO, ZERO, -ONE));
    r.weight = passed ? weight : ZERO;
#if HALF_PUPIL
    r.weight = of_half(r.weight, ray.at.x, ray.at.y, ray.fx, ray.fy, camera);
#endif
    r.status = ray.at.inverse_density > 0.0f ? status : (I)(RAY_DARK);
    return r;
}

#endif
