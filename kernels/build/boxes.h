// Boxes of primitives while a BVH is built: two float4 each, the lower corner with the primitive's index in the bits of w,
// then the upper corner. Centroids are doubled (lower + upper). Areas are halved and taken of extents times `scale`, a
// power of two that brings the whole scene near size 1, so that no product overflows and scaling by 2^k changes nothing.
// Leaf blocks hold 2^leaf_bits primitives. Facts: BINS, the bins of an axis.
#ifndef BOXES_H
#define BOXES_H

#define BIG     0x1p127f   // beyond every coordinate: those of the boxes end at 1e37
#define CLOSEST 1e-36f     // centroids closer than this coincide; its inverse is a float

typedef struct { float4 lower, upper; } Box;

static inline float4 smaller(float4 a, float4 b) { return a < b ? a : b; }
static inline float4 larger(float4 a, float4 b)  { return a > b ? a : b; }

static inline Box empty_box(void)
{
    Box box = { (float4)(BIG), (float4)(-BIG) };
    return box;
}

static inline Box joined(Box a, Box b)
{
    Box box = { smaller(a.lower, b.lower), larger(a.upper, b.upper) };
    return box;
}

// w is cleared, as an index taken for a float is a denormal number: slow to reckon with.
static inline Box read_box(__global const float4 *boxes, int i)
{
    Box box = { boxes[2 * i], boxes[2 * i + 1] };
    box.lower.w = 0.0f;
    box.upper.w = 0.0f;
    return box;
}

// The tiny share of the edges' length tells boxes apart that have no area: those of points on a line.
static inline float half_area(Box box, float scale)
{
    float4 e = (box.upper - box.lower) * scale;
    return e.x * e.y + e.y * e.z + e.z * e.x + 1e-12f * (e.x + e.y + e.z);
}

static inline int blocks_of(int count, int leaf_bits) { return (count + (1 << leaf_bits) - 1) >> leaf_bits; }

static inline float component(float4 v, int axis) { return axis == 0 ? v.x : axis == 1 ? v.y : v.z; }

// `origin` and `scale` span the centroids of a node; the result is the same in every kernel, as nothing can be fused.
static inline int bin_of(float centroid, float origin, float scale)
{
    int bin = (int)((centroid - origin) * scale);
    return bin < 0 ? 0 : bin > BINS - 1 ? BINS - 1 : bin;
}

// Bins per unit of centroid; 0 where the centroids coincide, which puts all into bin 0. The factor keeps the last
// centroid within the last bin.
static inline float bin_scale(float low, float high)
{
    return high - low > CLOSEST ? 0.9999f * (float)BINS / (high - low) : 0.0f;
}

// Bounds and counts of the primitives of a range in the bins along x, then y, then z.
static void fill_bins(__global const float4 *boxes, int begin, int end, float4 origin, float4 scale,
                      Box *box, int *number)
{
    for (int i = 0; i < 3 * BINS; ++i) {
        box[i] = empty_box();
        number[i] = 0;
    }
    for (int i = begin; i < end; ++i) {
        Box one = read_box(boxes, i);
        float4 centroid = one.lower + one.upper;
        int x = bin_of(centroid.x, origin.x, scale.x);
        int y = bin_of(centroid.y, origin.y, scale.y) + BINS;
        int z = bin_of(centroid.z, origin.z, scale.z) + 2 * BINS;
        box[x] = joined(box[x], one);
        box[y] = joined(box[y], one);
        box[z] = joined(box[z], one);
        ++number[x];
        ++number[y];
        ++number[z];
    }
}

#endif
