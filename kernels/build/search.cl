// Finds where each node would hang best: one work item per node. Taken out together with its parent and put in again
// beside another node, it changes the sum of the areas of all inner nodes; writes the place of greatest gain, or -1.
// After Meister and Bittner, "Parallel Reinsertion for Bounding Volume Hierarchy Optimization" (2018).
// Facts: MOST_VISITS, after which a search ends with what it has found.
#include "build/tree.h"

#define WAITING 128

typedef struct { float gain; int place; int visits; } Best;

// Looks for a better place below `top`. `gain` is what taking the node out and growing the boxes above `top` gains.
static Best best_below(Best best, int top, float gain, Box box, float area, __global const float4 *boxes,
                       __global const int2 *children, int leaves, float shrink)
{
    int place[WAITING];
    float gain_at[WAITING];
    int waiting = 1;
    place[0] = top;
    gain_at[0] = gain;
    while (waiting > 0 && best.visits < MOST_VISITS) {
        int node = place[--waiting];
        float so_far = gain_at[waiting];
        if (so_far - area <= best.gain)    // a box that holds the node is at least as large as the node
            continue;
        ++best.visits;
        Box own = read_box(boxes, node);
        float grown = half_area(joined(own, box), shrink);
        if (so_far - grown > best.gain) {
            best.gain = so_far - grown;
            best.place = node;
        }
        so_far -= grown - half_area(own, shrink);
        if (node >= leaves && so_far - area > best.gain && waiting < WAITING - 1) {
            int2 pair = children[node - leaves];
            place[waiting] = pair.x;
            gain_at[waiting++] = so_far;
            place[waiting] = pair.y;
            gain_at[waiting++] = so_far;
        }
    }
    return best;
}

__kernel void search(__global const float4 *boxes,       // [nodes][2]
                     __global const int2   *children,    // [inner nodes]
                     __global const int    *parents,     // [nodes]
                     __global int          *places,      // [nodes] beside which node it would hang best, or -1
                     __global float        *gains,       // [nodes] area won
                     int                    leaves,
                     int                    root,
                     float                  shrink,      // scale of half_area
                     int                    count)       // nodes
{
    int node = (int)get_global_id(0);
    if (node >= count)
        return;
    Best best = { 0.0f, -1, 0 };
    if (node != root && parents[node] != root) {
        Box box = read_box(boxes, node), left = empty_box();    // `left`: what an ancestor holds without the node
        float area = half_area(box, shrink), gain = node_area(boxes, parents[node], shrink);
        int below = node, ancestor = parents[node];
        for (;;) {
            int other = sibling(children, leaves, ancestor, below);
            best = best_below(best, other, gain, box, area, boxes, children, leaves, shrink);
            if (ancestor == root || best.visits >= MOST_VISITS)
                break;
            left = joined(left, read_box(boxes, other));
            if (below != node) {    // the parent itself goes away as a whole
                float held = node_area(boxes, ancestor, shrink);
                gain += held - half_area(left, shrink);
                if (gain - held > best.gain) {
                    best.gain = gain - held;
                    best.place = ancestor;
                }
            }
            below = ancestor;
            ancestor = parents[ancestor];
        }
    }
    places[node] = best.place;
    gains[node] = best.gain;
}
