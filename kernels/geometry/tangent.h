// The directions dp/du and dp/dv, of true length where there are bumps and else of any, at a point of a given primitive: those of the texture coordinates that
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
#if HAS_BUMP
    F true_length = ONE / absolute(dot3(x, yz));
    axes.along_u = scale(axes.along_u, true_length);
    axes.along_v = scale(axes.along_v, true_length);
    *up = scale(*up, true_length);
#endif
    return axes;
}

#if HAS_BUMP
// Of what is round: `lean` is 0 for a cylinder, 1 for a cone of unit height, -1 for an ellipsoid, which are unit ones at `o`.
static Tangents round_tangents(Tangents axes, F3 z, F3 o, int lean)
{
    F ring = MAX(sqrt(o.x * o.x + o.y * o.y), (F)(SMALLEST));
    F3 outwards = scale(add(scale(axes.along_u, o.x), scale(axes.along_v, o.y)), ONE / ring);
    Tangents t;
    t.along_u = scale(add(scale(axes.along_u, -o.y), scale(axes.along_v, o.x)), (F)(2.0f * PI_F));
    t.along_v = lean < 0 ? scale(along(scale(z, ring), outwards, -o.z), (F)(PI_F)) : along(z, outwards, (F)(-(float)lean));
    return t;
}
#endif

static Tangents tangents_of_affine(const __global Primitive *primitive, F3 p, int flat, int box, int lean)
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
#if HAS_BUMP
        t.along_u = scale(t.along_u, (F)(2.0f));
        t.along_v = scale(t.along_v, (F)(2.0f));
#endif
        return t;
    }
#endif
    F3 o = object_point(primitive, p);
#if HAS_BUMP
    return round_tangents(axes, z, o, lean);
#endif
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
#if HAS_BUMP
        F radius = (F)(primitive->row_x.w * PI_F);
        F height = dot3(z, n);
        t.along_u = scale(t.along_u, 2.0f * radius);
        t.along_v = scale(along(z, n, -height), radius / MAX(root(1.0f - height * height), (F)(SMALLEST)));
#endif
        return t;
    }
#endif
#if HAS_AFFINE
    int round = index < kind_end[KIND_ELLIPSOID] || index >= kind_end[KIND_BOX];
    int box = !round && index >= kind_end[KIND_PLANE];
    int lean = index < kind_end[KIND_ELLIPSOID] ? -1 : index >= kind_end[KIND_CYLINDER];
    return tangents_of_affine(primitive, p, !round && !box, box, lean);
#else
    Tangents none;
    none.along_u = f3(ONE, ZERO, ZERO);
    none.along_v = f3(ZERO, ONE, ZERO);
    return none;
#endif
}

#if HAS_BITANGENT
// The frame of the texture coordinates about the normal: x towards growing u, y at a right angle, on the side of growing v.
static void tangent_frame(SurfacePoint point, F3 *x, F3 *y)
{
    F3 flat = along(point.tangent, point.n, -dot3(point.tangent, point.n));
    F length2 = dot3(flat, flat);
    frame(point.n, x, y);
    *x = select3(length2 > 0.0f, scale(flat, 1.0f / sqrt(MAX(length2, (F)(SMALLEST)))), *x);
    *y = cross3(point.n, *x);
    *y = scale(*y, with_sign(ONE, dot3(*y, point.bitangent)));
}
#endif

#endif
