// Ray against every primitive of the scene, kind by kind; only the kinds that the scene holds are compiled.
// A primitive's rows map world to object space and keep the ray parameter t; row_z of a flat one has unit length.
// Primitives are sorted by kind; kind_end[k] is the index after the last one of kind k (KIND_… from records.py).
//
// No epsilons: a ray that starts on a primitive has the root t = 0 there, known exactly, so only the other root counts.
// A flat primitive has no other root.
#ifndef PRIMITIVES_H
#define PRIMITIVES_H
#include "common/scene.h"
#include "geometry/hit.h"
#include "geometry/movement.h"
#if HAS_BOX
// Where a ray meets a box, whose slabs have their middles at m and their ends k before and behind. On its surface the farther
// root (by size) is the true one: the way out when the ray goes inwards, behind the start when it goes outwards. Beside the
// box `met` is false.
static inline F hit_slabs(F3 m, F3 k, I origin, I *met)
{
    F near = m.x - k.x;
    F far = m.x + k.x;
    near = MAX(near, m.y - k.y); far = MIN(far, m.y + k.y);
    near = MAX(near, m.z - k.z); far = MIN(far, m.z + k.z);
    F outside = near > 0.0f ? near : far;
    F other = absolute(near) > absolute(far) ? near : far;
    *met = near <= far;
    return origin ? other : outside;
}
#endif

#if ALIGNED_FLATS || ALIGNED_BOXES
#include "geometry/aligned.h"
#define AXES_OF(ray)    Axes axes = axes_of(ray);
#else
#define AXES_OF(ray)
#endif

// The smaller positive root of a t^2 - 2 b t + c = 0 (and the larger through *far); negative when there is none. Stable:
// Haines, Guenther, Akenine-Moeller, Ray Tracing Gems ch. 7.
static inline F quadratic(F a, F b, F c, F discriminant, F *far)
{
    F q = b + with_sign(root(discriminant), b);
    F t0 = c / q;
    F t1 = q / a;
    F lo = MIN(t0, t1);
    F hi = MAX(t0, t1);
    I real = discriminant >= 0.0f;
    *far = real ? hi : (F)(-1.0f);
    return real ? lo : (F)(-1.0f);
}

static inline F3 object_point(const __global Primitive *p, F3 o)
{
    return f3(row_point(p->row_x, o), row_point(p->row_y, o), row_point(p->row_z, o));
}

static inline F3 object_vector(const __global Primitive *p, F3 d)
{
    return f3(row_vector(p->row_x, d), row_vector(p->row_y, d), row_vector(p->row_z, d));
}

#if HUGE_SPHERES
// Whether a sphere is so large beside its distance from the eye that its centre and radius do not tell where its surface is.
// row_z.w holds the power of the eye: its squared distance from the centre, less the squared radius.
static inline int is_huge(const __global Primitive *p)
{
    return fabs(p->row_z.w) < HUGE_POWER * p->row_x.w * p->row_x.w;
}
#endif

#if HAS_SPHERE
// A ray and a sphere: half the way to the far side of it, and of the roots their product and the discriminant.
typedef struct { F b, c, discriminant; } SphereRay;

// row_x holds centre and radius; the direction has unit length. The discriminant is r^2 minus the squared distance of the
// centre from the ray, which survives a far origin; b^2 - c would not.
static SphereRay near_sphere(const __global Primitive *p, Ray ray, I origin)
{
    F3 oc = sub(ray.o, f3_of(p->row_x));
    F b = -dot3(oc, ray.d);
    F3 l = along(oc, ray.d, b);
    F r = (F)(p->row_x.w);
    F c = dot3(oc, oc) - r * r;
    F discriminant = r * r - dot3(l, l);
#if HUGE_SPHERES
    if (is_huge(p)) {       // (o - C)^2 - r^2 by the power of the eye, in which the host has let the large terms cancel
        c = dot3(ray.o, sub(oc, f3_of(p->row_x))) + p->row_z.w;
        discriminant = b * b - c;
    }
#endif
    SphereRay s;
    s.b = b;
    s.c = origin ? ZERO : c;
    s.discriminant = origin ? b * b : discriminant;
    return s;
}

// The nearest root above zero, or one below, where the discriminant is not negative.
static inline F hit_sphere(SphereRay s)
{
    F q = s.b + with_sign(root(s.discriminant), s.b);
    F other = s.c / q;
    F near = MIN(other, q);
    return near > 0.0f ? near : MAX(other, q);
}
#endif

