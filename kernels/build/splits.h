// Ways to split a range of boxes in place. Each returns where the right part begins. Cost of a part: its area times the
// leaf blocks that it fills.
// Facts: SWEEP, the most primitives that are sorted and split exactly.
#ifndef SPLITS_H
#define SPLITS_H
#include "build/boxes.h"

static inline float cost_of(Box part, int count, int leaf_bits, float shrink)
{
    return count > 0 ? half_area(part, shrink) * (float)blocks_of(count, leaf_bits) : INFINITY;
}

static inline void swap_boxes(__global float4 *boxes, int i, int j)
{
    float4 lower = boxes[2 * i], upper = boxes[2 * i + 1];
    boxes[2 * i] = boxes[2 * j];
    boxes[2 * i + 1] = boxes[2 * j + 1];
    boxes[2 * j] = lower;
    boxes[2 * j + 1] = upper;
}

// Halves made of whole blocks, in the order that is: for primitives whose centroids coincide.
static inline int halves(int begin, int end, int leaf_bits)
{
    return begin + ((blocks_of(end - begin, leaf_bits) + 1) / 2 << leaf_bits);
}

static inline float doubled_centroid(__global const float4 *boxes, int i, int axis)
{
    return component(boxes[2 * i], axis) + component(boxes[2 * i + 1], axis);
}

// The object median along the longest axis of the centroids: halves again, after a selection (Hoare 1961).
static int median_split(__global float4 *boxes, int begin, int end, int leaf_bits, Box span)
{
    float4 extent = span.upper - span.lower;
    int axis = extent.x >= extent.y && extent.x >= extent.z ? 0 : extent.y >= extent.z ? 1 : 2;
    int middle = halves(begin, end, leaf_bits), first = begin, last = end - 1;
    while (first < last) {
        float pivot = doubled_centroid(boxes, first + (last - first) / 2, axis);
        int i = first, j = last;
        while (i <= j) {
            while (doubled_centroid(boxes, i, axis) < pivot)
                ++i;
            while (pivot < doubled_centroid(boxes, j, axis))
                --j;
            if (i <= j)
                swap_boxes(boxes, i++, j--);
        }
        if (middle <= j)
            last = j;
        else if (middle >= i)
            first = i;
        else
            break;
    }
    return middle;
}

// The best of the planes between bins along all axes (Wald 2007).
static int binned_split(__global float4 *boxes, int begin, int end, int leaf_bits, Box span, float shrink)
{
    float4 origin = span.lower;
    float4 scale = (float4)(bin_scale(span.lower.x, span.upper.x),
                            bin_scale(span.lower.y, span.upper.y),
                            bin_scale(span.lower.z, span.upper.z), 0.0f);
    Box box[3 * BINS];
    int number[3 * BINS];
    fill_bins(boxes, begin, end, origin, scale, box, number);
    float best = INFINITY;
    int best_axis = 0, best_bin = 0;
    for (int axis = 0; axis < 3; ++axis) {
        float right_cost[BINS];
        Box part = empty_box();
        int count = 0;
        for (int bin = BINS - 1; bin > 0; --bin) {
            part = joined(part, box[axis * BINS + bin]);
            count += number[axis * BINS + bin];
            right_cost[bin] = cost_of(part, count, leaf_bits, shrink);
        }
        part = empty_box();
        count = 0;
        for (int bin = 1; bin < BINS; ++bin) {
            part = joined(part, box[axis * BINS + bin - 1]);
            count += number[axis * BINS + bin - 1];
            float cost = cost_of(part, count, leaf_bits, shrink) + right_cost[bin];
            if (cost < best) {
                best = cost;
                best_axis = axis;
                best_bin = bin;
            }
        }
    }
    float low = component(origin, best_axis), step = component(scale, best_axis);
    int i = begin, j = end - 1;
    for (;;) {
        while (bin_of(doubled_centroid(boxes, i, best_axis), low, step) < best_bin)
            ++i;
        while (bin_of(doubled_centroid(boxes, j, best_axis), low, step) >= best_bin)
            --j;
        if (i > j)
            return i;
        swap_boxes(boxes, i++, j--);
    }
}

// The best of all splits of at most SWEEP primitives in the order of their centroids along each axis.
static int sweep_split(__global float4 *boxes, int begin, int end, int leaf_bits, float shrink)
{
    int count = end - begin, best_axis = 0, best_left = 0;
    Box box[SWEEP];
    uchar order[3][SWEEP];
    float best = INFINITY;
    for (int i = 0; i < count; ++i)
        box[i] = read_box(boxes, begin + i);
    for (int axis = 0; axis < 3; ++axis) {
        float key[SWEEP], right_cost[SWEEP];
        for (int i = 0; i < count; ++i) {
            float centroid = component(box[i].lower, axis) + component(box[i].upper, axis);
            int j = i;
            for (; j > 0 && key[j - 1] > centroid; --j) {
                key[j] = key[j - 1];
                order[axis][j] = order[axis][j - 1];
            }
            key[j] = centroid;
            order[axis][j] = (uchar)i;
        }
        Box part = empty_box();
        for (int i = count - 1; i > 0; --i) {
            part = joined(part, box[order[axis][i]]);
            right_cost[i] = cost_of(part, count - i, leaf_bits, shrink);
        }
        part = empty_box();
        for (int i = 1; i < count; ++i) {
            part = joined(part, box[order[axis][i - 1]]);
            float cost = cost_of(part, i, leaf_bits, shrink) + right_cost[i];
            if (cost < best) {
                best = cost;
                best_axis = axis;
                best_left = i;
            }
        }
    }
    for (int i = 0; i < count; ++i) {
        box[i].lower = boxes[2 * (begin + i)];
        box[i].upper = boxes[2 * (begin + i) + 1];
    }
    for (int i = 0; i < count; ++i) {
        boxes[2 * (begin + i)] = box[order[best_axis][i]].lower;
        boxes[2 * (begin + i) + 1] = box[order[best_axis][i]].upper;
    }
    return begin + best_left;
}

#endif
