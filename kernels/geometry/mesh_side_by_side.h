// The walks of a pack's rays through the trees of meshes, side by side: each takes a step in turn. No step waits for one of
// another ray and hardly a branch depends on a ray, so that the processor works at several steps at once; alone, a walk
// mostly waits for memory, for one comparison after the other, and for branches that were foreseen wrongly.
#ifndef MESH_SIDE_BY_SIDE_H
#define MESH_SIDE_BY_SIDE_H

#define AT_END      0x7fffffff          // what lies below all entries of a stack
#define AT_EXIT     0x7ffffffe          // below those of the tree of an instance
#define SLOT        15                  // bits of a distance that give way to a child's place among its siblings
#define FIRST_KEY   (-1)                // before any distance
#define ROOM        (BVH_STACK + 2 + BVH_WIDTH)     // of a stack: both ends, and what a store writes beyond its entries
typedef int4  __attribute__((aligned(4))) FourEntries;
typedef int16 __attribute__((aligned(4))) SixteenEntries;

// Bits of a lane that is at a node, or at a leaf.
IN_PLACE static uint at_node_bit(int node, uint k) { return (uint)((uint)node < (uint)AT_EXIT) << k; }
IN_PLACE static uint at_leaf_bit(int node, uint k) { return ((uint)node >> 31) << k; }

// Pushes the children `bits` onto a stack, the nearest last; how many entries it then has. A key is a distance, whose bits
// are in the order of integers, with the child's slot in its last bits.
IN_PLACE static uint push_sorted(int *keys, int *todo, uint depth, uint bits, Row enter, const __global int *children)
{
    uint count = (uint)popcount(bits);
    int16 packed = (as_int16(enter) & ~SLOT) | LANES;
    packed = __builtin_ia32_compresssi512_mask(packed, (int16)(FIRST_KEY), (ushort)bits);
    int16 child = as_int16(LOAD_ROW((const __global float *)children));
    if (count > 4u) {       // which is rare: all but four stay unsorted
        int16 rest = packed.s456789abcdefffff;
        *(SixteenEntries *)(keys + depth) = rest;
        rest = __builtin_ia32_permvarsi512(child, rest);
        *(SixteenEntries *)(todo + depth) = rest;
        depth += count - 4u;
        count = 4u;
    }
    // A network of five comparisons sorts four keys, the greatest first.
    int4 a = packed.lo.lo;
    int4 high = max(a, a.zwxy), low = min(a, a.zwxy);
    a = (int4)(high.xy, low.zw);
    high = max(a, a.yxwz); low = min(a, a.yxwz);
    a = (int4)(high.x, low.y, high.z, low.w);
    high = max(a, a.xzyw); low = min(a, a.xzyw);
    a = (int4)(a.x, high.y, low.z, a.w);
    int16 slots = __builtin_shufflevector(a, a, 0, 1, 2, 3, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1);
    child = __builtin_ia32_permvarsi512(child, slots);       // by the last four bits of a key
    *(FourEntries *)(keys + depth) = a;
    *(FourEntries *)(todo + depth) = child.lo.lo;
    return depth + count;
}

// Takes the last entry that lies before `reach` off a stack.
IN_PLACE static int take(const int *keys, const int *todo, uint *depth, float reach)
{
    uint d = *depth - 1u;
    while (keys[d] > (as_int(reach) | SLOT))
        --d;
    *depth = d;
    return todo[d];
}