#if HAS_ELLIPSOID
static F hit_ellipsoid(const __global Primitive *p, Ray ray, I origin)
{
    F3 o = object_point(p, ray.o);
    F3 d = object_vector(p, ray.d);
    F a = dot3(d, d);
    F b = -dot3(o, d);
    F3 l = along(o, d, b / a);
    F c = origin ? ZERO : dot3(o, o) - 1.0f;
    F discriminant = origin ? b * b : a * (1.0f - dot3(l, l));
    F far;
    F near = quadratic(a, b, c, discriminant, &far);
    return near > 0.0f ? near : far;
}
#endif

#if HAS_RECTANGLE || HAS_DISK || HAS_PLANE
// What flat primitives hold where meshes have their instance (rendering/plan/geometry.py): of those that follow one another
// in a plane and stay there the first has their number, less than zero where nothing lies behind the plane; others have 0.
static inline int begins_plane(const __global Primitive *flat) { return flat->instance != 0; }
static inline int is_outer_plane(const __global Primitive *flat) { return flat->instance < 0; }
static inline int flats_in_plane(const __global Primitive *flat) { return (int)abs(flat->instance); }

// How far a point lies above a plane, the other way round, and how fast a ray nears it: their ratio is the distance.
static inline F fall_to(const __global Primitive *p, F3 o)
{
    float4 r = p->row_z;
    return -r.x * o.x - r.w - r.y * o.y - r.z * o.z;
}

static inline F hit_plane(const __global Primitive *p, Ray ray) { return fall_to(p, ray.o) / row_vector(p->row_z, ray.d); }
#endif

#if HAS_RECTANGLE || HAS_DISK
#define BITS_OF_ONE  0x3f800000u    // taken as unsigned, those of all from +0 to 1 are no greater
#define LITTLE_MORE  1.0001f        // than any rounding of a product and a ratio

// The plane that a ray met last and where: flat primitives of one plane, as a lamp and the ceiling round it, share it.
#if ALIGNED_FLATS
typedef AlignedHit PlaneHit;
#define MEET_PLANE  plane = meet_aligned(scene.aligned + i, here, axes);
#define HIT_FLAT    hit_aligned(scene.aligned + i, plane, &u, &v)

static inline I meets_before(const PlaneHit *plane, F reach) { return (plane->t > 0.0f) & (plane->t < reach); }
#else
typedef struct {
    F   fall, slope;
    int found;       // whether t and there are those of the plane
    F   t;
    F3  there;
} PlaneHit;
#define MEET_PLANE  near_plane(p, here, &plane);
#define HIT_FLAT    hit_flat(p, here, &plane, &u, &v)

static inline void near_plane(const __global Primitive *p, Ray ray, PlaneHit *plane)
{
    plane->fall = fall_to(p, ray.o);
    plane->slope = row_vector(p->row_z, ray.d);
    plane->found = 0;
}

// Lanes that meet the plane before `reach`, and perhaps a few more.
static inline I meets_before(const PlaneHit *plane, F reach)
{
    I before = absolute(plane->fall) < reach * LITTLE_MORE * absolute(plane->slope);
    return (plane->fall * plane->slope > 0.0f) & before;
}

static inline F hit_flat(const __global Primitive *p, Ray ray, PlaneHit *plane, F *u, F *v)
{
    if (!plane->found) {
        plane->t = plane->fall / plane->slope;
        plane->there = along(ray.o, ray.d, plane->t);
        plane->found = 1;
    }
    *u = row_point(p->row_x, plane->there);
    *v = row_point(p->row_y, plane->there);
    return plane->t;
}
#endif

// What FOR_EACH_FLAT leaves out: nothing, or what no lane can meet on its way to a target, which perhaps lies in the same plane.
// On ways `within` the scene, from surfaces to lamps, that is any plane that nothing lies behind.
#define ALL_FLATS
#define FLATS_BETWEEN(reach, target)                                               \
    if (is_outer_plane(p) && within) {                                             \
        i += flats_in_plane(p) - 1;                                                \
        continue;                                                                  \
    }                                                                              \
    if (begins_plane(p))                                                           \
        between = meets_before(&plane, reach) & (AS_U(target - i) >= (uint)flats_in_plane(p)); \
    origin = NOT(between & NOT(origin));                                           \
    if (!ANY(NOT(origin)))                                                         \
        continue;
#endif

