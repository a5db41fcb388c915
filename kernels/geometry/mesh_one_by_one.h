// The walks of a pack's rays through the trees of meshes, one after the other.
#ifndef MESH_ONE_BY_ONE_H
#define MESH_ONE_BY_ONE_H

// The nearest triangle before hit->t; its instance is returned. `r` is the ray made ready.
static int nearest_triangle(OneRay ray, BoxRay r, Scene scene, TriangleHit *hit)
{
    int   todo[BVH_STACK];
    float enter[BVH_STACK];
    int depth = 0;
    int node = scene.mesh_root;
    int found = 0;
    int origin = ray.triangle;
#if HAS_INSTANCES
    BoxRay outside = r;
    int within = -1;            // instance whose tree is being walked
    int floor_of = 0;           // depth of the stack below it
#endif
    for (;;) {
        if (node >= 0) {
            const __global float *n = scene.nodes + (size_t)node * NODE_FLOATS;
            const __global int *child = (const __global int *)(n + 6 * BVH_WIDTH);
            Row first;
            uint bits = hit_boxes(n, r, hit->t, &first);
            if (bits != 0u) {
                // The nearest child is next, the others wait in order of distance.
                const float *t = (const float *)&first;
                uint k = LOWEST_BIT(bits);
                bits &= bits - 1u;
                node = child[k];
                if (bits == 0u)
                    continue;
                float nearest = t[k];
                int base = depth;
                while (bits != 0u) {
                    k = LOWEST_BIT(bits);
                    bits &= bits - 1u;
                    float tk = t[k];
                    int ck = child[k];
                    if (tk < nearest) {
                        float further = nearest; nearest = tk; tk = further;
                        int other = node; node = ck; ck = other;
                    }
                    int place = depth;
                    while (place > base && enter[place - 1] < tk) {
                        enter[place] = enter[place - 1];
                        todo[place] = todo[place - 1];
                        --place;
                    }
                    enter[place] = tk;
                    todo[place] = ck;
                    ++depth;
                }
                continue;
            }
        }
#if HAS_INSTANCES
        else if (within < 0) {
            within = ~node;
            const __global Instance *instance = scene.instances + within;
            floor_of = depth;
            node = instance->root;
            origin = origin_within(instance, ray.origin, ray.triangle);
            r = in_mesh(instance, ray, scene);
            continue;
        } else if (hit_block(~node, r, origin, ray, scene.instances[within].first_primitive, scene, hit))
            found = within;
#else
        else
            hit_block(~node, r, origin, ray, scene.instances->first_primitive, scene, hit);
#endif
        do {
#if HAS_INSTANCES
            if (within >= 0 && depth == floor_of) {
                within = -1;
                r = outside;
            }
#endif
            if (depth == 0)
                return found;
            --depth;
        } while (enter[depth] >= hit->t);
        node = todo[depth];
    }
}

// Whether a ray meets a triangle before `reach`. `target_triangle` of the primitive `target` does not count either.
static int meets_triangle(OneRay ray, BoxRay r, float reach, int target, int target_triangle, Scene scene)
{
    int todo[BVH_STACK];
    int depth = 0;
    int node = scene.mesh_root;
    int origin = ray.triangle;
    int other = target_triangle;
#if HAS_INSTANCES
    BoxRay outside = r;
    int within = -1;
    int floor_of = 0;
#else
    const int within = 0;
#endif
    for (;;) {
        if (node >= 0) {
            const __global float *n = scene.nodes + (size_t)node * NODE_FLOATS;
            const __global int *child = (const __global int *)(n + 6 * BVH_WIDTH);
            Row first;
            uint bits = hit_boxes(n, r, reach, &first);
            while (bits != 0u) {
                uint k = LOWEST_BIT(bits);
                bits &= bits - 1u;
                todo[depth++] = child[k];
            }
        }
#if HAS_INSTANCES
        else if (within < 0) {
            within = ~node;
            const __global Instance *instance = scene.instances + within;
            floor_of = depth;
            node = instance->root;
            origin = origin_within(instance, ray.origin, ray.triangle);
            other = origin_within(instance, target, target_triangle);
            r = in_mesh(instance, ray, scene);
            continue;
        }
#endif
        else if (block_blocks(~node, r, origin, other, reach, ray, scene.instances[within].first_primitive, scene))
            return 1;
#if HAS_INSTANCES
        if (within >= 0 && depth == floor_of) {
            within = -1;
            r = outside;
        }
#endif
        if (depth == 0)
            return 0;
        node = todo[--depth];
    }
}

// Lowers the hits of the lanes `on`; which were lowered. Their primitive is then the first of the instance.
static I nearest_of_lanes(Ray ray, I on, Scene scene, Hit *hit)
{
    I lowered = FALSE;
    BOX_RAYS(ray.o, ray.d);
    for (uint rest = LANE_BITS(on); rest != 0u; rest &= rest - 1u) {
        uint k = LOWEST_BIT(rest);
        TriangleHit best;
        best.t = LANE_OF(float, hit->t, k);
        best.triangle = NO_TRIANGLE;
        best.b1 = 0.0f;
        best.b2 = 0.0f;
        OneRay one = one_ray(&ray, k);
        int instance = nearest_triangle(one, BOX_RAY_OF(one, k), scene, &best);
        if (best.triangle >= 0) {
            SET_LANE(float, hit->t, k, best.t);
            SET_LANE(int, hit->primitive, k, scene.instances[instance].first_primitive);
            SET_LANE(int, hit->triangle, k, best.triangle);
            SET_LANE(float, hit->b1, k, best.b1);
            SET_LANE(float, hit->b2, k, best.b2);
            SET_LANE(int, lowered, k, -1);
        }
    }
    return lowered;
}

// Lanes of `on` whose ray meets a triangle before `reach`.
static I blocked_of_lanes(Ray ray, F reach, I target, I target_triangle, I on, Scene scene)
{
    I blocked = FALSE;
    BOX_RAYS(ray.o, ray.d);
    for (uint rest = LANE_BITS(on); rest != 0u; rest &= rest - 1u) {
        uint k = LOWEST_BIT(rest);
        OneRay one = one_ray(&ray, k);
        if (meets_triangle(one, BOX_RAY_OF(one, k), LANE_OF(float, reach, k), LANE_OF(int, target, k),
                           LANE_OF(int, target_triangle, k), scene))
            SET_LANE(int, blocked, k, -1);
    }
    return blocked;
}

#endif
