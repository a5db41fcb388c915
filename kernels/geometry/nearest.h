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
#if HAS_OPACITY
#include "geometry/surface_point.h"
#include "material/opacity.h"

// Takes from the lanes that hit primitive i at t those where it has a hole.
static I without_holes(I lanes, Ray ray, F t, int i, Scene scene)
{
    const __global Material *material = scene.materials + scene.primitives[i].material;
    if (!has_holes(material) || !ANY(lanes))
        return lanes;
    SurfacePoint point = surface_point(i, along(ray.o, ray.d, lanes ? t : ZERO), material->textured, scene);
    return lanes & is_there(material, point.u, point.v, ray_chance(ray.o, ray.d, (I)(i), (I)(NO_TRIANGLE)), scene);
}
#define WITHOUT_HOLES(lanes) without_holes(lanes, ray, t, i, scene)
#else
#define WITHOUT_HOLES(lanes) (lanes)
#endif

// What the ray meets first.
static Hit nearest_hit(Ray ray, Scene scene)
{
    const __global Primitive *primitives = scene.primitives;
    const __global int *kind_end = scene.kind_end;
    F best = (F)(NEVER);
    I index = (I)(NO_PRIMITIVE);
#if HAS_PRIMITIVE_TREE
    I living = ray.self != PATH_ENDED;
    EACH_PLANE(ray,
        I closer = WITHOUT_HOLES((t > 0.0f) & (t < best));
        best = closer ? t : best;
        index = closer ? (I)(i) : index;)
    // The tree has an order of its own: of two at the same distance the first of the list counts, as in the loop.
    EACH_IN_TREE(ray, living, best,
        I closer = WITHOUT_HOLES((t > 0.0f) & ((t < best) | ((t == best) & (index > i))));
        best = closer ? t : best;
        index = closer ? (I)(i) : index;)
#else
    EACH_PRIMITIVE(ray,
        I closer = WITHOUT_HOLES((t > 0.0f) & (t < best));
        best = closer ? t : best;
        index = closer ? (I)(i) : index;)
#endif
    Hit hit;
    hit.t = best;
    hit.primitive = index;
    hit.part = (I)(NO_TRIANGLE);
    hit.b1 = ZERO;
    hit.b2 = ZERO;
#if HAS_MESH
    nearest_in_meshes(ray, ray.self != PATH_ENDED, scene, &hit);
#endif
    return hit;
}

// Lanes whose ray meets anything before `reach`, but not `target` (of a mesh its triangle `target_part` alone). Lanes of
// reach 0 do not matter.
static I any_hit(Ray ray, F reach, I target, I target_part, Scene scene)
{
    const __global Primitive *primitives = scene.primitives;
    const __global int *kind_end = scene.kind_end;
    I blocked = FALSE;
#if HAS_PRIMITIVE_TREE
    EACH_PLANE(ray,
        blocked |= WITHOUT_HOLES((t > 0.0f) & (t < reach) & (target != i));)
    I open = (reach > 0.0f) & NOT(blocked);
    EACH_IN_TREE(ray, open, reach,
        blocked |= WITHOUT_HOLES((t > 0.0f) & (t < reach) & (target != i));
        open &= NOT(blocked);)
#else
    EACH_PRIMITIVE(ray,
        blocked |= WITHOUT_HOLES((t > 0.0f) & (t < reach) & (target != i));)
#endif
#if HAS_MESH
    blocked |= blocked_by_meshes(ray, reach, target, target_part, (reach > 0.0f) & NOT(blocked), scene);
#endif
    return blocked;
}

#endif
