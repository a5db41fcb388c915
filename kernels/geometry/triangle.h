// The point of a mesh that a ray met: gathered per lane, as lanes mostly hit different triangles.
#ifndef TRIANGLE_H
#define TRIANGLE_H
#include "common/scene.h"
#include "common/transpose.h"
#include "geometry/hit.h"
#include "geometry/surface.h"

// A corner as it lies in memory: position, normal (zero: none), texture coordinates.
static inline Eight corner(Scene scene, I index) { return load_eight(scene.vertices, index * 8); }

// The power of two that brings the largest of six coordinates to between 1 and 2: products of four edges, as the square of a
// normal, stay within float32, and all bits stay as they are.
static inline F scale_of_edges(F3 a, F3 b)
{
    F3 each = f3(MAX(absolute(a.x), absolute(b.x)), MAX(absolute(a.y), absolute(b.y)), MAX(absolute(a.z), absolute(b.z)));
    return AS_F((I)(2 * EXPONENT_BIAS << EXPONENT_SHIFT) - (AS_I(max3(each)) & (I)(INFINITE)));
}

static inline F blend(F a, F b, F c, F b0, F b1, F b2) { return b0 * a + b1 * b + b2 * c; }

// Bound of the rounding of a blended coordinate: seven roundings of its terms (Pharr, Jakob, Humphreys 2016, 3.9.4).
#define BLEND_ROUNDING  4.2e-7f
static inline F blend_error(F a, F b, F c, F b0, F b1, F b2)
{
    return BLEND_ROUNDING * (absolute(b0 * a) + absolute(b1 * b) + absolute(b2 * c));
}

#if HAS_INSTANCES
#define INSTANCE_ROUNDING 2.4e-7f
#define GATHER_ROW(row) (Quad){GATHER(F, scene.instances, instance, .row.x), GATHER(F, scene.instances, instance, .row.y), \
                               GATHER(F, scene.instances, instance, .row.z), GATHER(F, scene.instances, instance, .row.w)}
typedef struct { F x, y, z, w; } Quad;

static inline F quad_point(Quad r, F3 p)       { return r.x * p.x + r.y * p.y + r.z * p.z + r.w; }
static inline F quad_vector(Quad r, F3 d)      { return r.x * d.x + r.y * d.y + r.z * d.z; }
static inline F quad_error(Quad r, F3 p, F3 e)
{
    F size = absolute(r.x * p.x) + absolute(r.y * p.y) + absolute(r.z * p.z) + absolute(r.w);
    return absolute(r.x) * e.x + absolute(r.y) * e.y + absolute(r.z) * e.z + INSTANCE_ROUNDING * size;
}
#endif

