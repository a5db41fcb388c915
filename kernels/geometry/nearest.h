// What a ray meets: the primitives of the scene, and its meshes.
#ifndef NEAREST_H
#define NEAREST_H
#include "geometry/primitives.h"
#if HAS_PRIMITIVE_TREE
#include "geometry/primitive_tree.h"
#endif
#if HAS_MESH
#include "geometry/mesh.h"
#endif
#if HAS_HIDDEN
#include "geometry/hidden.h"
#define IF_SEEN     t = where_seen(t, i, kind, scene);
#else
#define IF_SEEN
#endif
#if LIGHT_PASSES
#define NOTE_PASSED     *passed |= (met & (t > 0.0f) & (t < reach) & (target != i)) & (lets_light_pass(i, scene) ? TRUE : FALSE);
#else
#define NOTE_PASSED
#endif
#if HAS_OPACITY
#include "geometry/surface_point.h"
#include "material/opacity.h"

// Where a ray, taken to rest, that starts on primitive i meets it again, or not above zero.
static F root_beyond(Ray ray, int i, Scene scene)
{
    const __global Primitive *p = scene.primitives + i;
    const __global int *kind_end = scene.kind_end;
#if HAS_SPHERE
    if (i < kind_end[KIND_SPHERE])
        return hit_sphere(near_sphere(p, ray, TRUE));
#endif
#if HAS_ELLIPSOID
    if (i < kind_end[KIND_ELLIPSOID])
        return hit_ellipsoid(p, ray, TRUE);
#endif
    if (i < kind_end[KIND_PLANE])
        return (F)(-1.0f);
#if HAS_BOX
    if (i < kind_end[KIND_BOX]) {
        I met;
        F t = hit_box(p, ray, TRUE, &met);
        return met ? t : (F)(-1.0f);
    }
#endif
#if HAS_CYLINDER
    if (i < kind_end[KIND_CYLINDER])
        return hit_cylinder(p, ray, TRUE);
#endif
#if HAS_CONE
    return hit_cone(p, ray, TRUE);
#else
    return (F)(-1.0f);
#endif
}

#define FAR_SIDE  (-2)     // in place of a triangle, for the random choice at the second hit

// Where the lanes that hit primitive i at t find it without a hole: there, on its far side, or nowhere.
static F past_holes(I lanes, Ray ray, F t, int i, Scene scene)
{
    const __global Material *material = scene.materials + scene.primitives[i].material;
    if (!has_holes(material) || !ANY(lanes))
        return t;
    Ray here = RAY_AT_REST(ray, i);
    SurfacePoint near = surface_point(i, along(here.o, here.d, lanes ? t : ZERO), material->textured, scene);
    F chance = ray_chance(ray.o, ray.d, (I)(i), (I)(NO_TRIANGLE));
    I open = lanes & NOT(is_there(material, near.u, near.v, chance, scene));
    if (!ANY(open))
        return t;
    Ray onward = here;
    onward.o = near.p;
    F step = root_beyond(onward, i, scene);
    I again = open & (step > 0.0f) & (step < NEVER);
    SurfacePoint far = surface_point(i, along(onward.o, here.d, again ? step : ZERO), material->textured, scene);
    again = again & is_there(material, far.u, far.v, ray_chance(ray.o, ray.d, (I)(i), (I)(FAR_SIDE)), scene);
    return open ? (again ? t + step : (F)(-1.0f)) : t;
}
#define PAST_HOLES(lanes) past_holes(lanes, ray, t, i, scene)
#else
#define PAST_HOLES(lanes) t
#endif

#if HAS_CURVE
#define PLACE_ON_CURVE  F on_curve = ZERO, on_nearest = ZERO;   // where along the curve that was looked at last, and the nearest
#define KEEP_PLACE      on_nearest = closer ? on_curve : on_nearest;
#define PLACE           on_nearest
#else
#define PLACE_ON_CURVE
#define KEEP_PLACE
#define PLACE           ZERO
#endif

