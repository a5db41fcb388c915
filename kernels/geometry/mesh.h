// Rays of a pack against the meshes of the scene. A step of one ray in a tree over triangles takes whole vectors, so that
// each ray has a walk of its own; the walks of a pack are taken one by one or side by side.
// Without HAS_INSTANCES all triangles stand in the world and in one tree. With it the tree at mesh_root holds instances
// (leaf ~index), each with a tree of its own in the frame of its mesh.
#ifndef MESH_H
#define MESH_H
#include "common/scene.h"
#include "geometry/bvh.h"
#include "geometry/hit.h"
#include "geometry/movement.h"
#if HAS_HIDDEN
#include "geometry/hidden.h"
#endif
#if HAS_OPACITY
#include "material/opacity.h"
#endif

#if VW == 1
#define LANE_OF(T, v, k)        (v)
#define SET_LANE(T, v, k, x)    ((v) = (x))
#define LANE_BITS(m)            ((m) ? 1u : 0u)
#else
#define LANE_OF(T, v, k)        (((const T *)&(v))[k])
#define SET_LANE(T, v, k, x)    (((T *)&(v))[k] = (x))
#define LANE_BITS(m)            MASK_BITS(m)
#endif

typedef struct {
    float3 o, d;
    int    origin, triangle;      // primitive and triangle that do not count
#if HAS_MOTION
    float  time;
#endif
} OneRay;

IN_PLACE static OneRay one_ray(const Ray *ray, uint k)
{
    OneRay r;
    r.o = (float3)(LANE_OF(float, ray->o.x, k), LANE_OF(float, ray->o.y, k), LANE_OF(float, ray->o.z, k));
    r.d = (float3)(LANE_OF(float, ray->d.x, k), LANE_OF(float, ray->d.y, k), LANE_OF(float, ray->d.z, k));
    r.origin = LANE_OF(int, ray->origin, k);
    r.triangle = LANE_OF(int, ray->triangle, k);
#if HAS_MOTION
    r.time = LANE_OF(float, ray->time, k);
#endif
    return r;
}

#if HAS_OPACITY
// Whether a triangle has no hole where a ray meets it.
static int is_solid(OneRay ray, int triangle, float b1, float b2, int first_primitive, Scene scene)
{
    int4 corners = scene.triangles[triangle];
    int primitive = first_primitive + corners.w;
    const __global Material *material = scene.materials + scene.primitives[primitive].material;
    if (!has_holes(material))
        return 1;
    float2 a = vload2(0, scene.vertices + (size_t)corners.x * 8 + 6);
    float2 b = vload2(0, scene.vertices + (size_t)corners.y * 8 + 6);
    float2 c = vload2(0, scene.vertices + (size_t)corners.z * 8 + 6);
    float2 uv = (1.0f - b1 - b2) * a + b1 * b + b2 * c;
    F chance = ray_chance(f3((F)(ray.o.x), (F)(ray.o.y), (F)(ray.o.z)), f3((F)(ray.d.x), (F)(ray.d.y), (F)(ray.d.z)),
                          (I)(primitive), (I)(triangle));
    I solid = is_there(material, (F)(uv.x), (F)(uv.y), chance, scene);
    return LANE_BITS(solid) & 1u;
}
#endif

// Lowers `hit` to the nearest triangle of a block but `origin`; whether there is one.
IN_PLACE static int hit_block(int index, BoxRay r, int origin, OneRay ray, int first_primitive, Scene scene,
                              TriangleHit *hit)
{
    const __global float *block = scene.blocks + (size_t)index * BLOCK_FLOATS;
    const __global int *triangles = (const __global int *)(block + 9 * LEAF_WIDTH);
    Block t, b1, b2;
    int found = 0;
    for (uint bits = hit_triangles(block, r, hit->t, &t, &b1, &b2); bits != 0u; bits &= bits - 1u) {
        uint k = LOWEST_BIT(bits);
        float tk = ((const float *)&t)[k];
        if (tk < hit->t && triangles[k] != origin) {
#if HAS_HIDDEN
            if (is_hidden(triangles[k], KIND_OF_RAY(int, ray.origin), first_primitive, scene))
                continue;
#endif
#if HAS_OPACITY
            if (!is_solid(ray, triangles[k], ((const float *)&b1)[k], ((const float *)&b2)[k], first_primitive, scene))
                continue;
#endif
            hit->t = tk;
            hit->b1 = ((const float *)&b1)[k];
            hit->b2 = ((const float *)&b2)[k];
            hit->triangle = triangles[k];
            found = 1;
        }
    }
    return found;
}

