// The directions dp/du and dp/dv, of any length, at a point of a given primitive: those of the texture coordinates that
// surface_point.h gives, v growing towards +z of all that is round.
#ifndef TANGENT_H
#define TANGENT_H
#include "geometry/surface_point.h"

typedef struct { F3 along_u, along_v; } Tangents;

#if HAS_AFFINE
// Columns of world_from_object, all times the same positive number, from the rows of its inverse.
static Tangents object_axes(const __global Primitive *primitive, F3 *up)
{
    F3 x = f3_of(primitive->row_x);
    F3 y = f3_of(primitive->row_y);
    F3 z = f3_of(primitive->row_z);
    F3 yz = cross3(y, z);
    F sign = with_sign(ONE, dot3(x, yz));
    Tangents axes;
    axes.along_u = scale(yz, sign);
    axes.along_v = scale(cross3(z, x), sign);
    *up = scale(cross3(x, y), sign);
    return axes;
}

static Tangents tangents_of_affine(const __global Primitive *primitive, F3 p, int flat, int box)
{
    F3 z;
    Tangents axes = object_axes(primitive, &z);
    if (flat)
        return axes;
    Tangents t;
#if HAS_BOX
    if (box) {                                       // (y, z), (x, z) or (x, y), as the face lies across x, y or z
        Face face = face_of(rows_of_box(primitive), p);
        t.along_u = select3(face.on_x, axes.along_v, axes.along_u);
        t.along_v = select3(face.on_x | face.on_y, z, axes.along_v);
        return t;
    }
#endif
    F3 o = object_point(primitive, p);
    t.along_u = add(scale(axes.along_u, -o.y), scale(axes.along_v, o.x));
    t.along_v = z;
    return t;
}
#endif

static Tangents tangents_of(int index, F3 p, F3 n, Scene scene)
{
    const __global Primitive *primitive = scene.primitives + index;
    const __global int *kind_end = scene.kind_end;
#if HAS_SPHERE
    if (index < kind_end[KIND_SPHERE]) {
        F3 z = f3_of(primitive->row_z);
        Tangents t;
        t.along_u = scale(cross3(z, n), (F)(primitive->row_y.w));
        t.along_v = z;
        return t;
    }
#endif
#if HAS_AFFINE
    int round = index < kind_end[KIND_ELLIPSOID] || index >= kind_end[KIND_BOX];
    int box = !round && index >= kind_end[KIND_PLANE];
    return tangents_of_affine(primitive, p, !round && !box, box);
#else
    Tangents none;
    none.along_u = f3(ONE, ZERO, ZERO);
    none.along_v = f3(ZERO, ONE, ZERO);
    return none;
#endif
}

#endif
