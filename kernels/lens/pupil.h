// Where a ray from a film point aims: a point of the plane of the last vertex, and the area density of its choice. The
// choice changes noise only, as a blocked ray weighs zero; every choice holds all rays that pass.
//   PUPIL_CIRCLE    one circle, which a film point at distance r from the axis sees shifted by r * shift
//   PUPIL_BOXES     a box per cell of the film
//   PUPIL_OUTLINES  the true outline, interpolated between nodes: along a film radius (PUPIL_RADIAL), or along lines all
//                   round the axis and between them; PUPIL_RING, with a hole in the middle, where the lens is obstructed,
//                   and directions drawn by area, as a crescent has most of it on one side
// Tables come from rptcam_cl/rendering/cameras/pupil.py.
#ifndef PUPIL_H
#define PUPIL_H
#include "common/records.h"
#include "common/transpose.h"
#if LAMP_AIM
#include "common/angles.h"
#endif

typedef struct { F x, y, inverse_density; } Aim;

#if PUPIL_KIND == PUPIL_CIRCLE
static inline Aim aim(F fx, F fy, F u, F v, const __global RealisticCamera *own, const __global float *tables)
{
    F s, c;
    sincos_turns(u, &s, &c);
    F rho = own->pupil.circle.radius * sqrt(v);
    Aim a;
    a.x = own->pupil.circle.shift * fx + rho * c;
    a.y = own->pupil.circle.shift * fy + rho * s;
    a.inverse_density = (F)(PI_F * own->pupil.circle.radius * own->pupil.circle.radius);
    return a;
}

#if LAMP_AIM
static inline F inverse_density_at(F fx, F fy, F x, F y, const __global RealisticCamera *own, const __global float *tables)
{
    float radius2 = own->pupil.circle.radius * own->pupil.circle.radius;
    F u = x - own->pupil.circle.shift * fx;
    F v = y - own->pupil.circle.shift * fy;
    return u * u + v * v < radius2 ? (F)(PI_F * radius2) : ZERO;
}
#endif

#elif PUPIL_KIND == PUPIL_BOXES
// Tables: u0, v0, width, height per cell
static inline I box_of(F fx, F fy, const __global RealisticCamera *own)
{
    I ix = TO_I(fx * own->pupil.grid.per_mm_across + 0.5f * own->pupil.grid.across);
    I iy = TO_I(fy * own->pupil.grid.per_mm_down + 0.5f * own->pupil.grid.down);
    ix = MAX(MIN(ix, (I)((int)own->pupil.grid.across - 1)), FALSE);
    iy = MAX(MIN(iy, (I)((int)own->pupil.grid.down - 1)), FALSE);
    return (iy * (int)own->pupil.grid.across + ix) * 4;
}

static inline Aim aim(F fx, F fy, F u, F v, const __global RealisticCamera *own, const __global float *tables)
{
    I cell = box_of(fx, fy, own);
    F width = GATHER(F, tables + 2, cell, );
    F height = GATHER(F, tables + 3, cell, );
    Aim a;
    a.x = GATHER(F, tables, cell, ) + u * width;
    a.y = GATHER(F, tables + 1, cell, ) + v * height;
    a.inverse_density = width * height;
    return a;
}

#if LAMP_AIM
static inline F inverse_density_at(F fx, F fy, F x, F y, const __global RealisticCamera *own, const __global float *tables)
{
    I cell = box_of(fx, fy, own);
    F width = GATHER(F, tables + 2, cell, );
    F height = GATHER(F, tables + 3, cell, );
    F u = x - GATHER(F, tables, cell, );
    F v = y - GATHER(F, tables + 1, cell, );
    return ((u >= 0.0f) & (u < width) & (v >= 0.0f) & (v < height)) ? width * height : ZERO;
}
#endif

#else
// Tables: per node its centre u, v and half axes u, v, and one node more; then, per node and direction, the radius there,
// in the next direction, and both again at the next node along x; the same of the hole, if they have one, and of the
// direction [turns] up to which each share of the area lies.
typedef struct {
    F u, v, a, b, r;
#if PUPIL_RING
    F hole;
#endif
} Outline;

static inline F midway(F p, F q, F t) { return p + t * (q - p); }

// The numbers in a table of radii, of holes or of shares of the area.
#define TABLE_SIZE(nodes) (4 * ((nodes) * PUPIL_DIRECTIONS + 1))

