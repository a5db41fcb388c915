// Cubic curves with a width: ribbons that turn to the ray, round at their ends. row_x, row_y and row_z hold the x, y and z of
// the four Bézier points; `instance` and `first_triangle` the half widths at both ends, as bits of float, the first with a
// sign where the curve shows itself flat and not as a tube; `emitter`, which is negative, the place along the whole strand.
// A ray that starts on any curve meets curves beyond their width only: hair scatters light on both sides of where it is met.
#ifndef CUBIC_CURVE_H
#define CUBIC_CURVE_H
#include "geometry/hit.h"
#include "geometry/surface.h"

#define CURVE_PIECES  4     // in each of which the nearest place is searched from that of its chord
#define CURVE_STEPS   4     // of Newton, kept between places on either side
#define STEADY        0.02f // half widths by which a place along the curve may miss the nearest one
#define SPAN_BITS     15    // of the place along a strand where a curve begins, and as many where it ends

// A curve as a ray sees it: its Bézier points across the ray, and how far along it they are.
typedef struct { F3 q0, q1, q2, q3; F z0, z1, z2, z3; float first, last; } Strand;

static inline F3 curve_point(const __global Primitive *p, int k)
{
    float4 x = p->row_x, y = p->row_y, z = p->row_z;
    return k == 0 ? f3((F)(x.x), (F)(y.x), (F)(z.x)) : k == 1 ? f3((F)(x.y), (F)(y.y), (F)(z.y))
         : k == 2 ? f3((F)(x.z), (F)(y.z), (F)(z.z)) : f3((F)(x.w), (F)(y.w), (F)(z.w));
}

static inline F3 across_ray(const __global Primitive *p, int k, Ray ray, F *along_ray)
{
    F3 v = sub(curve_point(p, k), ray.o);
    *along_ray = dot3(v, ray.d);
    return along(v, ray.d, -*along_ray);
}

// Half the widths at both ends, where meshes have their instance and first triangle; a ribbon has the first below zero.
static inline float half_width_at_first(const __global Primitive *curve) { return fabs(as_float(curve->instance)); }
static inline float half_width_at_last(const __global Primitive *curve) { return as_float(curve->first_triangle); }
static inline int is_ribbon(const __global Primitive *curve) { return curve->instance < 0; }

static Strand strand_of(const __global Primitive *p, Ray ray)
{
    Strand s;
    s.q0 = across_ray(p, 0, ray, &s.z0);
    s.q1 = across_ray(p, 1, ray, &s.z1);
    s.q2 = across_ray(p, 2, ray, &s.z2);
    s.q3 = across_ray(p, 3, ray, &s.z3);
    s.first = half_width_at_first(p);
    s.last = half_width_at_last(p);
    return s;
}

static inline F3 strand_at(Strand s, F u)
{
    F w = 1.0f - u;
    return add(scale(along(scale(s.q0, w), s.q1, 3.0f * u), w * w), scale(along(scale(s.q2, 3.0f * w), s.q3, u), u * u));
}

static inline F3 strand_slope(Strand s, F u)        // dq/du
{
    F w = 1.0f - u;
    F3 ends = add(scale(sub(s.q1, s.q0), w * w), scale(sub(s.q3, s.q2), u * u));
    return scale(along(ends, sub(s.q2, s.q1), 2.0f * u * w), (F)(3.0f));
}

static inline F3 strand_bend(Strand s, F u)         // and its derivative
{
    F3 first = along(add(s.q0, s.q2), s.q1, (F)(-2.0f)), last = along(add(s.q1, s.q3), s.q2, (F)(-2.0f));
    return scale(along(first, sub(last, first), u), (F)(6.0f));
}

static inline F strand_depth(Strand s, F u)
{
    F w = 1.0f - u;
    return w * w * (w * s.z0 + 3.0f * u * s.z1) + u * u * (3.0f * w * s.z2 + u * s.z3);
}

// The same for a single ray, by points that are read again where a curve is met: compilers for GPUs hold no z meanwhile.
#if VW == 1
static inline float along_again(const __global Primitive *p, int k, Ray ray)
{
    const volatile __global float *x = (const volatile __global float *)&p->row_x;
    const volatile __global float *y = (const volatile __global float *)&p->row_y;
    const volatile __global float *z = (const volatile __global float *)&p->row_z;
    return dot3(sub(f3(x[k], y[k], z[k]), ray.o), ray.d);
}

static float depth_again(const __global Primitive *p, Ray ray, float u)
{
    float w = 1.0f - u;
    return w * w * (w * along_again(p, 0, ray) + 3.0f * u * along_again(p, 1, ray))
        + u * u * (3.0f * w * along_again(p, 2, ray) + u * along_again(p, 3, ray));
}
#define STRAND_DEPTH(u, on)  ((on) ? depth_again(p, ray, u) : ZERO)
#else
#define STRAND_DEPTH(u, on)  strand_depth(s, u)
#endif

static inline F half_width(Strand s, F u) { return s.first + u * (F)(s.last - s.first); }

