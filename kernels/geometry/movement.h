// Objects that move. Every record of a moving primitive or mesh says where it is when the shutter opens, at rest; a ray is
// taken there from its own time, meets it, and the point comes back to the world.
// movement_of[primitive] = (first segment, number of segments), none for what stands still. A segment is the way between
// two moments: x = pivot + shift + s travel + turn by s turns about the axis, of the turn so far, of (x at rest - pivot),
// with s from 0 to 1 (rptcam_cl/rendering/plan/geometry.py).
// Facts: HAS_MOTION, MOTION_SEGMENTS (1 where no object has more than one segment, else 2), MOTION_TURNS.
#ifndef MOVEMENT_H
#define MOVEMENT_H
#include "common/scene.h"
#include "geometry/hit.h"
#include "geometry/surface.h"

#if HAS_MOTION
typedef struct {
    F3 shift;
#if MOTION_TURNS
    F3 pivot;
    F3 v;           // of a unit quaternion
    F  w;
#endif
} Placing;

static inline int moves(int primitive, Scene scene) { return scene.movement_of[primitive].y > 0; }

#if MOTION_SEGMENTS == 1
#define OF_SEGMENT_HERE(member)   ((F)(segments->member))
#else
#define OF_SEGMENT_HERE(member)   GATHER(F, segments, segment, .member)
#endif
#define ROW_OF_SEGMENT_HERE(row)  f3(OF_SEGMENT_HERE(row.x), OF_SEGMENT_HERE(row.y), OF_SEGMENT_HERE(row.z))

// Where a primitive that moves is at the times of the lanes.
static Placing placing_of(int primitive, F time, Scene scene)
{
    int2 movement = scene.movement_of[primitive];
    const __global Segment *segments = scene.segments + movement.x;
#if MOTION_SEGMENTS > 1
    I segment = FALSE;
    for (int next = 1; next < movement.y; ++next)
        segment = time >= segments[next].pivot.w ? (I)(next) : segment;
#endif
    F share = (time - OF_SEGMENT_HERE(pivot.w)) * OF_SEGMENT_HERE(shift.w);
    Placing p;
    p.shift = along(ROW_OF_SEGMENT_HERE(shift), ROW_OF_SEGMENT_HERE(travel), share);
#if MOTION_TURNS
    p.pivot = ROW_OF_SEGMENT_HERE(pivot);
    F half_turns = 0.5f * share * OF_SEGMENT_HERE(travel.w);
    F sine, cosine;
    sincos_turns(half_turns - FLOOR(half_turns), &sine, &cosine);
    F near_one = 1.5f - 0.5f * (sine * sine + cosine * cosine);     // a step of Newton's to unit length
    p.v = scale(ROW_OF_SEGMENT_HERE(axis), sine * near_one);
    p.w = cosine * near_one;
#if MOTION_SEGMENTS > 1
    F3 before = ROW_OF_SEGMENT_HERE(turn);
    F w = OF_SEGMENT_HERE(turn.w);
    F3 v = add(add(scale(before, p.w), scale(p.v, w)), cross3(p.v, before));
    p.w = p.w * w - dot3(p.v, before);
    p.v = v;
#endif
#endif
    return p;
}

#if MOTION_TURNS
static inline F3 turned(F3 v, F w, F3 x)
{
    F3 t = scale(cross3(v, x), (F)(2.0f));
    return add(along(x, t, w), cross3(v, t));
}

static inline F3 vector_at_rest(Placing p, F3 d)   { return turned(scale(p.v, (F)(-1.0f)), p.w, d); }
static inline F3 vector_in_world(Placing p, F3 d)  { return turned(p.v, p.w, d); }
static inline F3 point_at_rest(Placing p, F3 x)
{
    return add(p.pivot, vector_at_rest(p, sub(sub(x, p.shift), p.pivot)));
}
static inline F3 point_in_world(Placing p, F3 x)
{
    return add(add(vector_in_world(p, sub(x, p.pivot)), p.pivot), p.shift);
}
#else
static inline F3 vector_at_rest(Placing p, F3 d)   { return d; }
static inline F3 vector_in_world(Placing p, F3 d)  { return d; }
static inline F3 point_at_rest(Placing p, F3 x)    { return sub(x, p.shift); }
static inline F3 point_in_world(Placing p, F3 x)   { return add(x, p.shift); }
#endif

static inline Ray ray_at_rest(Ray ray, int primitive, Scene scene)
{
    if (moves(primitive, scene)) {
        Placing placing = placing_of(primitive, ray.time, scene);
        ray.o = point_at_rest(placing, ray.o);
        ray.d = vector_at_rest(placing, ray.d);
    }
    return ray;
}

static inline F size_of(F3 v) { return absolute(v.x) + absolute(v.y) + absolute(v.z); }

static SurfacePoint surface_in_world(Placing placing, SurfacePoint s)
{
    F size = size_of(s.p) + size_of(placing.shift);
#if MOTION_TURNS
    size += size_of(placing.pivot) + size_of(sub(s.p, placing.pivot));
#endif
    s.p = point_in_world(placing, s.p);
    s.n = vector_in_world(placing, s.n);
    s.ng = vector_in_world(placing, s.ng);
#if HAS_TANGENT
    s.tangent = vector_in_world(placing, s.tangent);
#endif
#if HAS_BITANGENT
    s.bitangent = vector_in_world(placing, s.bitangent);
#endif
    s.offset += MOTION_ROUNDING * size;
    return s;
}

#define RAY_AT_REST(ray, primitive) ray_at_rest(ray, primitive, scene)
#else
#define RAY_AT_REST(ray, primitive) (ray)
#endif

#endif