// Whether a block holds a triangle before `reach` other than `origin` and `target`.
IN_PLACE static int block_blocks(int index, BoxRay r, int origin, int target, float reach, OneRay ray, int first_primitive,
                                 Scene scene)
{
    const __global float *block = scene.blocks + (size_t)index * BLOCK_FLOATS;
    const __global int *triangles = (const __global int *)(block + 9 * LEAF_WIDTH);
    Block t, b1, b2;
    for (uint bits = hit_triangles(block, r, reach, &t, &b1, &b2); bits != 0u; bits &= bits - 1u) {
        uint k = LOWEST_BIT(bits);
        if (triangles[k] == origin || triangles[k] == target)
            continue;
#if HAS_HIDDEN
        if (is_hidden(triangles[k], KIND_OF_SHADOW, first_primitive, scene))
            continue;
#endif
#if HAS_OPACITY
        if (!is_solid(ray, triangles[k], ((const float *)&b1)[k], ((const float *)&b2)[k], first_primitive, scene))
            continue;
#endif
        return 1;
    }
    return 0;
}

static inline BoxRay in_world(OneRay r) { return box_ray(r.o.x, r.o.y, r.o.z, r.d.x, r.d.y, r.d.z); }

#if VW > 1
IN_PLACE static BoxRay box_ray_of(const BoxRays *all, uint k)
{
    BoxRay r;
    r.ox = LANE_OF(float, all->ox, k); r.oy = LANE_OF(float, all->oy, k); r.oz = LANE_OF(float, all->oz, k);
    r.ix = LANE_OF(float, all->ix, k); r.iy = LANE_OF(float, all->iy, k); r.iz = LANE_OF(float, all->iz, k);
    r.near_x = LANE_OF(uint, all->near_x, k); r.far_x = LANE_OF(uint, all->far_x, k);
    r.near_y = LANE_OF(uint, all->near_y, k); r.far_y = LANE_OF(uint, all->far_y, k);
    r.near_z = LANE_OF(uint, all->near_z, k); r.far_z = LANE_OF(uint, all->far_z, k);
    r.row_x = LANE_OF(uint, all->row_x, k); r.row_y = LANE_OF(uint, all->row_y, k); r.row_z = LANE_OF(uint, all->row_z, k);
    r.px = LANE_OF(float, all->px, k); r.py = LANE_OF(float, all->py, k); r.pz = LANE_OF(float, all->pz, k);
    r.sx = LANE_OF(float, all->sx, k); r.sy = LANE_OF(float, all->sy, k); r.sz = LANE_OF(float, all->sz, k);
    return r;
}
#define BOX_RAYS(o, d)          BoxRays box = box_rays(o, d)
#define BOX_RAY_OF(ray, k)      box_ray_of(&box, k)
#else
#define BOX_RAYS(o, d)
#define BOX_RAY_OF(ray, k)      in_world(ray)
#endif

#if HAS_MOTION
static OneRay one_at_rest(OneRay r, int primitive, Scene scene)
{
    if (moves(primitive, scene)) {
        Ray ray;
        ray.o = f3((F)(r.o.x), (F)(r.o.y), (F)(r.o.z));
        ray.d = f3((F)(r.d.x), (F)(r.d.y), (F)(r.d.z));
        ray.time = (F)(r.time);
        ray = ray_at_rest(ray, primitive, scene);
        r.o = (float3)(LANE_OF(float, ray.o.x, 0), LANE_OF(float, ray.o.y, 0), LANE_OF(float, ray.o.z, 0));
        r.d = (float3)(LANE_OF(float, ray.d.x, 0), LANE_OF(float, ray.d.y, 0), LANE_OF(float, ray.d.z, 0));
    }
    return r;
}
#endif

