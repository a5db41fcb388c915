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

// How the walk keeps its place: DOWN goes to one child of a node while the other waits, BACK to the last that waits, or ends
// the loop.
#if VW == 1 && PRIMITIVE_STACK <= 32
// A GPU puts arrays that are indexed at run time into memory. So a single ray has a bit a level for what is behind it, one for
// what waits, and the next PLACES_HELD of these in registers. Where it has lost one, it starts again at the root, as in
// geometry/short_stack.h; which child is nearer depends on the ray alone.
#ifndef PLACES_HELD
#define PLACES_HELD 4           // 4 at most; tests take fewer
#endif
typedef struct {
    uint level, done, open;     // a bit a level: where it is, where the nearer child is done, where the farther one waits
    int  s0, s1, s2, s3;
    uint held;
} PlaceInTree;

static int down_from(PlaceInTree *at, int near, int far)
{
    uint level = at->level;
    at->level = level << 1;
    if (at->done & level)
        return far;
    at->open |= level;
    at->s3 = at->s2; at->s2 = at->s1; at->s1 = at->s0; at->s0 = far;
    at->held = min(at->held + 1u, (uint)PLACES_HELD);
    return near;
}

static int back_from(PlaceInTree *at)       // -1 at the end
{
    at->open &= at->level - 1u;             // the way from the root may end before all of it, at a box too far by now
    if (at->open == 0u)
        return -1;
    uint level = 0x80000000u >> clz(at->open);
    at->open ^= level;
    at->done = (at->done & (level - 1u)) | level;
    if (at->held == 0u) {
        at->level = 1u;
        return 0;
    }
    int node = at->s0;
    at->level = level << 1;
    at->s0 = at->s1; at->s1 = at->s2; at->s2 = at->s3;
    --at->held;
    return node;
}

#define PLACE_IN_TREE    PlaceInTree place = { 1u, 0u, 0u, 0, 0, 0, 0, 0u };
#define DOWN(near, far)  { node = down_from(&place, near, far); continue; }
#define BACK             { node = back_from(&place); if (node < 0) break; }
#else
#define PLACE_IN_TREE    int todo[PRIMITIVE_STACK]; int depth = 0;
#define DOWN(near, far)  { todo[depth++] = far; node = near; continue; }
#define BACK             { if (depth == 0) break; node = todo[--depth]; }
#endif

// Calls VISIT(index, t) for the primitives of every leaf that a lane of `on` enters before its `limit`; VISIT may lower
// both.
#define EACH_IN_TREE(ray, on, limit, VISIT)                                                 \
    {                                                                                       \
        PLACE_IN_TREE                                                                       \
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
                    DOWN(first + (far_side ^ 1), first + far_side)                          \
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
            BACK                                                                            \
        }                                                                                   \
    }

#endif