#if HAS_BOX
// The cube [-1, 1]^3.
static F hit_box(const __global Primitive *p, Ray ray, I origin, I *met)
{
    F3 o = object_point(p, ray.o);
    F3 d = object_vector(p, ray.d);
    F3 i;
    i.x = ONE / with_sign(MAX(absolute(d.x), (F)(1e-30f)), d.x);
    i.y = ONE / with_sign(MAX(absolute(d.y), (F)(1e-30f)), d.y);
    i.z = ONE / with_sign(MAX(absolute(d.z), (F)(1e-30f)), d.z);
    F3 m = f3(-o.x * i.x, -o.y * i.y, -o.z * i.z);
    F3 k = f3(absolute(i.x), absolute(i.y), absolute(i.z));
    return hit_slabs(m, k, origin, met);
}
#endif

#if HAS_CYLINDER || HAS_CONE
static inline F first_within(F near, F far, F oz, F dz)
{
    F zn = oz + near * dz;
    F zf = oz + far * dz;
    I first = (near > 0.0f) & (zn >= 0.0f) & (zn <= 1.0f);
    I second = (far > 0.0f) & (zf >= 0.0f) & (zf <= 1.0f);
    return first ? near : (second ? far : (F)(-1.0f));
}
#endif

#if HAS_CYLINDER
// x^2 + y^2 = 1, 0 <= z <= 1, open at both ends.
static F hit_cylinder(const __global Primitive *p, Ray ray, I origin)
{
    F3 o = object_point(p, ray.o);
    F3 d = object_vector(p, ray.d);
    F a = d.x * d.x + d.y * d.y;
    F b = -(o.x * d.x + o.y * d.y);
    F c = origin ? ZERO : o.x * o.x + o.y * o.y - 1.0f;
    F cross = o.x * d.y - o.y * d.x;
    F discriminant = origin ? b * b : a - cross * cross;
    F far;
    F near = quadratic(a, b, c, discriminant, &far);
    return first_within(near, far, o.z, d.z);
}
#endif

#if HAS_CONE
// x^2 + y^2 = (1 - z)^2, 0 <= z <= 1: apex at z = 1, open at the base.
static F hit_cone(const __global Primitive *p, Ray ray, I origin)
{
    F3 o = object_point(p, ray.o);
    F3 d = object_vector(p, ray.d);
    F h = 1.0f - o.z;
    F a = d.x * d.x + d.y * d.y - d.z * d.z;
    F b = -(o.x * d.x + o.y * d.y + h * d.z);
    F c = origin ? ZERO : o.x * o.x + o.y * o.y - h * h;
    // b^2 - a c as the Gram determinant of o and d in the cone's quadratic form: no large terms cancel.
    F xy = o.x * d.y - o.y * d.x;
    F yh = o.y * d.z + h * d.y;
    F hx = h * d.x + o.x * d.z;
    F discriminant = origin ? b * b : yh * yh + hx * hx - xy * xy;
    F far;
    F near = quadratic(a, b, c, discriminant, &far);
    return first_within(near, far, o.z, d.z);
}
#endif

#if HAS_CURVE
#include "geometry/cubic_curve.h"
#endif

// How each kind finds `t` of the primitive p from the ray `here`, which is taken to where p is at rest: negative, infinite
// or NaN where there is no hit. Flat kinds hit where `met` only, so that masks need not go through t.
// In the loop over all spheres, those that no lane meets ahead are left out; in leaves of a tree that is dearer.
#define SPHERE_T     SphereRay s = near_sphere(p, here, origin); met = s.discriminant >= 0.0f; t = hit_sphere(s);
#define AHEAD_SPHERE_T                                                                             \
                     SphereRay s = near_sphere(p, here, origin);                                   \
                     met = (s.discriminant >= 0.0f) & (MAX(s.b, -s.c) >= 0.0f);                    \
                     if (!ANY(met))                                                                \
                         continue;                                                                 \
                     t = hit_sphere(s);
#define ELLIPSOID_T  t = hit_ellipsoid(p, here, origin);
#define RECTANGLE_T  F u; F v; t = HIT_FLAT;                                                       \
                     met = NOT(origin) & (MAX(AS_U(u), AS_U(v)) <= BITS_OF_ONE);
#define DISK_T       F u; F v; t = HIT_FLAT;                                                       \
                     met = NOT(origin) & (u * u + v * v <= 1.0f);
#if ALIGNED_FLATS
#define HIT_PLANE    meet_aligned(scene.aligned + i, here, axes).t
#else
#define HIT_PLANE    hit_plane(p, here)
#endif
#define PLANE_T      if (is_outer_plane(p) && within)                                              \
                         continue;                                                                 \
                     t = HIT_PLANE;                                                                \
                     met = NOT(origin);