// Of lanes that hit a mesh; anything in the others.
static SurfacePoint point_on_mesh(Hit hit, I on, Scene scene)
{
    I triangle = on ? hit.triangle : FALSE;
    F b1 = hit.b1, b2 = hit.b2;
    F b0 = ONE - b1 - b2;
    Eight a = corner(scene, GATHER(I, scene.triangles, triangle, .x));
    Eight b = corner(scene, GATHER(I, scene.triangles, triangle, .y));
    Eight c = corner(scene, GATHER(I, scene.triangles, triangle, .z));
    SurfacePoint s;
    s.p = f3(blend(a.f[0], b.f[0], c.f[0], b0, b1, b2), blend(a.f[1], b.f[1], c.f[1], b0, b1, b2),
             blend(a.f[2], b.f[2], c.f[2], b0, b1, b2));
    F3 error = f3(blend_error(a.f[0], b.f[0], c.f[0], b0, b1, b2), blend_error(a.f[1], b.f[1], c.f[1], b0, b1, b2),
                  blend_error(a.f[2], b.f[2], c.f[2], b0, b1, b2));
    F3 ab = f3(b.f[0] - a.f[0], b.f[1] - a.f[1], b.f[2] - a.f[2]);
    F3 ac = f3(c.f[0] - a.f[0], c.f[1] - a.f[1], c.f[2] - a.f[2]);
    F unit = scale_of_edges(ab, ac);
    ab = scale(ab, unit);
    ac = scale(ac, unit);
    s.ng = cross3(ab, ac);
    s.n = f3(blend(a.f[3], b.f[3], c.f[3], b0, b1, b2), blend(a.f[4], b.f[4], c.f[4], b0, b1, b2),
             blend(a.f[5], b.f[5], c.f[5], b0, b1, b2));
    s.u = blend(a.f[6], b.f[6], c.f[6], b0, b1, b2);
    s.v = blend(a.f[7], b.f[7], c.f[7], b0, b1, b2);
#if HAS_TANGENT
    // dp/du from the edges and their texture coordinates; across a triangle without any, along its first edge.
    F u1 = b.f[6] - a.f[6], v1 = b.f[7] - a.f[7], u2 = c.f[6] - a.f[6], v2 = c.f[7] - a.f[7];
    F turn = with_sign(ONE, u1 * v2 - u2 * v1);
    F3 along_u = scale(sub(scale(ab, v2), scale(ac, v1)), turn);
    s.tangent = select3(dot3(along_u, along_u) > 0.0f, along_u, ab);
#endif
#if HAS_BITANGENT
    s.bitangent = scale(sub(scale(ac, u1), scale(ab, u2)), turn);
#endif
#if HAS_BUMP
    // To their true lengths; none where the texture coordinates lie on a line.
    F turned = absolute(u1 * v2 - u2 * v1) * unit;
    I known = turned > 0.0f;
    F true_length = ONE / (known ? turned : ONE);
    s.tangent = scale(s.tangent, true_length);
    s.bitangent = keep3(known, scale(s.bitangent, true_length));
#endif
#if HAS_INSTANCES
    I instance = on ? GATHER(I, scene.primitives, on ? hit.primitive : FALSE, .instance) : FALSE;
    Quad x = GATHER_ROW(world_x), y = GATHER_ROW(world_y), z = GATHER_ROW(world_z);
    Quad ox = GATHER_ROW(row_x), oy = GATHER_ROW(row_y), oz = GATHER_ROW(row_z);
    error = f3(quad_error(x, s.p, error), quad_error(y, s.p, error), quad_error(z, s.p, error));
    s.p = f3(quad_point(x, s.p), quad_point(y, s.p), quad_point(z, s.p));
    F3 ng = s.ng, n = s.n;      // normals go by the transpose of object_from_world
    s.ng = f3(ox.x * ng.x + oy.x * ng.y + oz.x * ng.z, ox.y * ng.x + oy.y * ng.y + oz.y * ng.z,
              ox.z * ng.x + oy.z * ng.y + oz.z * ng.z);
    s.n = f3(ox.x * n.x + oy.x * n.y + oz.x * n.z, ox.y * n.x + oy.y * n.y + oz.y * n.z,
             ox.z * n.x + oy.z * n.y + oz.z * n.z);
#if HAS_TANGENT
    s.tangent = f3(quad_vector(x, s.tangent), quad_vector(y, s.tangent), quad_vector(z, s.tangent));
#endif
#if HAS_BITANGENT
    s.bitangent = f3(quad_vector(x, s.bitangent), quad_vector(y, s.bitangent), quad_vector(z, s.bitangent));
#endif
#endif
    s.ng = normalized(s.ng);
    I smooth = dot3(s.n, s.n) > 0.0f;
    s.n = select3(smooth, normalized(s.n), s.ng);
    s.ng = scale(s.ng, with_sign(ONE, dot3(s.ng, s.n)));        // the vertex normals say which side is out
    // How far along the normal the true surface may lie from p, and the rounding of adding it.
    s.offset = (error.x + ROUNDING * absolute(s.p.x)) * absolute(s.ng.x)
             + (error.y + ROUNDING * absolute(s.p.y)) * absolute(s.ng.y)
             + (error.z + ROUNDING * absolute(s.p.z)) * absolute(s.ng.z);
    return s;
}

#endif