// What the ray meets first, before `reach`.
static Hit hit_before(Ray ray, F reach, Scene scene)
{
    const __global Primitive *primitives = scene.primitives;
    const __global int *kind_end = scene.kind_end;
    enum { within = 0 };
    F best = reach;
    I index = (I)(NO_PRIMITIVE);
    PLACE_ON_CURVE
    AXES_OF(ray)
#if HAS_HIDDEN
    I kind = KIND_OF_RAY(I, ray.origin);
#endif
#if HAS_PRIMITIVE_TREE
    I living = ray.origin != PATH_ENDED;
    EACH_PLANE(ray,
        IF_SEEN t = PAST_HOLES(met & (t > 0.0f) & (t < best));
        I closer = met & (t > 0.0f) & (t < best);
        best = closer ? t : best;
        index = closer ? (I)(i) : index;)
    // The tree has an order of its own: of two at the same distance the first of the list counts, as in the loop.
    EACH_IN_TREE(ray, living, best,
        IF_SEEN t = PAST_HOLES(met & (t > 0.0f) & (t <= best));
        I closer = met & (t > 0.0f) & ((t < best) | ((t == best) & (index > i)));
        best = closer ? t : best;
        index = closer ? (I)(i) : index;
        KEEP_PLACE)
#else
    EACH_PRIMITIVE(ray, ALL_FLATS,
        IF_SEEN t = PAST_HOLES(met & (t > 0.0f) & (t < best));
        I closer = met & (t > 0.0f) & (t < best);
        best = closer ? t : best;
        index = closer ? (I)(i) : index;
        KEEP_PLACE)
#endif
    Hit hit;
    hit.t = best;
    hit.primitive = index;
    hit.triangle = (I)(NO_TRIANGLE);
    hit.b1 = PLACE;
    hit.b2 = ZERO;
#if HAS_MESH
    nearest_in_meshes(ray, ray.origin != PATH_ENDED, scene, &hit);
#endif
    return hit;
}

static inline Hit nearest_hit(Ray ray, Scene scene) { return hit_before(ray, (F)(NEVER), scene); }

// Lanes whose ray meets anything before `reach`, but not `target` (of a mesh its triangle `target_triangle` alone) nor what
// lies in its plane. Lanes of reach 0 do not matter. `within`: whether all rays go from surfaces of the scene to its lamps. `passed`: lanes that pass what a path would meet, where LIGHT_PASSES.
static I blocked_before(Ray ray, F reach, I target, I target_triangle, int within, I *passed, Scene scene)
{
    const __global Primitive *primitives = scene.primitives;
    const __global int *kind_end = scene.kind_end;
    I blocked = FALSE;
    *passed = FALSE;
    PLACE_ON_CURVE
    AXES_OF(ray)
#if HAS_HIDDEN
    I kind = (I)(KIND_OF_SHADOW);
#endif
#if HAS_PRIMITIVE_TREE
    EACH_PLANE(ray,
        NOTE_PASSED IF_SEEN t = PAST_HOLES(met & (t > 0.0f) & (t < reach) & (target != i));
        blocked |= met & (t > 0.0f) & (t < reach) & (target != i);)
    I open = (reach > 0.0f) & NOT(blocked);
    EACH_IN_TREE(ray, open, reach,
        NOTE_PASSED IF_SEEN t = PAST_HOLES(met & (t > 0.0f) & (t < reach) & (target != i));
        blocked |= met & (t > 0.0f) & (t < reach) & (target != i);
        open &= NOT(blocked);)
#else
    EACH_PRIMITIVE(ray, FLATS_BETWEEN(reach, target),
        NOTE_PASSED IF_SEEN t = PAST_HOLES(met & (t > 0.0f) & (t < reach) & (target != i));
        blocked |= met & (t > 0.0f) & (t < reach) & (target != i);)
#endif
#if HAS_MESH
    blocked |= blocked_by_meshes(ray, reach, target, target_triangle, (reach > 0.0f) & NOT(blocked), scene);
#endif
    return blocked;
}

static inline I any_hit(Ray ray, F reach, I target, I target_triangle, Scene scene)
{
    I passed;
    return blocked_before(ray, reach, target, target_triangle, 0, &passed, scene);
}

#endif
