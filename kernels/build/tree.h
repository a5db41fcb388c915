// A binary tree that is being changed: nodes 0 ... leaves - 1 are leaves, inner node n has children[n - leaves]. Boxes are
// two float4 per node, 0 in w; `shrink` is the scale of half_area.
#ifndef TREE_H
#define TREE_H
#include "build/boxes.h"

static inline int sibling(__global const int2 *children, int leaves, int parent, int node)
{
    int2 pair = children[parent - leaves];
    return pair.x == node ? pair.y : pair.x;
}

static inline float node_area(__global const float4 *boxes, int node, float shrink)
{
    return half_area(read_box(boxes, node), shrink);
}

#endif
