// One ray against a tree of wide nodes: BVH_WIDTH boxes, or LEAF_WIDTH triangles of a leaf, at once in a vector. A node is
// BVH_WIDTH columns of min x y z, max x y z and child: >= 0 another node, < 0 the block ~child; boxes of missing children
// are inside out. A block is LEAF_WIDTH columns of three corners and the triangle's index, all zero where there is none.
//
// Box test: Ize, «Robust BVH ray traversal», JCGT 2(2) 2013: the far side is moved out by the rounding of the distances,
// so that no ray slips between two boxes. Triangle test: Woop, Benthin, Wald, «Watertight ray/triangle intersection», JCGT
// 2(1) 2013: edge functions of shared edges agree to the last bit, which fused multiply-add would spoil.
#ifndef BVH_H
#define BVH_H
#include "common/math.h"

// Whether the rays of a pack walk side by side, which takes vectors that are packed by masks.
#define SIDE_BY_SIDE  (VW == 16 && BVH_WIDTH == 16 && LEAF_WIDTH == 16 && CLANG_AVX512)

// Vectors of a node and of a block, and which of their comparisons hold, as bits.
#define JOINED(a, b)      a##b
#define SIZED(name, n)    JOINED(name, n)
typedef SIZED(float, BVH_WIDTH)   Row;
typedef SIZED(int, BVH_WIDTH)     RowMask;
typedef SIZED(float, LEAF_WIDTH)  Block;
typedef SIZED(int, LEAF_WIDTH)    BlockMask;
#ifdef CLANG_AVX2                       // PoCL's vload16 takes four steps
typedef Row   __attribute__((aligned(4))) RowAnywhere;
typedef Block __attribute__((aligned(4))) BlockAnywhere;
#define LOAD_ROW(p)       (*(const __global RowAnywhere *)(p))
#define LOAD_BLOCK(p)     (*(const __global BlockAnywhere *)(p))
#elif VW == 1                           // nodes and blocks are multiples of 16 bytes, and a GPU reads so many at once
#define LOAD_ROW(p)       (*(const __global Row *)(p))
#define LOAD_BLOCK(p)     (*(const __global Block *)(p))
#else
#define LOAD_ROW(p)       SIZED(vload, BVH_WIDTH)(0, p)
#define LOAD_BLOCK(p)     SIZED(vload, LEAF_WIDTH)(0, p)
#endif
#define ROW_BITS(m)       SIZED(bits_of_, BVH_WIDTH)(m)
#define BLOCK_BITS(m)     SIZED(bits_of_, LEAF_WIDTH)(m)

static inline uint bits_of_4(int4 m)
{
    int4 b = m & (int4)(1, 2, 4, 8);
    int2 e = b.lo | b.hi;
    return (uint)(e.x | e.y);
}

static inline uint bits_of_8(int8 m)
{
#ifdef CLANG_AVX2
    return (uint)__builtin_ia32_movmskps256(as_float8(m));
#else
    return bits_of_4(m.lo) | (bits_of_4(m.hi) << 4);
#endif
}

static inline uint bits_of_16(int16 m)
{
#ifdef CLANG_AVX512
    return (uint)(ushort)__builtin_ia32_cvtd2mask512(m);
#else
    return bits_of_8(m.lo) | (bits_of_8(m.hi) << 8);
#endif
}

#define NODE_FLOATS   (7 * BVH_WIDTH)
#define BLOCK_FLOATS  (10 * LEAF_WIDTH)
#define FAR_PAD       1.0000004f      // 1 + 2 gamma(3), rounded up

// A ray made ready: signed inverse direction, which side of a box is near, and the shear that turns it into the z axis.
typedef struct {
    float ox, oy, oz, ix, iy, iz;
    uint  near_x, near_y, near_z, far_x, far_y, far_z;      // where a node's rows of near and far planes begin
    uint  row_x, row_y, row_z;                              // the same of a block's rows; z: the direction's largest part
    float px, py, pz;                                       // origin in that order
    float sx, sy, sz;
} BoxRay;

