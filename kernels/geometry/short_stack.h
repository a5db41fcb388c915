// Where a ray is in a tree of four children a node, held in registers: a GPU puts arrays that are indexed at run time into
// memory. A node's children are taken in the order of their distances. `done` counts the children that are behind the ray,
// two bits a level, `open` has a bit for each level with children before it, and the next of these wait on a stack of
// SHORT_ENTRIES. Where it has lost one, the ray starts again at the root and goes by `done` to where it was: Laine,
// «Restart trail for stackless BVH traversal», HPG 2010. Distances of boxes do not depend on `reach`: what a nearer hit
// rules out stands at the end of the order, so that counts hold.
#ifndef SHORT_STACK_H
#define SHORT_STACK_H
#include "geometry/bvh.h"

#define NO_CHILD     0xffffffffu
#ifndef SHORT_ENTRIES
#define SHORT_ENTRIES 5                 // 5 at most; tests take fewer
#endif

typedef struct {
    int   node;                     // >= 0: a node, < 0: the block ~node
    uint  level;
    ulong done;
    uint  open;
    int   s0, s1, s2, s3, s4;       // twice the node, and 1 for the last of its siblings
    uint  held;
} Walk;

static Walk walk_from(int root)
{
    Walk w = { root, 0u, 0ul, 0u, 0, 0, 0, 0, 0, 0u };
    return w;
}

#define PUSH(w, entry)                                                                                      \
    { (w)->s4 = (w)->s3; (w)->s3 = (w)->s2; (w)->s2 = (w)->s1; (w)->s1 = (w)->s0; (w)->s0 = (entry);        \
      (w)->held = min((w)->held + 1u, (uint)SHORT_ENTRIES); }

static inline int of_four_ints(int4 v, uint k) { return k & 2u ? (k & 1u ? v.w : v.z) : (k & 1u ? v.y : v.x); }

#define SORT_KEYS(a, b)  { uint low = min(a, b); b = max(a, b); a = low; }

// Narrows a ray's way through four boxes to what lies between their planes along one axis, as hit_boxes does for all.
#define BETWEEN_PLANES(first, last, node, near, far, o, i)           \
    {                                                                \
        float4 a = ((node)[near] - (o)) * (i);                       \
        float4 b = ((node)[far] - (o)) * (i);                        \
        first = first > a ? first : a;                               \
        last = last < b ? last : b;                                  \
    }

// Goes from a node to the nearest of its children before `reach` that is not done; whether there is one. The ray has the
// origin `o` and the inverse direction `i`.
static int goes_down(Walk *w, const __global float4 *node, float3 o, float3 i, float reach)
{
    uint x = i.x < 0.0f ? 3u : 0u, y = i.y < 0.0f ? 4u : 1u, z = i.z < 0.0f ? 5u : 2u;
    float4 first = (node[x] - o.x) * i.x;
    float4 last = (node[3u - x] - o.x) * i.x;
    BETWEEN_PLANES(first, last, node, y, 5u - y, o.y, i.y)
    BETWEEN_PLANES(first, last, node, z, 7u - z, o.z, i.z)
    first = first > 0.0f ? first : (float4)(0.0f);
    last = last * FAR_PAD;
    last = last < reach ? last : (float4)(reach);
    int4 met = first <= last;
    // Distances are no less than 0, so that their bits are in their order; the last two make room for the child's number.
    uint a = met.x ? as_uint(first.x) & ~3u : NO_CHILD;
    uint b = met.y ? (as_uint(first.y) & ~3u) | 1u : NO_CHILD;
    uint c = met.z ? (as_uint(first.z) & ~3u) | 2u : NO_CHILD;
    uint d = met.w ? (as_uint(first.w) & ~3u) | 3u : NO_CHILD;
    SORT_KEYS(a, b) SORT_KEYS(c, d) SORT_KEYS(a, c) SORT_KEYS(b, d) SORT_KEYS(b, c)
    uint done = (uint)(w->done >> (2u * w->level)) & 3u;
    if (done & 1u) {
        a = b; b = c; c = d; d = NO_CHILD;
    }
    if (done & 2u) {
        a = c; b = d; c = d = NO_CHILD;
    }
    if (a == NO_CHILD)
        return 0;
    int4 child = as_int4(node[6]);
    w->node = of_four_ints(child, a & 3u);
    if (d != NO_CHILD)
        PUSH(w, 2 * of_four_ints(child, d & 3u) | 1)
    if (c != NO_CHILD)
        PUSH(w, 2 * of_four_ints(child, c & 3u) | (d == NO_CHILD))
    if (b != NO_CHILD) {
        PUSH(w, 2 * of_four_ints(child, b & 3u) | (c == NO_CHILD))
        w->open |= 1u << w->level;
    }
    ++w->level;
    return 1;
}

// Goes on with the nearest child that waits, or from the root towards it; whether there is one.
static int goes_on(Walk *w, int root)
{
    if (w->open == 0u)
        return 0;
    uint level = 31u - clz(w->open), shift = 2u * level;
    w->done = (w->done & ((4ul << shift) - 1ul)) + (1ul << shift);
    if (w->held == 0u) {
        w->node = root;
        w->level = 0u;
        w->open = 0u;
        return 1;
    }
    w->node = w->s0 >> 1;
    w->open &= ~((uint)(w->s0 & 1) << level);
    w->level = level + 1u;
    w->s0 = w->s1; w->s1 = w->s2; w->s2 = w->s3; w->s3 = w->s4;
    --w->held;
    return 1;
}

#endif