#if HAS_INSTANCES
static inline OneRay ray_in_mesh(const __global Instance *instance, OneRay r, Scene scene)
{
#if HAS_MOTION
    r = one_at_rest(r, instance->first_primitive, scene);
#endif
    float4 x = instance->row_x, y = instance->row_y, z = instance->row_z;
    OneRay in = r;
    in.o = (float3)(x.x * r.o.x + x.y * r.o.y + x.z * r.o.z + x.w, y.x * r.o.x + y.y * r.o.y + y.z * r.o.z + y.w,
                    z.x * r.o.x + z.y * r.o.y + z.z * r.o.z + z.w);
    in.d = (float3)(x.x * r.d.x + x.y * r.d.y + x.z * r.d.z, y.x * r.d.x + y.y * r.d.y + y.z * r.d.z,
                    z.x * r.d.x + z.y * r.d.y + z.z * r.d.z);
    return in;
}

static inline BoxRay in_mesh(const __global Instance *instance, OneRay r, Scene scene)
{
    return in_world(ray_in_mesh(instance, r, scene));
}

// The triangle of an instance that does not count for a ray.
static inline int origin_within(const __global Instance *instance, int origin, int triangle)
{
    int slot = origin - instance->first_primitive;
    return slot >= 0 && slot < instance->primitives ? triangle : NO_TRIANGLE;
}
#endif

#if SIDE_BY_SIDE
#include "geometry/mesh_side_by_side.h"
#elif SHORT_STACK
#include "geometry/mesh_by_short_stack.h"
#else
#include "geometry/mesh_one_by_one.h"
#endif

// Lanes of `on` whose ray meets the box round all meshes before `reach`, as hit_boxes tests it.
static I meets_bounds(Ray ray, F reach, I on, Scene scene)
{
    float4 low = scene.mesh_low, high = scene.mesh_high;
    F ix = inverse_of_lanes(ray.d.x), iy = inverse_of_lanes(ray.d.y), iz = inverse_of_lanes(ray.d.z);
    I back_x = ray.d.x < 0.0f, back_y = ray.d.y < 0.0f, back_z = ray.d.z < 0.0f;
    F x = ((back_x ? (F)(high.x) : (F)(low.x)) - ray.o.x) * ix;
    F y = ((back_y ? (F)(high.y) : (F)(low.y)) - ray.o.y) * iy;
    F z = ((back_z ? (F)(high.z) : (F)(low.z)) - ray.o.z) * iz;
    F X = ((back_x ? (F)(low.x) : (F)(high.x)) - ray.o.x) * ix;
    F Y = ((back_y ? (F)(low.y) : (F)(high.y)) - ray.o.y) * iy;
    F Z = ((back_z ? (F)(low.z) : (F)(high.z)) - ray.o.z) * iz;
    F first = x > y ? x : y;
    first = first > z ? first : z;
    first = first > 0.0f ? first : ZERO;
    F last = X < Y ? X : Y;
    last = last < Z ? last : Z;
    last = last * FAR_PAD;
    last = last < reach ? last : reach;
    return on & (first <= last);
}

// Lowers the hits of the lanes `on` to the nearest triangles.
static inline void nearest_in_meshes(Ray ray, I on, Scene scene, Hit *hit)
{
    I lowered = nearest_of_lanes(ray, meets_bounds(ray, hit->t, on, scene), scene, hit);
    // Which primitive of its instance a triangle is of: far apart in memory, so all lanes wait for theirs together.
    if (ANY(lowered))
        hit->primitive += lowered ? GATHER(I, scene.triangles, lowered ? hit->triangle : FALSE, .w) : FALSE;
}

// Lanes of `on` whose ray meets a triangle before `reach`. `target_triangle` of the primitive `target` does not count.
static inline I blocked_by_meshes(Ray ray, F reach, I target, I target_triangle, I on, Scene scene)
{
    return blocked_of_lanes(ray, reach, target, target_triangle, meets_bounds(ray, reach, on, scene), scene);
}

#endif