#if ALIGNED_BOXES
#define BOX_T        t = hit_aligned_box(scene.aligned + i, here, axes, origin, &met);
#else
#define BOX_T        t = hit_box(p, here, origin, &met);
#endif
#define CYLINDER_T   t = hit_cylinder(p, here, origin);
#define CONE_T       t = hit_cone(p, here, origin);
#define CURVE_T      t = hit_curve(p, here, STARTS_ON_CURVE(here.origin, kind_end), &on_curve);

// Calls VISIT(index, t, met) for every primitive.
#define FOR_EACH_OF_KIND(KIND, ray, VISIT, HIT)                                    \
    for (int i = KIND > 0 ? kind_end[KIND - 1] : 0; i < kind_end[KIND]; ++i) {      \
        const __global Primitive *p = primitives + i;                              \
        I origin = (ray).origin == i;                                                  \
        Ray here = RAY_AT_REST(ray, i);                                            \
        F t;                                                                       \
        I met = TRUE;                                                              \
        HIT                                                                        \
        VISIT                                                                      \
    }

// The same of flat kinds, of which WHICH leaves out some.
#define FOR_EACH_FLAT(KIND, ray, WHICH, VISIT, HIT)                                \
    {                                                                              \
        PlaneHit plane;                                                            \
        I between = FALSE;                                                         \
        for (int i = kind_end[KIND - 1]; i < kind_end[KIND]; ++i) {                 \
            const __global Primitive *p = primitives + i;                          \
            Ray here = RAY_AT_REST(ray, i);                                        \
            I origin = (ray).origin == i;                                              \
            if (begins_plane(p))                                                   \
                MEET_PLANE                                                         \
            WHICH                                                                  \
            F t;                                                                   \
            I met = TRUE;                                                          \
            HIT                                                                    \
            VISIT                                                                  \
        }                                                                          \
    }

#if HAS_SPHERE
#define EACH_SPHERE(ray, VISIT) FOR_EACH_OF_KIND(KIND_SPHERE, ray, VISIT, AHEAD_SPHERE_T)
#else
#define EACH_SPHERE(ray, VISIT)
#endif
#if HAS_ELLIPSOID
#define EACH_ELLIPSOID(ray, VISIT) FOR_EACH_OF_KIND(KIND_ELLIPSOID, ray, VISIT, ELLIPSOID_T)
#else
#define EACH_ELLIPSOID(ray, VISIT)
#endif
#if HAS_RECTANGLE
#define EACH_RECTANGLE(ray, WHICH, VISIT) FOR_EACH_FLAT(KIND_RECTANGLE, ray, WHICH, VISIT, RECTANGLE_T)
#else
#define EACH_RECTANGLE(ray, WHICH, VISIT)
#endif
#if HAS_DISK
#define EACH_DISK(ray, WHICH, VISIT) FOR_EACH_FLAT(KIND_DISK, ray, WHICH, VISIT, DISK_T)
#else
#define EACH_DISK(ray, WHICH, VISIT)
#endif
#if HAS_PLANE
#define EACH_PLANE(ray, VISIT) FOR_EACH_OF_KIND(KIND_PLANE, ray, VISIT, PLANE_T)
#else
#define EACH_PLANE(ray, VISIT)
#endif
#if HAS_BOX
#define EACH_BOX(ray, VISIT) FOR_EACH_OF_KIND(KIND_BOX, ray, VISIT, BOX_T)
#else
#define EACH_BOX(ray, VISIT)
#endif
#if HAS_CYLINDER
#define EACH_CYLINDER(ray, VISIT) FOR_EACH_OF_KIND(KIND_CYLINDER, ray, VISIT, CYLINDER_T)
#else
#define EACH_CYLINDER(ray, VISIT)
#endif
#if HAS_CONE
#define EACH_CONE(ray, VISIT) FOR_EACH_OF_KIND(KIND_CONE, ray, VISIT, CONE_T)
#else
#define EACH_CONE(ray, VISIT)
#endif
#if HAS_CURVE
#define EACH_CURVE(ray, VISIT) FOR_EACH_OF_KIND(KIND_CURVE, ray, VISIT, CURVE_T)
#else
#define EACH_CURVE(ray, VISIT)
#endif
#define EACH_PRIMITIVE(ray, WHICH, VISIT)                                                   \
    EACH_SPHERE(ray, VISIT) EACH_ELLIPSOID(ray, VISIT) EACH_RECTANGLE(ray, WHICH, VISIT)    \
    EACH_DISK(ray, WHICH, VISIT) EACH_PLANE(ray, VISIT) EACH_BOX(ray, VISIT)                       \
    EACH_CYLINDER(ray, VISIT) EACH_CONE(ray, VISIT) EACH_CURVE(ray, VISIT)

#endif
