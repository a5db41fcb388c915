// A pack of rays against a binary tree over the bounded primitives: all lanes walk it together, into every box that any of
// them meets before its nearest hit. At the leaves they take the very tests of geometry/primitives.h, so that hits are
// those of the loop over all primitives. Planes are not in the tree.
//
// A node is two float4: middle of its box and `first`, half size and `count`. count > 0: a leaf, primitive_leaves[first ...
// first + count - 1]. Otherwise nodes first and first + 1 are below it, the latter farther along axis ~count.
#ifndef PRIMITIVE_TREE_H
#define PRIMITIVE_TREE_H
#include "geometry/primitives.h"

// HIT_ROUNDING is what a hit of a primitive may be off its surface: boxes are grown by it, so that none is missed.
#define LEAST_SLOPE    1.0e-18f      // direction along an axis, kept off zero so that products stay finite

typedef struct {
    F3   inverse, width;    // 1 / d, and its size
    F3   start;             // o / d
    F3   margin;            // HIT_ROUNDING of the origin, as width
    uint descends;          // bit k: most rays go down along axis k
} PackRay;

static inline F inverse_slope(F d) { return ONE / with_sign(MAX(absolute(d), (F)(LEAST_SLOPE)), d); }

static PackRay pack_ray(Ray ray, I on)
{
    PackRay r;
    r.inverse = f3(inverse_slope(ray.d.x), inverse_slope(ray.d.y), inverse_slope(ray.d.z));
    r.width = f3(absolute(r.inverse.x), absolute(r.inverse.y), absolute(r.inverse.z));
    r.start = mul(ray.o, r.inverse);
    F3 size = f3(absolute(ray.o.x), absolute(ray.o.y), absolute(ray.o.z));
    r.margin = scale(r.width, HIT_ROUNDING * max3(size));
    uint most = COUNT(on) / 2u;
    r.descends = (COUNT((ray.d.x < 0.0f) & on) > most ? 1u : 0u) | (COUNT((ray.d.y < 0.0f) & on) > most ? 2u : 0u)
               | (COUNT((ray.d.z < 0.0f) & on) > most ? 4u : 0u);
    return r;
}

// Lanes that are in a box somewhere between 0 and `limit`.
IN_PLACE static I meets_box(PackRay r, float4 middle, float4 size, F limit)
{
    F3 m = f3(middle.x * r.inverse.x - r.start.x, middle.y * r.inverse.y - r.start.y, middle.z * r.inverse.z - r.start.z);
    F3 k = f3(size.x * r.width.x + r.margin.x, size.y * r.width.y + r.margin.y, size.z * r.width.z + r.margin.z);
    F near = MAX(m.x - k.x, m.y - k.y);
    F near_z = MAX(m.z - k.z, ZERO);
    F far = MIN(m.x + k.x, m.y + k.y);
    F far_z = MIN(m.z + k.z, limit);
    return MAX(near, near_z) <= MIN(far, far_z);
}

#define OF_KIND(KIND)  (i < kind_end[KIND])
#define ONE_PLANE      PlaneHit plane; near_plane(p, here, &plane);
#if HAS_SPHERE
#define IF_SPHERE     if (OF_KIND(KIND_SPHERE)) { SPHERE_T } else
#else
#define IF_SPHERE
#endif
#if HAS_ELLIPSOID
#define IF_ELLIPSOID  if (OF_KIND(KIND_ELLIPSOID)) { ELLIPSOID_T } else
#else
#define IF_ELLIPSOID
#endif
#if HAS_RECTANGLE
#define IF_RECTANGLE  if (OF_KIND(KIND_RECTANGLE)) { ONE_PLANE RECTANGLE_T } else
#else
#define IF_RECTANGLE
#endif
#if HAS_DISK
#define IF_DISK       if (OF_KIND(KIND_DISK)) { ONE_PLANE DISK_T } else
#else
#define IF_DISK
#endif
#if HAS_BOX
#define IF_BOX        if (OF_KIND(KIND_BOX)) { BOX_T } else
#else
#define IF_BOX
#endif
#if HAS_CYLINDER
#define IF_CYLINDER   if (OF_KIND(KIND_CYLINDER)) { CYLINDER_T } else
#else
#define IF_CYLINDER
#endif
#if HAS_CONE
#define IF_CONE       if (OF_KIND(KIND_CONE)) { CONE_T } else
#else
#define IF_CONE
#endif
#if HAS_CURVE
#define IF_CURVE      if (OF_KIND(KIND_CURVE)) { CURVE_T } else
#else
#define IF_CURVE
#endif

// Calls VISIT(index, t) for the primitives of every leaf that a lane of `on` enters before its `limit`; VISIT may lower
// both.
#define EACH_IN_TREE(ray, on, limit, VISIT)                                                 \
    {                                                                                       \
        int todo[PRIMITIVE_STACK];                                                          \
        int depth = 0;                                                                      \
        int node = 0;                                                                       \
        PackRay pack = pack_ray(ray, on);                                                   \
        for (;;) {                                                                          \
            float4 middle = scene.primitive_nodes[2 * node];                                \
            float4 size = scene.primitive_nodes[2 * node + 1];                              \
            if (ANY(meets_box(pack, middle, size, limit) & (on))) {                         \
                int first = as_int(middle.w);                                               \
                int count = as_int(size.w);                                                 \
                if (count <= 0) {                                                           \
                    int far_side = (int)((pack.descends >> (uint)~count) & 1u) ^ 1;         \
                    todo[depth++] = first + far_side;                                       \
                    node = first + (far_side ^ 1);                                          \
                    continue;                                                               \
                }                                                                           \
                for (int k = first; k < first + count; ++k) {                               \
                    int i = scene.primitive_leaves[k];                                      \
                    const __global Primitive *p = primitives + i;                           \
                    I origin = (ray).origin == i;                                               \
                    Ray here = RAY_AT_REST(ray, i);                                         \
                    F t;                                                                    \
                    I met = TRUE;                                                           \
                    IF_SPHERE IF_ELLIPSOID IF_RECTANGLE IF_DISK IF_BOX IF_CYLINDER IF_CONE IF_CURVE \
                        t = (F)(-1.0f);                                                     \
                    VISIT                                                                   \
                }                                                                           \
            }                                                                               \
            if (depth == 0)                                                                 \
                break;                                                                      \
            node = todo[--depth];                                                           \
        }                                                                                   \
    }

#endif
