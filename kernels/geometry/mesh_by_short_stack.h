// The walk of one ray through the trees of meshes, where a work item has one and memory of its own is dear.
#ifndef MESH_BY_SHORT_STACK_H
#define MESH_BY_SHORT_STACK_H
#include "geometry/short_stack.h"

// Lowers `hit` to the nearest triangle of a block but `origin`, or with `is_shadow` to any but `other`, too; whether there
// is one. `in` is the ray in the frame of the mesh. Two triangles at a time: more at once take more registers.
static int meets_block(const __global float *block, OneRay in, int is_shadow, int origin, int other, OneRay ray,
                       int first_primitive, Scene scene, TriangleHit *hit)
{
#pragma OPENCL FP_CONTRACT OFF
    BoxRay r = in_world(in);
    const __global int *triangles = (const __global int *)(block + 9 * LEAF_WIDTH);
    int found = 0;
#pragma unroll 1
    for (uint pair = 0u; pair < LEAF_WIDTH; pair += 2u) {
        const __global float2 *x = (const __global float2 *)(block + r.row_x + pair);
        const __global float2 *y = (const __global float2 *)(block + r.row_y + pair);
        const __global float2 *z = (const __global float2 *)(block + r.row_z + pair);
        float2 az = z[0] - r.pz;
        float2 bz = z[3 * LEAF_WIDTH / 2] - r.pz;
        float2 cz = z[6 * LEAF_WIDTH / 2] - r.pz;
        float2 ax = x[0] - r.px - r.sx * az;
        float2 ay = y[0] - r.py - r.sy * az;
        float2 bx = x[3 * LEAF_WIDTH / 2] - r.px - r.sx * bz;
        float2 by = y[3 * LEAF_WIDTH / 2] - r.py - r.sy * bz;
        float2 cx = x[6 * LEAF_WIDTH / 2] - r.px - r.sx * cz;
        float2 cy = y[6 * LEAF_WIDTH / 2] - r.py - r.sy * cz;
        float2 u = cx * by - cy * bx;
        float2 v = ax * cy - ay * cx;
        float2 w = bx * ay - by * ax;
        int2 inside = ((u >= 0.0f) & (v >= 0.0f) & (w >= 0.0f)) | ((u <= 0.0f) & (v <= 0.0f) & (w <= 0.0f));
        float2 det = u + v + w;
        float2 inverse = 1.0f / det;
        float2 t = (u * az + v * bz + w * cz) * r.sz * inverse;
        int2 met = inside & (det != 0.0f) & (t > 0.0f);
        for (uint k = 0u; k < 2u; ++k) {
            float tk = k == 0u ? t.x : t.y, bk = k == 0u ? v.x : v.y, ck = k == 0u ? w.x : w.y;
            float scale_of_weights = k == 0u ? inverse.x : inverse.y;
            int triangle = triangles[pair + k];
            if (!(k == 0u ? met.x : met.y) || !(tk < hit->t) || triangle == origin || (is_shadow && triangle == other))
                continue;
            float b1 = bk * scale_of_weights, b2 = ck * scale_of_weights;
#if HAS_HIDDEN
            if (is_hidden(triangle, is_shadow ? KIND_OF_SHADOW : KIND_OF_RAY(int, ray.origin), first_primitive, scene))
                continue;
#endif
#if HAS_OPACITY
            if (!is_solid(ray, triangle, b1, b2, first_primitive, scene))
                continue;
#endif
            hit->t = tk;
            hit->b1 = b1;
            hit->b2 = b2;
            hit->triangle = triangle;
            found = 1;
            if (is_shadow)
                return 1;
        }
    }
    return found;
}

static inline float3 inverse_direction(OneRay r)
{
    return (float3)(inverse_of(r.d.x), inverse_of(r.d.y), inverse_of(r.d.z));
}

// The nearest triangle before hit->t, or any with `is_shadow`, which is not that of `target` either; its instance is
// returned, -1 where there is none.
static int walk_meshes(OneRay ray, int is_shadow, int target, int target_triangle, Scene scene, TriangleHit *hit)
{
    Walk w = walk_from(scene.mesh_root);
    OneRay in = ray;            // in the frame of the tree that is being walked
    float3 i = inverse_direction(ray);
    int found = -1, origin = ray.triangle, other = target_triangle;
#if HAS_INSTANCES
    int within = -1;            // instance whose tree is being walked
    uint floor_of = 0u;         // level of its root
#else
    const int within = 0;
#endif
    for (;;) {
        if (w.node >= 0) {
            if (goes_down(&w, (const __global float4 *)scene.nodes + (size_t)w.node * 7, in.o, i, hit->t))
                continue;
        }
#if HAS_INSTANCES
        else if (within < 0) {
            within = ~w.node;
            const __global Instance *instance = scene.instances + within;
            floor_of = w.level;
            w.node = instance->root;
            origin = origin_within(instance, ray.origin, ray.triangle);
            other = origin_within(instance, target, target_triangle);
            in = ray_in_mesh(instance, ray, scene);
            i = inverse_direction(in);
            continue;
        }
#endif
        else if (meets_block(scene.blocks + (size_t)~w.node * BLOCK_FLOATS, in, is_shadow, origin, other, ray,
                             scene.instances[within].first_primitive, scene, hit)) {
            found = within;
            if (is_shadow)
                return found;
        }
        if (!goes_on(&w, scene.mesh_root))
            return found;
#if HAS_INSTANCES
        if (within >= 0 && w.level <= floor_of) {
            within = -1;
            in = ray;
            i = inverse_direction(ray);
        }
#endif
    }
}

// Lowers the hit of a ray; whether it was lowered. Its primitive is then the first of the instance.
static I nearest_of_lanes(Ray ray, I on, Scene scene, Hit *hit)
{
    if (!on)
        return FALSE;
    TriangleHit best = { hit->t, 0.0f, 0.0f, NO_TRIANGLE };
    int instance = walk_meshes(one_ray(&ray, 0u), 0, NO_PRIMITIVE, NO_TRIANGLE, scene, &best);
    if (best.triangle < 0)
        return FALSE;
    hit->t = best.t;
    hit->primitive = scene.instances[instance].first_primitive;
    hit->triangle = best.triangle;
    hit->b1 = best.b1;
    hit->b2 = best.b2;
    return TRUE;
}

// Whether a ray meets a triangle before `reach`.
static I blocked_of_lanes(Ray ray, F reach, I target, I target_triangle, I on, Scene scene)
{
    if (!on)
        return FALSE;
    TriangleHit before = { reach, 0.0f, 0.0f, NO_TRIANGLE };
    return walk_meshes(one_ray(&ray, 0u), 1, target, target_triangle, scene, &before) >= 0;
}

#endif
