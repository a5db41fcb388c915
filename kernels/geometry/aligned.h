// Flat primitives and boxes whose edges lie along the axes of the world, as walls, floors and tables do. All of them share
// one division an axis, and no ray is turned into their space. In scenes of few primitives none of which moves.
#ifndef ALIGNED_H
#define ALIGNED_H
#include "common/scene.h"
#include "geometry/hit.h"

// One over the direction, which may be infinite; the same, finite, and its size.
typedef struct { F3 inverse, slope, width; } Axes;

static inline F finite(F x) { return MIN(MAX(x, (F)(-1e30f)), (F)(1e30f)); }

static inline Axes axes_of(Ray ray)
{
    Axes axes;
    axes.inverse = f3(ONE / ray.d.x, ONE / ray.d.y, ONE / ray.d.z);
#if ALIGNED_BOXES
    axes.slope = f3(finite(axes.inverse.x), finite(axes.inverse.y), finite(axes.inverse.z));
    axes.width = f3(absolute(axes.slope.x), absolute(axes.slope.y), absolute(axes.slope.z));
#endif
    return axes;
}

#if ALIGNED_FLATS
// Where a ray meets the plane of a flat primitive: how far away, and there the coordinates along the next two axes.
typedef struct { F t, a, b; } AlignedHit;

IN_PLACE static AlignedHit meet_aligned(const __global Aligned *flat, Ray ray, Axes axes)
{
    AlignedHit hit;
    float stands = flat->place.x;
    if (flat->axis == 0) {
        hit.t = (stands - ray.o.x) * axes.inverse.x;
        hit.a = ray.o.y + hit.t * ray.d.y;
        hit.b = ray.o.z + hit.t * ray.d.z;
    } else if (flat->axis == 1) {
        hit.t = (stands - ray.o.y) * axes.inverse.y;
        hit.a = ray.o.z + hit.t * ray.d.z;
        hit.b = ray.o.x + hit.t * ray.d.x;
    } else {
        hit.t = (stands - ray.o.z) * axes.inverse.z;
        hit.a = ray.o.x + hit.t * ray.d.x;
        hit.b = ray.o.y + hit.t * ray.d.y;
    }
    return hit;
}

static inline F hit_aligned(const __global Aligned *flat, AlignedHit hit, F *u, F *v)
{
    float4 own = flat->reach;
    *u = own.x * hit.a + own.y;
    *v = own.z * hit.b + own.w;
    return hit.t;
}
#endif

#if ALIGNED_BOXES
// As hit_box of geometry/primitives.h, which includes this.
IN_PLACE static F hit_aligned_box(const __global Aligned *box, Ray ray, Axes axes, I origin, I *met)
{
    float4 middle = box->place, half_size = box->reach;
    F3 m = f3((middle.x - ray.o.x) * axes.slope.x, (middle.y - ray.o.y) * axes.slope.y,
              (middle.z - ray.o.z) * axes.slope.z);
    F3 k = f3(half_size.x * axes.width.x, half_size.y * axes.width.y, half_size.z * axes.width.z);
    return hit_slabs(m, k, origin, met);
}
#endif

#endif