typedef struct {
    float t, b1, b2;        // distance and weights of the second and third corner
    int   triangle;
} TriangleHit;

// Infinite for a ray along the planes of a slab. Where it lies in such a plane its distance is 0 * infinity, not a number,
// and the comparisons of hit_boxes leave that slab out: both boxes beside the plane are met.
static inline float inverse_of(float d) { return d < 0.0f ? -1.0f / fabs(d) : 1.0f / fabs(d); }

static BoxRay box_ray(float ox, float oy, float oz, float dx, float dy, float dz)
{
    BoxRay r;
    r.ox = ox; r.oy = oy; r.oz = oz;
    r.ix = inverse_of(dx); r.iy = inverse_of(dy); r.iz = inverse_of(dz);
    r.near_x = (dx < 0.0f ? 3u : 0u) * BVH_WIDTH; r.far_x = 3u * BVH_WIDTH - r.near_x;
    r.near_y = (dy < 0.0f ? 4u : 1u) * BVH_WIDTH; r.far_y = 5u * BVH_WIDTH - r.near_y;
    r.near_z = (dz < 0.0f ? 5u : 2u) * BVH_WIDTH; r.far_z = 7u * BVH_WIDTH - r.near_z;
    float ax = fabs(dx), ay = fabs(dy), az = fabs(dz);
    int z_leads = az >= ax && az >= ay;
    int x_leads = !z_leads && ax >= ay;
    r.row_z = (z_leads ? 2u : (x_leads ? 0u : 1u)) * LEAF_WIDTH;
    r.row_x = (z_leads ? 0u : (x_leads ? 1u : 2u)) * LEAF_WIDTH;
    r.row_y = (z_leads ? 1u : (x_leads ? 2u : 0u)) * LEAF_WIDTH;
    r.pz = z_leads ? oz : (x_leads ? ox : oy);
    r.px = z_leads ? ox : (x_leads ? oy : oz);
    r.py = z_leads ? oy : (x_leads ? oz : ox);
    r.sz = 1.0f / (z_leads ? dz : (x_leads ? dx : dy));
    r.sx = (z_leads ? dx : (x_leads ? dy : dz)) * r.sz;
    r.sy = (z_leads ? dy : (x_leads ? dz : dx)) * r.sz;
    return r;
}

static inline F inverse_of_lanes(F d) { return (d < 0.0f ? (F)(-1.0f) : ONE) / absolute(d); }

// The rays of all lanes made ready together, as box_ray makes one.
typedef struct {
    F ox, oy, oz, ix, iy, iz, px, py, pz, sx, sy, sz;
    I near_x, near_y, near_z, far_x, far_y, far_z, row_x, row_y, row_z;
} BoxRays;

static BoxRays box_rays(F3 o, F3 d)
{
    BoxRays r;
    r.ox = o.x; r.oy = o.y; r.oz = o.z;
    r.ix = inverse_of_lanes(d.x); r.iy = inverse_of_lanes(d.y); r.iz = inverse_of_lanes(d.z);
    r.near_x = d.x < 0.0f ? (I)(3 * BVH_WIDTH) : FALSE;              r.far_x = 3 * BVH_WIDTH - r.near_x;
    r.near_y = d.y < 0.0f ? (I)(4 * BVH_WIDTH) : (I)(BVH_WIDTH);     r.far_y = 5 * BVH_WIDTH - r.near_y;
    r.near_z = d.z < 0.0f ? (I)(5 * BVH_WIDTH) : (I)(2 * BVH_WIDTH); r.far_z = 7 * BVH_WIDTH - r.near_z;
    F ax = absolute(d.x), ay = absolute(d.y), az = absolute(d.z);
    I z_leads = (az >= ax) & (az >= ay);
    I x_leads = NOT(z_leads) & (ax >= ay);
    I first = FALSE, second = (I)(LEAF_WIDTH), third = (I)(2 * LEAF_WIDTH);
    r.row_z = z_leads ? third : (x_leads ? first : second);
    r.row_x = z_leads ? first : (x_leads ? second : third);
    r.row_y = z_leads ? second : (x_leads ? third : first);
    r.pz = z_leads ? o.z : (x_leads ? o.x : o.y);
    r.px = z_leads ? o.x : (x_leads ? o.y : o.z);
    r.py = z_leads ? o.y : (x_leads ? o.z : o.x);
    r.sz = ONE / (z_leads ? d.z : (x_leads ? d.x : d.y));
    r.sx = (z_leads ? d.x : (x_leads ? d.y : d.z)) * r.sz;
    r.sy = (z_leads ? d.y : (x_leads ? d.z : d.x)) * r.sz;
    return r;
}