#if HAS_INSTANCES
// Makes `r` the ray of lane k.
IN_PLACE static void put_box_ray(BoxRays *all, uint k, BoxRay r)
{
    SET_LANE(float, all->ox, k, r.ox); SET_LANE(float, all->oy, k, r.oy); SET_LANE(float, all->oz, k, r.oz);
    SET_LANE(float, all->ix, k, r.ix); SET_LANE(float, all->iy, k, r.iy); SET_LANE(float, all->iz, k, r.iz);
    SET_LANE(uint, all->near_x, k, r.near_x); SET_LANE(uint, all->far_x, k, r.far_x);
    SET_LANE(uint, all->near_y, k, r.near_y); SET_LANE(uint, all->far_y, k, r.far_y);
    SET_LANE(uint, all->near_z, k, r.near_z); SET_LANE(uint, all->far_z, k, r.far_z);
    SET_LANE(uint, all->row_x, k, r.row_x); SET_LANE(uint, all->row_y, k, r.row_y); SET_LANE(uint, all->row_z, k, r.row_z);
    SET_LANE(float, all->px, k, r.px); SET_LANE(float, all->py, k, r.py); SET_LANE(float, all->pz, k, r.pz);
    SET_LANE(float, all->sx, k, r.sx); SET_LANE(float, all->sy, k, r.sy); SET_LANE(float, all->sz, k, r.sz);
}

// The instances whose trees the lanes are in, -1 outside, and the rays there.
#define INSTANCES_START    BoxRays outside = box; int within[VW]; for (uint k = 0u; k < VW; ++k) within[k] = -1
#define INSTANCE_OF(k)     (scene.instances + within[k])
#define ENTER_INSTANCE(k, one)                                                                                         \
    within[k] = ~node[k];                                                                                              \
    node[k] = INSTANCE_OF(k)->root;                                                                                    \
    put_box_ray(&box, k, in_mesh(INSTANCE_OF(k), one, scene))
#define LEAVE_INSTANCE(k)                                                                                              \
    within[k] = -1;                                                                                                    \
    put_box_ray(&box, k, box_ray_of(&outside, k))
#else
#define INSTANCES_START
#define INSTANCE_OF(k)     (scene.instances)
#endif

// Lowers the hits of the lanes `on`; which were lowered. Their primitive is then the first of the instance.
static I nearest_of_lanes(Ray ray, I on, Scene scene, Hit *hit)
{
    BOX_RAYS(ray.o, ray.d);
    INSTANCES_START;
    Hit best = *hit;
    I lowered = FALSE;
    int keys[VW][ROOM], todo[VW][ROOM];
    uint depth[VW];
    int node[VW];
    for (uint k = 0u; k < VW; ++k) {
        keys[k][0] = FIRST_KEY;
        todo[k][0] = AT_END;
        depth[k] = 1u;
        node[k] = scene.mesh_root;
    }
    uint at_node = LANE_BITS(on), at_leaf = 0u;
    while ((at_node | at_leaf) != 0u) {
        uint still = 0u;
        for (uint rest = at_node; rest != 0u; rest &= rest - 1u) {
            uint k = LOWEST_BIT(rest);
            const __global float *n = scene.nodes + (size_t)node[k] * NODE_FLOATS;
            float reach = LANE_OF(float, best.t, k);
            Row enter;
            uint bits = hit_boxes(n, box_ray_of(&box, k), reach, &enter);
            depth[k] = push_sorted(keys[k], todo[k], depth[k], bits, enter, (const __global int *)(n + 6 * BVH_WIDTH));
            int next = take(keys[k], todo[k], depth + k, reach);
#if HAS_INSTANCES
            if (next == AT_EXIT) {
                LEAVE_INSTANCE(k);
                next = take(keys[k], todo[k], depth + k, reach);
            }
#endif
            node[k] = next;
            still |= at_node_bit(next, k);
            at_leaf |= at_leaf_bit(next, k);
        }
        at_node = still;
        if (popcount(at_node) > popcount(at_leaf))
            continue;
        still = 0u;
        for (uint rest = at_leaf; rest != 0u; rest &= rest - 1u) {
            uint k = LOWEST_BIT(rest);
            OneRay one = one_ray(&ray, k);
            int origin = one.triangle;
#if HAS_INSTANCES
            if (within[k] < 0) {
                ENTER_INSTANCE(k, one);
                keys[k][depth[k]] = FIRST_KEY;
                todo[k][depth[k]++] = AT_EXIT;
                at_node |= 1u << k;
                continue;
            }
            origin = origin_within(INSTANCE_OF(k), one.origin, origin);
#endif
            TriangleHit found;
            found.t = LANE_OF(float, best.t, k);
            int first = INSTANCE_OF(k)->first_primitive;
            if (hit_block(~node[k], box_ray_of(&box, k), origin, one, first, scene, &found)) {
                SET_LANE(float, best.t, k, found.t);
                SET_LANE(float, best.b1, k, found.b1);
                SET_LANE(float, best.b2, k, found.b2);
                SET_LANE(int, best.triangle, k, found.triangle);
                SET_LANE(int, best.primitive, k, first);
                SET_LANE(int, lowered, k, -1);
            }
            int next = take(keys[k], todo[k], depth + k, found.t);
#if HAS_INSTANCES
            if (next == AT_EXIT) {
                LEAVE_INSTANCE(k);
                next = take(keys[k], todo[k], depth + k, found.t);
            }
#endif
            node[k] = next;
            at_node |= at_node_bit(next, k);
            still |= at_leaf_bit(next, k);
        }
        at_leaf = still;
    }
    *hit = best;
    return lowered;
}

