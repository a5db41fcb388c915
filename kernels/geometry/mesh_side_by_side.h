// The walks of a pack's rays through the trees of meshes, side by side: each takes a step in turn. No step waits for one of
// another ray and hardly a branch depends on a ray, so that the processor works at several steps at once; alone, a walk
// mostly waits for memory, for one comparison after the other, and for branches that were foreseen wrongly.
#ifndef MESH_SIDE_BY_SIDE_H
#define MESH_SIDE_BY_SIDE_H

#define AT_END      0x7fffffff          // what lies below all entries of a stack
#define AT_EXIT     0x7ffffffe          // below those of the tree of an instance
#define SLOT        15                  // bits of a distance that give way to a child's place among its siblings
#define FIRST_KEY   (-1)                // before any distance
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
    if (count > 4u) {
        for (uint i = 0u; i < count; ++i) {
            int key = ((const int *)&packed)[i];
            uint place = depth + i;
            for (; place > depth && keys[place - 1u] < key; --place) {
                keys[place] = keys[place - 1u];
                todo[place] = todo[place - 1u];
            }
            keys[place] = key;
            todo[place] = children[key & SLOT];
        }
        return depth + count;
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
    int16 child = as_int16(LOAD_ROW((const __global float *)children));
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

// Lowers the hits of the lanes `on`; which were lowered. Their primitive is then the first of the instance.
static I nearest_of_lanes(Ray ray, I on, Scene scene, Hit *hit)
{
    BOX_RAYS(ray.o, ray.d);
    Hit best = *hit;
    I lowered = FALSE;
    int keys[VW][BVH_STACK + 5], todo[VW][BVH_STACK + 5];
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
            OneRay one = one_ray(&ray, k);
            const __global float *n = scene.nodes + (size_t)node[k] * NODE_FLOATS;
            float reach = LANE_OF(float, best.t, k);
            Row enter;
            uint bits = hit_boxes(n, BOX_RAY_OF(one, k), reach, &enter);
            depth[k] = push_sorted(keys[k], todo[k], depth[k], bits, enter, (const __global int *)(n + 6 * BVH_WIDTH));
            int next = take(keys[k], todo[k], depth + k, reach);
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
            TriangleHit found;
            found.t = LANE_OF(float, best.t, k);
            if (hit_block(~node[k], BOX_RAY_OF(one, k), one.triangle, one, scene.instances->first_primitive, scene, &found)) {
                SET_LANE(float, best.t, k, found.t);
                SET_LANE(float, best.b1, k, found.b1);
                SET_LANE(float, best.b2, k, found.b2);
                SET_LANE(int, best.triangle, k, found.triangle);
                SET_LANE(int, best.primitive, k, scene.instances->first_primitive);
                SET_LANE(int, lowered, k, -1);
            }
            int next = take(keys[k], todo[k], depth + k, found.t);
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
    I blocked = FALSE;
    int todo[VW][BVH_STACK + BVH_WIDTH + 1];
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
            OneRay one = one_ray(&ray, k);
            const __global float *n = scene.nodes + (size_t)node[k] * NODE_FLOATS;
            Row enter;
            uint bits = hit_boxes(n, BOX_RAY_OF(one, k), LANE_OF(float, reach, k), &enter);
            int16 child = as_int16(LOAD_ROW(n + 6 * BVH_WIDTH));
            *(SixteenEntries *)(todo[k] + depth[k]) = __builtin_ia32_compresssi512_mask(child, child, (ushort)bits);
            uint d = depth[k] + (uint)popcount(bits) - 1u;
            int next = todo[k][d];
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
            int next = todo[k][depth[k] - 1u];
            if (block_blocks(~node[k], BOX_RAY_OF(one, k), one.triangle, LANE_OF(int, target_triangle, k),
                             LANE_OF(float, reach, k), one, scene.instances->first_primitive, scene)) {
                SET_LANE(int, blocked, k, -1);
                next = AT_END;
            }
            --depth[k];
            node[k] = next;
            at_node |= at_node_bit(next, k);
            still |= at_leaf_bit(next, k);
        }
        at_leaf = still;
    }
    return blocked;
}

#endif