// Between a node and the next one along x.
static Outline outline_at(const __global float *tables, int nodes, I node, F share, I direction, F between)
{
    Eight frames = load_eight(tables, node * 4);
    Eight radii = load_eight(tables + 4 * (nodes + 1), (node * PUPIL_DIRECTIONS + direction) * 4);
    Outline o;
    o.u = midway(frames.f[0], frames.f[4], share);
    o.v = midway(frames.f[1], frames.f[5], share);
    o.a = midway(frames.f[2], frames.f[6], share);
    o.b = midway(frames.f[3], frames.f[7], share);
    o.r = midway(midway(radii.f[0], radii.f[1], between), midway(radii.f[2], radii.f[3], between), share);
#if PUPIL_RING
    const __global float *holes = tables + 4 * (nodes + 1) + TABLE_SIZE(nodes);
    radii = load_eight(holes, (node * PUPIL_DIRECTIONS + direction) * 4);
    o.hole = midway(midway(radii.f[0], radii.f[1], between), midway(radii.f[2], radii.f[3], between), share);
#endif
    return o;
}

// Where the outline that a film point sees stands in the table.
typedef struct {
    F ex, ey;        // from the axis to the film point
    I node, lit;
    F sx, sy;        // share of the way to the next node, and to the next line
} OutlinePlace;

static OutlinePlace outline_place(F fx, F fy, const __global RealisticCamera *own, const __global float *tables)
{
    OutlinePlace p;
    F radius = sqrt(fx * fx + fy * fy);
    F inverse = ONE / radius;
    p.ex = radius > 0.0f ? fx * inverse : ONE;
    p.ey = radius > 0.0f ? fy * inverse : ZERO;
#if PUPIL_RADIAL
    F place = radius * own->pupil.grid.per_mm_across;
    p.lit = place < own->pupil.grid.across - 1.0f;
    place = MIN(place, (F)(own->pupil.grid.across - 1.0f));
    p.node = MIN(TO_I(place), (I)((int)own->pupil.grid.across - 2));
    p.sx = place - TO_F(p.node);
    p.sy = ZERO;
#else
    // Places round the axis go evenly along the square |x| + |y| = 1, four to a turn.
    F length = absolute(fx) + absolute(fy);
    F quarters = length > 0.0f ? fy / length : ZERO;
    quarters = fx >= 0.0f ? quarters : 2.0f - quarters;
    quarters = quarters < 0.0f ? quarters + 4.0f : quarters;
    int nodes = (int)own->pupil.lines.nodes;
    int lines = (int)own->pupil.lines.lines;
    F along = quarters * own->pupil.lines.per_quarter;
    I line = MIN(TO_I(along), (I)(lines - 1));
    p.sy = along - TO_F(line);
    int all = (lines + 1) * nodes;
    const __global float *reaches = tables + 4 * (all + 1) + (1 + 2 * PUPIL_RING) * TABLE_SIZE(all);
    F here = GATHER(F, reaches, line, );
    F reach = here + p.sy * (GATHER(F, reaches + 1, line, ) - here);
    p.lit = radius < reach;
    F place = (ONE - sqrt(p.lit ? ONE - radius / reach : ZERO)) * (float)(nodes - 1);   // nodes grow denser outwards
    I column = MIN(TO_I(place), (I)(nodes - 2));
    p.sx = place - TO_F(column);
    p.node = line * nodes + column;
#endif
    return p;
}

static Outline outline_near(const __global float *tables, OutlinePlace at, const __global RealisticCamera *own, I direction,
                            F between)
{
#if PUPIL_RADIAL
    return outline_at(tables, (int)own->pupil.grid.across, at.node, at.sx, direction, between);
#else
    int nodes = (int)own->pupil.lines.nodes;
    int all = ((int)own->pupil.lines.lines + 1) * nodes;
    Outline o = outline_at(tables, all, at.node, at.sx, direction, between);
    Outline p = outline_at(tables, all, at.node + nodes, at.sx, direction, between);
    o.u = midway(o.u, p.u, at.sy);
    o.v = midway(o.v, p.v, at.sy);
    o.a = midway(o.a, p.a, at.sy);
    o.b = midway(o.b, p.b, at.sy);
    o.r = midway(o.r, p.r, at.sy);
#if PUPIL_RING
    o.hole = midway(o.hole, p.hole, at.sy);
#endif
    return o;
#endif
}

#if PUPIL_RING
// The share of an outline's area that its hole takes.
static inline F hole_of(Outline o)
{
    F share = o.r > 0.0f ? o.hole / o.r : ZERO;
    return share * share;
}

typedef struct { F here, ahead; } Knots;