// Distance to the curve, negative without a hit, and where along it: nearest to the ray in one of the pieces. `from_curve` are
// lanes whose ray starts on a curve.
static F hit_curve(const __global Primitive *p, Ray ray, I from_curve, F *u)
{
    Strand s = strand_of(p, ray);
    F best = (F)(NEVER);
    *u = ZERO;
    // The points lie on one side of a line that the width does not reach.
    F3 middle = add(add(s.q0, s.q1), add(s.q2, s.q3));
    F near = MIN(MIN(dot3(s.q0, middle), dot3(s.q1, middle)), MIN(dot3(s.q2, middle), dot3(s.q3, middle)));
    F most = (F)(s.first > s.last ? s.first : s.last) * sqrt(dot3(middle, middle));
    if (!ANY(near <= most))
        return (F)(-1.0f);
    // A piece is nowhere farther from its chord than an eighth of its second derivative, over the square of their number.
    F3 bend0 = strand_bend(s, ZERO), bend1 = strand_bend(s, ONE);
    F bulge = (0.125f / (CURVE_PIECES * CURVE_PIECES)) * sqrt(MAX(dot3(bend0, bend0), dot3(bend1, bend1)));
    F reach = bulge + (s.first > s.last ? s.first : s.last);
    F3 start = s.q0;
    for (int k = 0; k < CURVE_PIECES; ++k) {
        float low = (float)k / CURVE_PIECES, high = (float)(k + 1) / CURVE_PIECES;
        F3 stop = strand_at(s, (F)(high));
        F3 chord = sub(stop, start);
        F share = -dot3(start, chord) / MAX(dot3(chord, chord), (F)(SMALLEST));
        share = MIN(MAX(share, ZERO), ONE);
        F3 off_chord = along(start, chord, share);
        start = stop;
        if (!ANY(dot3(off_chord, off_chord) <= reach * reach))
            continue;
        F at = low + (high - low) * share;
        F least = (F)(low), most_u = (F)(high);     // the nearest place lies between
        for (int step = 0; step < CURVE_STEPS; ++step) {
            F3 q = strand_at(s, at);
            F3 slope = strand_slope(s, at);
            F rise = dot3(q, slope);
            F bend = dot3(slope, slope) + dot3(q, strand_bend(s, at));
            least = rise < 0.0f ? at : least;
            most_u = rise < 0.0f ? most_u : at;
            F next = MIN(MAX(at - rise / MAX(bend, (F)(SMALLEST)), least), most_u);
            at = bend > 0.0f ? next : 0.5f * (least + most_u);
        }
        F3 off = strand_at(s, at);
        // Only the ends of the whole curve are round: where a piece ends, the next one may come nearer.
        F3 slope = strand_slope(s, at);
        F amiss = dot3(off, slope);
        I end = k == 0 ? at <= 0.0f : (k == CURVE_PIECES - 1 ? at >= 1.0f : FALSE);
        F half_w = half_width(s, at);
        F limit = STEADY * half_w;
        I steady = amiss * amiss <= limit * limit * dot3(slope, slope);
        I met = (end | steady) & (dot3(off, off) <= half_w * half_w);
        F depth = STRAND_DEPTH(at, met);
        met = met & (depth > (from_curve ? 2.0f * half_w : ZERO)) & (depth < best);
        best = met ? depth : best;
        *u = met ? at : *u;
    }
    return best < NEVER ? best : (F)(-1.0f);
}

#define STARTS_ON_CURVE(origin, kind_end) (((origin) >= (kind_end)[KIND_CURVE - 1]) & ((origin) < (kind_end)[KIND_CURVE]))

// Where a ray hits a curve at t and u along it: then u runs along the whole strand, v across it.
static SurfacePoint point_on_curve(const __global Primitive *p, Ray ray, F t, F u)
{
    Strand s = strand_of(p, ray);
    F3 slope = strand_slope(s, u);
    F w = 1.0f - u;
    F rise = 3.0f * (w * w * (s.z1 - s.z0) + 2.0f * u * w * (s.z2 - s.z1) + u * u * (s.z3 - s.z2));
    F3 tangent = along(slope, ray.d, rise);
    F3 side = cross3(tangent, ray.d);
    F length2 = dot3(side, side);
    F3 other, unused;
    frame(ray.d, &other, &unused);
    side = select3(length2 > 0.0f, scale(side, ONE / sqrt(MAX(length2, (F)(SMALLEST)))), other);
    F across = -dot3(strand_at(s, u), side) / MAX(half_width(s, u), (F)(SMALLEST));
    across = MIN(MAX(across, (F)(-1.0f)), ONE);
    F3 facing = cross3(side, tangent);
    F size2 = dot3(facing, facing);
    facing = select3(size2 > 0.0f, scale(facing, ONE / sqrt(MAX(size2, (F)(SMALLEST)))), scale(ray.d, -ONE));
    int code = -1 - p->emitter;
    int mask = (1 << SPAN_BITS) - 1;
    float begin = (float)(code & mask) / mask, finish = (float)(code >> SPAN_BITS) / mask;
    SurfacePoint point;
    point.p = along(ray.o, ray.d, t);
    point.n = is_ribbon(p) ? facing : add(scale(facing, root(1.0f - across * across)), scale(side, across));
    point.ng = point.n;
    point.u = begin + u * (F)(finish - begin);
    point.v = 0.5f + 0.5f * across;
    point.offset = ZERO;
#if HAS_TANGENT
    point.tangent = tangent;
#endif
#if HAS_BITANGENT
    point.bitangent = side;
#endif
    return point;
}

#endif
