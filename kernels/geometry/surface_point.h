// Where a ray hit a given primitive: position (re-projected onto it), outward unit normal and texture coordinates.
#ifndef SURFACE_POINT_H
#define SURFACE_POINT_H
#include "common/angles.h"
#include "geometry/primitives.h"
#include "geometry/surface.h"
#if HAS_MESH
#include "geometry/triangle.h"
#endif

// Kinds stand in the order of KIND_…, so the first end above the index tells the kind.
#define BELONGS_TO(KIND) (index < kind_end[KIND])

#if HAS_SPHERE
static SurfacePoint point_on_sphere(const __global Primitive *primitive, F3 p, int textured)
{
    SurfacePoint s;
    F3 centre = f3_of(primitive->row_x);
    s.n = normalized(sub(p, centre));
    s.p = along(centre, s.n, (F)(primitive->row_x.w));
#if HUGE_SPHERES
    if (is_huge(primitive))
        s.p = p;
#endif
    s.u = ZERO;
    s.v = ZERO;
#if HAS_TEXTURE
    if (textured) {                                  // row_y, row_z: the x and z axes of the sphere; row_y.w: handedness
        F3 x = f3_of(primitive->row_y);
        F3 z = f3_of(primitive->row_z);
        F east = dot3(x, s.n);
        F north = dot3(cross3(z, x), s.n) * primitive->row_y.w;
        s.u = turns_around(east, north);
        s.v = share_upwards(dot3(z, s.n), sqrt(east * east + north * north));
    }
#endif
    return s;
}
#endif

#if HAS_AFFINE
// The world's normal of an object's normal: the transpose of object_from_world.
static inline F3 world_normal(const __global Primitive *q, F3 n)
{
    return normalized(f3(q->row_x.x * n.x + q->row_y.x * n.y + q->row_z.x * n.z,
                         q->row_x.y * n.x + q->row_y.y * n.y + q->row_z.y * n.z,
                         q->row_x.z * n.x + q->row_y.z * n.y + q->row_z.z * n.z));
}
#endif

#if HAS_RECTANGLE || HAS_DISK || HAS_PLANE
static SurfacePoint point_on_flat(const __global Primitive *primitive, F3 p)
{
    SurfacePoint s;
    F3 o = object_point(primitive, p);
    s.n = f3_of(primitive->row_z);
    s.p = along(p, s.n, -o.z);
    s.u = o.x;
    s.v = o.y;
    return s;
}
#endif

#if HAS_ELLIPSOID
static SurfacePoint point_on_ellipsoid(const __global Primitive *primitive, F3 p, int textured)
{
    SurfacePoint s;
    F3 o = object_point(primitive, p);
    s.p = p;
    s.n = world_normal(primitive, o);
    s.u = ZERO;
    s.v = ZERO;
#if HAS_TEXTURE
    if (textured) {
        s.u = turns_around(o.x, o.y);
        s.v = share_upwards(o.z, sqrt(o.x * o.x + o.y * o.y));
    }
#endif
    return s;
}
#endif

#if HAS_BOX
// A box as its lanes see it: the three rows of object_from_world, and how far apart in the world the planes 0 and 1 of each
// object coordinate lie.
typedef struct {
    F3 x, y, z;
    F3 w;
    F3 reach;
} BoxRows;

static inline float reach_of(float4 row) { return 1.0f / sqrt(row.x * row.x + row.y * row.y + row.z * row.z); }

static inline BoxRows rows_of_box(const __global Primitive *p)
{
    BoxRows rows;
    rows.x = f3_of(p->row_x);
    rows.y = f3_of(p->row_y);
    rows.z = f3_of(p->row_z);
    rows.w = f3((F)(p->row_x.w), (F)(p->row_y.w), (F)(p->row_z.w));
    rows.reach = f3((F)(reach_of(p->row_x)), (F)(reach_of(p->row_y)), (F)(reach_of(p->row_z)));
    return rows;
}

typedef struct {
    F3 o;                   // the point in the box's own frame
    I  on_x, on_y;          // the face that it lies on; on neither: across z
} Face;

