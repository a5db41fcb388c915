// Where a ray hit: position (re-projected onto the primitive), outward unit normal and texture coordinates.
// Rows are gathered per lane because neighbouring lanes may have hit different primitives.
#ifndef SURFACE_POINT_H
#define SURFACE_POINT_H
#include "geometry/primitives.h"

typedef struct { F3 p, n; F u, v; } SurfacePoint;
typedef struct { F x, y, z, w; } Row;

#define OF_KIND(KIND) ((KIND > 0 ? (hit >= kind_end[KIND > 0 ? KIND - 1 : 0]) : TRUE) & (hit < kind_end[KIND]))

static Row gather_row_x(const __global Primitive *ps, I i)
{
    Row r;
    r.x = GATHER(F, ps, i, .row_x.x); r.y = GATHER(F, ps, i, .row_x.y);
    r.z = GATHER(F, ps, i, .row_x.z); r.w = GATHER(F, ps, i, .row_x.w);
    return r;
}

static Row gather_row_y(const __global Primitive *ps, I i)
{
    Row r;
    r.x = GATHER(F, ps, i, .row_y.x); r.y = GATHER(F, ps, i, .row_y.y);
    r.z = GATHER(F, ps, i, .row_y.z); r.w = GATHER(F, ps, i, .row_y.w);
    return r;
}

static Row gather_row_z(const __global Primitive *ps, I i)
{
    Row r;
    r.x = GATHER(F, ps, i, .row_z.x); r.y = GATHER(F, ps, i, .row_z.y);
    r.z = GATHER(F, ps, i, .row_z.z); r.w = GATHER(F, ps, i, .row_z.w);
    return r;
}

static F  row_at(Row r, F3 p) { return r.x * p.x + r.y * p.y + r.z * p.z + r.w; }
static F3 row_direction(Row r) { return f3(r.x, r.y, r.z); }

#if HAS_TEXTURE && (HAS_SPHERE || HAS_ELLIPSOID || HAS_CYLINDER || HAS_CONE)
static F turns_around(F x, F y) { F a = atan2(y, x) * (0.5f * INV_PI_F); return a < 0.0f ? a + 1.0f : a; }
#endif

static SurfacePoint surface_point(Ray ray, I hit, F t, const __global Primitive *primitives, const __global int *kind_end)
{
    SurfacePoint s;
    s.p = along(ray.o, ray.d, t);
    s.u = ZERO;
    s.v = ZERO;
    I i = MAX(hit, (I)(0));
    Row rx = gather_row_x(primitives, i);
    s.n = f3(ZERO, ZERO, ONE);
#if HAS_SPHERE
    I sphere = OF_KIND(KIND_SPHERE);
    if (ANY(sphere)) {
        F3 from_centre = sub(s.p, row_direction(rx));
        F3 n = normalized(from_centre);
        s.n = select3(sphere, n, s.n);
        s.p = select3(sphere, along(row_direction(rx), n, rx.w), s.p);
#if HAS_TEXTURE
        s.u = sphere ? turns_around(n.x, n.y) : s.u;
        s.v = sphere ? acos(MAX(MIN(n.z, ONE), -ONE)) * INV_PI_F : s.v;
#endif
    }
#endif
#if HAS_AFFINE
#if HAS_SPHERE
    if (ANY(NOT(sphere) & (hit >= 0)))
#endif
    {
        Row ry = gather_row_y(primitives, i);
        Row rz = gather_row_z(primitives, i);
        F3 q = f3(row_at(rx, s.p), row_at(ry, s.p), row_at(rz, s.p));   // the hit in object space
        F3 n = f3(ZERO, ZERO, ONE);                                    // the normal there
#if HAS_RECTANGLE || HAS_DISK || HAS_PLANE
        I flat = OF_KIND(KIND_RECTANGLE) | OF_KIND(KIND_DISK) | OF_KIND(KIND_PLANE);
        F3 up = row_direction(rz);
        F lift = flat ? q.z / dot3(up, up) : ZERO;
        s.p = sub(s.p, scale(up, lift));
        s.u = flat ? q.x : s.u;
        s.v = flat ? q.y : s.v;
#endif
#if HAS_ELLIPSOID
        I ellipsoid = OF_KIND(KIND_ELLIPSOID);
        n = select3(ellipsoid, q, n);
#if HAS_TEXTURE
        s.u = ellipsoid ? turns_around(q.x, q.y) : s.u;
        s.v = ellipsoid ? acos(MAX(MIN(q.z, ONE), -ONE)) * INV_PI_F : s.v;
#endif
#endif
#if HAS_BOX
        I box = OF_KIND(KIND_BOX);
        if (ANY(box)) {
            F ax = absolute(q.x), ay = absolute(q.y), az = absolute(q.z);
            I on_x = (ax >= ay) & (ax >= az);
            I on_y = NOT(on_x) & (ay >= az);
            F3 face = f3(on_x ? with_sign(ONE, q.x) : ZERO, on_y ? with_sign(ONE, q.y) : ZERO,
                         on_x | on_y ? ZERO : with_sign(ONE, q.z));
            n = select3(box, face, n);
            s.u = box ? 0.5f + 0.5f * (on_x ? q.y : q.x) : s.u;
            s.v = box ? 0.5f + 0.5f * (on_x | on_y ? q.z : q.y) : s.v;
        }
#endif
#if HAS_CYLINDER
        I cylinder = OF_KIND(KIND_CYLINDER);
        n = select3(cylinder, f3(q.x, q.y, ZERO), n);
#if HAS_TEXTURE
        s.u = cylinder ? turns_around(q.x, q.y) : s.u;
        s.v = cylinder ? q.z : s.v;
#endif
#endif
#if HAS_CONE
        I cone = OF_KIND(KIND_CONE);
        n = select3(cone, f3(q.x, q.y, 1.0f - q.z), n);
#if HAS_TEXTURE
        s.u = cone ? turns_around(q.x, q.y) : s.u;
        s.v = cone ? q.z : s.v;
#endif
#endif
        F3 w = f3(rx.x * n.x + ry.x * n.y + rz.x * n.z, rx.y * n.x + ry.y * n.y + rz.y * n.z,
                  rx.z * n.x + ry.z * n.y + rz.z * n.z);
#if HAS_SPHERE
        s.n = select3(sphere, s.n, normalized(w));
#else
        s.n = normalized(w);
#endif
    }
#endif
    return s;
}

#endif