static inline Knots knots_at(const __global float *tables, int nodes, I node, F share, I knot)
{
    Eight turns = load_eight(tables + 4 * (nodes + 1) + 2 * TABLE_SIZE(nodes), (node * PUPIL_DIRECTIONS + knot) * 4);
    Knots k;
    k.here = midway(turns.f[0], turns.f[2], share);
    k.ahead = midway(turns.f[1], turns.f[3], share);
    return k;
}

// The directions [turns] up to which `knot` and one more of PUPIL_DIRECTIONS equal shares of the area lie.
static inline Knots knots_near(const __global float *tables, OutlinePlace at, const __global RealisticCamera *own, I knot)
{
#if PUPIL_RADIAL
    return knots_at(tables, (int)own->pupil.grid.across, at.node, at.sx, knot);
#else
    int nodes = (int)own->pupil.lines.nodes;
    int all = ((int)own->pupil.lines.lines + 1) * nodes;
    Knots k = knots_at(tables, all, at.node, at.sx, knot);
    Knots next = knots_at(tables, all, at.node + nodes, at.sx, knot);
    k.here = midway(k.here, next.here, at.sy);
    k.ahead = midway(k.ahead, next.ahead, at.sy);
    return k;
#endif
}
#endif

static Aim aim(F fx, F fy, F u, F v, const __global RealisticCamera *own, const __global float *tables)
{
    OutlinePlace p = outline_place(fx, fy, own, tables);
    F turn = u * (float)PUPIL_DIRECTIONS;
    I direction = MIN(TO_I(turn), (I)(PUPIL_DIRECTIONS - 1));
#if PUPIL_RING
    Knots knots = knots_near(tables, p, own, direction);
    u = midway(knots.here, knots.ahead, turn - TO_F(direction));
    turn = u * (float)PUPIL_DIRECTIONS;
    direction = MIN(TO_I(turn), (I)(PUPIL_DIRECTIONS - 1));
#endif
    F between = turn - TO_F(direction);
    F s, c;
    sincos_turns(u, &s, &c);
    Outline o = outline_near(tables, p, own, direction, between);
    I lit = p.lit;
#if PUPIL_RING
    F hole = hole_of(o);
    F rho = sqrt(hole + v * (ONE - hole));
#else
    F rho = sqrt(v);
#endif
    Aim a;
    F pu = o.u + o.a * o.r * rho * c;
    F pv = o.v + o.b * o.r * rho * s;
    a.x = p.ex * pu - p.ey * pv;
    a.y = p.ey * pu + p.ex * pv;
    a.inverse_density = lit ? PI_F * o.a * o.b * o.r * o.r : ZERO;
#if PUPIL_RING
    a.inverse_density *= (ONE - hole) * (knots.ahead - knots.here) * (float)PUPIL_DIRECTIONS;
#endif
    return a;
}

#if LAMP_AIM
// A place's direction in the outline gives the radius there; 0 outside.
static inline F inverse_density_at(F fx, F fy, F x, F y, const __global RealisticCamera *own, const __global float *tables)
{
    OutlinePlace p = outline_place(fx, fy, own, tables);
    Outline o = outline_near(tables, p, own, FALSE, ZERO);
    F u = (p.ex * x + p.ey * y - o.u) / o.a;
    F v = (p.ex * y - p.ey * x - o.v) / o.b;
    F turn = turns_around(u, v) * (float)PUPIL_DIRECTIONS;
    I direction = MIN(TO_I(turn), (I)(PUPIL_DIRECTIONS - 1));
    o = outline_near(tables, p, own, direction, turn - TO_F(direction));
#if PUPIL_RING
    I knot = FALSE;
    for (int step = PUPIL_DIRECTIONS / 2; step > 0; step /= 2)
        knot += knots_near(tables, p, own, knot + step).here * (float)PUPIL_DIRECTIONS <= turn ? (I)(step) : FALSE;
    Knots knots = knots_near(tables, p, own, knot);
    F r2 = u * u + v * v, slope = (knots.ahead - knots.here) * (float)PUPIL_DIRECTIONS;
    I open = (turn >= knots.here * (float)PUPIL_DIRECTIONS) & (turn <= knots.ahead * (float)PUPIL_DIRECTIONS);
    return (p.lit & open & (r2 < o.r * o.r) & (r2 >= o.hole * o.hole))
           ? PI_F * o.a * o.b * o.r * o.r * (ONE - hole_of(o)) * slope : ZERO;
#else
    return (p.lit & (u * u + v * v < o.r * o.r)) ? PI_F * o.a * o.b * o.r * o.r : ZERO;
#endif
}
#endif
#endif

#endif