// The face is the nearest one by distance in the world, so that a thin box has no false side faces near its edges.
static inline Face face_of(BoxRows rows, F3 p)
{
    Face face;
    face.o = f3(dot3(rows.x, p) + rows.w.x, dot3(rows.y, p) + rows.w.y, dot3(rows.z, p) + rows.w.z);
    F ax = absolute(1.0f - absolute(face.o.x)) * rows.reach.x;
    F ay = absolute(1.0f - absolute(face.o.y)) * rows.reach.y;
    F az = absolute(1.0f - absolute(face.o.z)) * rows.reach.z;
    face.on_x = (ax <= ay) & (ax <= az);
    face.on_y = NOT(face.on_x) & (ay <= az);
    return face;
}

// Outward unit normal: the row of the coordinate that the face lies across. Without -0, as the sign of z turns frames.
static inline F3 normal_of_face(BoxRows rows, Face face)
{
    F3 row = select3(face.on_x, rows.x, select3(face.on_y, rows.y, rows.z));
    F across = face.on_x ? face.o.x : (face.on_y ? face.o.y : face.o.z);
    F reach = face.on_x ? rows.reach.x : (face.on_y ? rows.reach.y : rows.reach.z);
    return add(scale(row, with_sign(reach, across)), f3(ZERO, ZERO, ZERO));
}

static inline SurfacePoint point_on_box(const __global Primitive *primitive, F3 p)
{
    SurfacePoint s;
    BoxRows rows = rows_of_box(primitive);
    Face face = face_of(rows, p);
    s.p = p;
    s.n = normal_of_face(rows, face);
    s.u = 0.5f + 0.5f * (face.on_x ? face.o.y : face.o.x);
    s.v = 0.5f + 0.5f * ((face.on_x | face.on_y) ? face.o.z : face.o.y);
    return s;
}
#endif

#if HAS_CYLINDER || HAS_CONE
// `lean` is 0 for a cylinder and 1 for a cone of unit height.
static SurfacePoint point_on_round(const __global Primitive *primitive, F3 p, float lean, int textured)
{
    SurfacePoint s;
    F3 o = object_point(primitive, p);
    s.p = p;
    s.n = world_normal(primitive, f3(o.x, o.y, lean * (1.0f - o.z)));
    s.u = ZERO;
    s.v = o.z;
#if HAS_TEXTURE
    if (textured)
        s.u = turns_around(o.x, o.y);
#endif
    return s;
}
#endif

static SurfacePoint point_on_primitive(int index, F3 p, int textured, Scene scene)
{
    const __global Primitive *primitive = scene.primitives + index;
    const __global int *kind_end = scene.kind_end;
#if HAS_SPHERE
    if (BELONGS_TO(KIND_SPHERE))
        return point_on_sphere(primitive, p, textured);
#endif
#if HAS_ELLIPSOID
    if (BELONGS_TO(KIND_ELLIPSOID))
        return point_on_ellipsoid(primitive, p, textured);
#endif
#if HAS_RECTANGLE || HAS_DISK || HAS_PLANE
    if (BELONGS_TO(KIND_PLANE))
        return point_on_flat(primitive, p);
#endif
#if HAS_BOX
    if (BELONGS_TO(KIND_BOX))
        return point_on_box(primitive, p);
#endif
#if HAS_CYLINDER
    if (BELONGS_TO(KIND_CYLINDER))
        return point_on_round(primitive, p, 0.0f, textured);
#endif
#if HAS_CONE
    return point_on_round(primitive, p, 1.0f, textured);
#else
    SurfacePoint nowhere;
    nowhere.p = p;
    nowhere.n = f3(ZERO, ZERO, ONE);
    nowhere.u = ZERO;
    nowhere.v = ZERO;
    return nowhere;
#endif
}

// `textured` says whether u and v are wanted (those of round shapes are dear).
static inline SurfacePoint surface_point(int index, F3 p, int textured, Scene scene)
{
    SurfacePoint s = point_on_primitive(index, p, textured, scene);
    s.ng = s.n;
    s.offset = ZERO;
    return s;
}

#endif
