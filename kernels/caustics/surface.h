// A point on smooth glass or a mirror, where a photon starts, or on any surface, where a light path does: one of the surfaces
// is picked by its share, a point of it by area of its piece of the canonical shape.
#ifndef CAUSTIC_SURFACE_H
#define CAUSTIC_SURFACE_H
#include "common/curve.h"
#include "geometry/hit.h"

typedef struct {
    Hit hit;        // on the surface, of a ray that starts there
    F3  p;          // of what is no mesh
    I   record;     // the surface that was picked
    F   area;       // [m2] that stands for the point: 1 / density
} StartPoint;

#define OF_SURFACE(T, member) GATHER(T, surfaces, k, .member)
#define ROW_OF_SURFACE(row)   f3(OF_SURFACE(F, row.x), OF_SURFACE(F, row.y), OF_SURFACE(F, row.z))

// A point of the canonical shape and the unit normal there.
static F3 canonical_point(I kind, F u, F v, F3 *normal)
{
    F sn, cs;
    sincos_turns(u, &sn, &cs);
    F r = sqrt(v);
#if HAS_PLANE
    // Of planes anywhere, half of the points within 1 of the origin: their density falls as 1 / (1 + r^2)^2.
    r = kind == KIND_PLANE ? sqrt(v / MAX(1.0f - v, (F)(1e-6f))) : r;
#endif
    F z = 1.0f - 2.0f * v;
    F aside = root(1.0f - z * z);
    F3 o = f3(u, v, ZERO);
    *normal = f3(ZERO, ZERO, ONE);
    o = select3((kind == KIND_DISK) | (kind == KIND_PLANE), f3(r * cs, r * sn, ZERO), o);
    I ball = (kind == KIND_SPHERE) | (kind == KIND_ELLIPSOID);
    o = select3(ball, f3(aside * cs, aside * sn, z), o);
    *normal = select3(ball, o, *normal);
    I cylinder = kind == KIND_CYLINDER;
    o = select3(cylinder, f3(cs, sn, v), o);
    *normal = select3(cylinder, f3(cs, sn, ZERO), *normal);
    I cone = kind == KIND_CONE;
    return select3(cone, f3(r * cs, r * sn, 1.0f - r), o);
}

static StartPoint start_point(const __global CausticSurface *surfaces, const __global float *curve, int count, F pick, F u, F v)
{
    F inside, share;
    I k = cell_at(curve, FALSE, count, pick, &inside, &share);
    I kind = OF_SURFACE(I, kind);
    StartPoint s;
    s.record = k;
    s.hit.t = ZERO;
    s.hit.primitive = OF_SURFACE(I, primitive);
    s.hit.triangle = OF_SURFACE(I, triangle);
    // Of a triangle by folding the square along its diagonal.
    I beyond = u + v > 1.0f;
    s.hit.b1 = beyond ? 1.0f - u : u;
    s.hit.b2 = beyond ? 1.0f - v : v;
    // Of others on the canonical shape, whose areas grow by the cofactors of the placement.
    F3 n;
    F across = OF_SURFACE(F, piece.x) + u * OF_SURFACE(F, piece.z), along = OF_SURFACE(F, piece.y) + v * OF_SURFACE(F, piece.w);
    F3 o = canonical_point(kind, across, along, &n);
    F3 rx = ROW_OF_SURFACE(row_x), ry = ROW_OF_SURFACE(row_y), rz = ROW_OF_SURFACE(row_z);
    s.p = f3(dot3(rx, o) + OF_SURFACE(F, row_x.w), dot3(ry, o) + OF_SURFACE(F, row_y.w), dot3(rz, o) + OF_SURFACE(F, row_z.w));
    n = select3(kind == KIND_CONE, scale(f3(o.x, o.y, 1.0f - o.z), (F)(0.707106781f) / MAX(1.0f - o.z, (F)(SMALLEST))), n);
    F3 grown = f3(dot3(cross3(ry, rz), n), dot3(cross3(rz, rx), n), dot3(cross3(rx, ry), n));
    F growth = kind == KIND_MESH ? ONE : sqrt(dot3(grown, grown));
#if HAS_PLANE
    F thinned = 1.0f + o.x * o.x + o.y * o.y;
    growth = kind == KIND_PLANE ? growth * thinned * thinned : growth;
#endif
    s.area = OF_SURFACE(F, area) * growth / MAX(share, (F)(SMALLEST));
    return s;
}

#endif