// Bits of the triangles of a block that the ray meets before `reach`; distances and weights of all of them.
IN_PLACE static uint hit_triangles(const __global float *block, BoxRay r, float reach, Block *distance, Block *b1,
                                   Block *b2)
{
#pragma OPENCL FP_CONTRACT OFF
    const __global float *x = block + r.row_x;
    const __global float *y = block + r.row_y;
    const __global float *z = block + r.row_z;
    Block az = LOAD_BLOCK(z) - r.pz;
    Block bz = LOAD_BLOCK(z + 3 * LEAF_WIDTH) - r.pz;
    Block cz = LOAD_BLOCK(z + 6 * LEAF_WIDTH) - r.pz;
    Block ax = LOAD_BLOCK(x) - r.px - r.sx * az;
    Block ay = LOAD_BLOCK(y) - r.py - r.sy * az;
    Block bx = LOAD_BLOCK(x + 3 * LEAF_WIDTH) - r.px - r.sx * bz;
    Block by = LOAD_BLOCK(y + 3 * LEAF_WIDTH) - r.py - r.sy * bz;
    Block cx = LOAD_BLOCK(x + 6 * LEAF_WIDTH) - r.px - r.sx * cz;
    Block cy = LOAD_BLOCK(y + 6 * LEAF_WIDTH) - r.py - r.sy * cz;
    Block u = cx * by - cy * bx;
    Block v = ax * cy - ay * cx;
    Block w = bx * ay - by * ax;
    BlockMask inside = ((u >= 0.0f) & (v >= 0.0f) & (w >= 0.0f)) | ((u <= 0.0f) & (v <= 0.0f) & (w <= 0.0f));
#if !SIDE_BY_SIDE                        // where rays walk side by side, a branch foreseen wrongly costs more
    if (BLOCK_BITS(inside) == 0u)
        return 0u;
#endif
    Block det = u + v + w;
    Block inverse = 1.0f / det;
    Block t = (u * az + v * bz + w * cz) * r.sz * inverse;
    *distance = t;
    *b1 = v * inverse;
    *b2 = w * inverse;
    return BLOCK_BITS(inside & (det != 0.0f) & (t > 0.0f) & (t < reach));
}

// Bits of the children of a node that the ray meets before `reach`; where it enters them through *enter.
IN_PLACE static uint hit_boxes(const __global float *node, BoxRay r, float reach, Row *enter)
{
    Row x = (LOAD_ROW(node + r.near_x) - r.ox) * r.ix;
    Row y = (LOAD_ROW(node + r.near_y) - r.oy) * r.iy;
    Row z = (LOAD_ROW(node + r.near_z) - r.oz) * r.iz;
    Row X = (LOAD_ROW(node + r.far_x) - r.ox) * r.ix;
    Row Y = (LOAD_ROW(node + r.far_y) - r.oy) * r.iy;
    Row Z = (LOAD_ROW(node + r.far_z) - r.oz) * r.iz;
    Row first = x > y ? x : y;
    first = first > z ? first : z;
    first = first > 0.0f ? first : (Row)(0.0f);
    Row last = X < Y ? X : Y;
    last = last < Z ? last : Z;
    last = last * FAR_PAD;
    last = last < reach ? last : (Row)(reach);
    *enter = first;
    return ROW_BITS(first <= last);
}

#endif
