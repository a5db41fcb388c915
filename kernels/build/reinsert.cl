// Moves nodes to the places that `search` found for them, one after the other, as each move changes the tree for the
// next: a single work item. A move that no longer makes the sum of the areas smaller is taken back.
#include "build/tree.h"

typedef struct {
    __global float4 *boxes;      // [nodes][2]
    __global int2   *children;   // [inner nodes]
    __global int    *parents;    // [nodes]
    int              leaves, root;
    float            shrink;     // scale of half_area
} Tree;

static inline void replace_child(Tree tree, int parent, int old, int node)
{
    __global int2 *pair = tree.children + (parent - tree.leaves);
    if (pair->x == old)
        pair->x = node;
    else
        pair->y = node;
    tree.parents[node] = parent;
}

// Fits the boxes from a node up to the root and returns by how much the areas shrank.
static float refit(Tree tree, int node)
{
    float won = 0.0f;
    for (;; node = tree.parents[node]) {
        int2 pair = tree.children[node - tree.leaves];
        Box old = read_box(tree.boxes, node);
        Box box = joined(read_box(tree.boxes, pair.x), read_box(tree.boxes, pair.y));
        int4 same = (old.lower == box.lower) & (old.upper == box.upper);
        if (same.x & same.y & same.z)
            return won;
        won += half_area(old, tree.shrink) - half_area(box, tree.shrink);
        tree.boxes[2 * node] = box.lower;
        tree.boxes[2 * node + 1] = box.upper;
        if (node == tree.root)
            return won;
    }
}

// Takes a node's parent, with the node, out of the tree; returns the area won.
static inline float take_out(Tree tree, int node)
{
    int parent = tree.parents[node], above = tree.parents[parent];
    float won = node_area(tree.boxes, parent, tree.shrink);
    replace_child(tree, above, parent, sibling(tree.children, tree.leaves, parent, node));
    return won + refit(tree, above);
}

// Puts a node's parent, with the node, above `place`; returns the area won, which is negative.
static inline float put_in(Tree tree, int node, int place)
{
    int parent = tree.parents[node], above = tree.parents[place];
    replace_child(tree, above, place, parent);
    tree.children[parent - tree.leaves] = (int2)(place, node);
    tree.parents[place] = parent;
    Box box = joined(read_box(tree.boxes, place), read_box(tree.boxes, node));
    tree.boxes[2 * parent] = box.lower;
    tree.boxes[2 * parent + 1] = box.upper;
    return refit(tree, above) - half_area(box, tree.shrink);
}

static bool may_move(Tree tree, int node, int place)
{
    int parent = tree.parents[node];
    if (parent == tree.root || place == parent || tree.parents[place] == parent)
        return false;
    while (place != tree.root && place != node)
        place = tree.parents[place];
    return place != node;    // else the place is a part of the node
}

__kernel void reinsert(__global float4    *boxes,
                       __global int2      *children,
                       __global int       *parents,
                       __global const int *nodes,      // [count] what to move
                       __global const int *places,     // [count] beside what; neither is ever the root
                       int                 leaves,
                       int                 root,
                       float               shrink,
                       int                 count)
{
    Tree tree = { boxes, children, parents, leaves, root, shrink };
    if (get_global_id(0) > 0)
        return;
    for (int i = 0; i < count; ++i) {
        int node = nodes[i], place = places[i];
        if (!may_move(tree, node, place))
            continue;
        int beside = sibling(children, leaves, parents[node], node);
        float won = take_out(tree, node);
        won += put_in(tree, node, place);
        if (won <= 0.0f) {
            take_out(tree, node);
            put_in(tree, node, beside);
        }
    }
}