// Lanes of `on` whose ray meets a triangle before `reach`.
static I blocked_of_lanes(Ray ray, F reach, I target, I target_triangle, I on, Scene scene)
{
    BOX_RAYS(ray.o, ray.d);
    INSTANCES_START;
    I blocked = FALSE;
    int todo[VW][ROOM];
    uint depth[VW];
    int node[VW];
    for (uint k = 0u; k < VW; ++k) {
        todo[k][0] = AT_END;
        depth[k] = 1u;
        node[k] = scene.mesh_root;
    }
    uint at_node = LANE_BITS(on), at_leaf = 0u;
    while ((at_node | at_leaf) != 0u) {
        uint still = 0u;
        for (uint rest = at_node; rest != 0u; rest &= rest - 1u) {
            uint k = LOWEST_BIT(rest);
            const __global float *n = scene.nodes + (size_t)node[k] * NODE_FLOATS;
            Row enter;
            uint bits = hit_boxes(n, box_ray_of(&box, k), LANE_OF(float, reach, k), &enter);
            int16 child = as_int16(LOAD_ROW(n + 6 * BVH_WIDTH));
            *(SixteenEntries *)(todo[k] + depth[k]) = __builtin_ia32_compresssi512_mask(child, child, (ushort)bits);
            uint d = depth[k] + (uint)popcount(bits) - 1u;
            int next = todo[k][d];
#if HAS_INSTANCES
            if (next == AT_EXIT) {
                LEAVE_INSTANCE(k);
                next = todo[k][--d];
            }
#endif
            depth[k] = d;
            node[k] = next;
            still |= at_node_bit(next, k);
            at_leaf |= at_leaf_bit(next, k);
        }
        at_node = still;
        if (popcount(at_node) > popcount(at_leaf))
            continue;
        still = 0u;
        for (uint rest = at_leaf; rest != 0u; rest &= rest - 1u) {
            uint k = LOWEST_BIT(rest);
            OneRay one = one_ray(&ray, k);
            int origin = one.triangle, other = LANE_OF(int, target_triangle, k);
#if HAS_INSTANCES
            if (within[k] < 0) {
                ENTER_INSTANCE(k, one);
                todo[k][depth[k]++] = AT_EXIT;
                at_node |= 1u << k;
                continue;
            }
            origin = origin_within(INSTANCE_OF(k), one.origin, origin);
            other = origin_within(INSTANCE_OF(k), LANE_OF(int, target, k), other);
#endif
            uint d = depth[k] - 1u;
            int next = todo[k][d];
            if (block_blocks(~node[k], box_ray_of(&box, k), origin, other, LANE_OF(float, reach, k), one,
                             INSTANCE_OF(k)->first_primitive, scene)) {
                SET_LANE(int, blocked, k, -1);
                next = AT_END;
            }
#if HAS_INSTANCES
            if (next == AT_EXIT) {
                LEAVE_INSTANCE(k);
                next = todo[k][--d];
            }
#endif
            depth[k] = d;
            node[k] = next;
            at_node |= at_node_bit(next, k);
            still |= at_leaf_bit(next, k);
        }
        at_leaf = still;
    }
    return blocked;
}

#endif
