// Where a ray from a film point aims: a point of the plane of the last vertex, and the area density of its choice. The
// choice changes noise only, as a blocked ray weighs zero; every choice holds all rays that pass.
//   PUPIL_CIRCLE    one circle, which a film point at distance r from the axis sees shifted by r * shift
//   PUPIL_BOXES     a box per cell of the film
//   PUPIL_OUTLINES  the true outline, interpolated between nodes: along a film radius (PUPIL_RADIAL), or along lines all
//                   round the axis and between them
// Tables come from rptcam_cl/cameras/pupil.py.
#ifndef PUPIL_H
#define PUPIL_H
#include "common/records.h"
#include "common/transpose.h"

typedef struct { F x, y, inverse_density; } Aim;

#if PUPIL_KIND == PUPIL_CIRCLE
static Aim aim(F fx, F fy, F u, F v, const __global RealisticCamera *own, const __global float *tables)
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

#elif PUPIL_KIND == PUPIL_BOXES
// Tables: u0, v0, width, height per cell
static Aim aim(F fx, F fy, F u, F v, const __global RealisticCamera *own, const __global float *tables)
{
    I ix = TO_I(fx * own->pupil.grid.per_mm_across + 0.5f * own->pupil.grid.across);
    I iy = TO_I(fy * own->pupil.grid.per_mm_down + 0.5f * own->pupil.grid.down);
    ix = MAX(MIN(ix, (I)((int)own->pupil.grid.across - 1)), FALSE);
    iy = MAX(MIN(iy, (I)((int)own->pupil.grid.down - 1)), FALSE);
    I cell = (iy * (int)own->pupil.grid.across + ix) * 4;
    F width = GATHER(F, tables + 2, cell, );
    F height = GATHER(F, tables + 3, cell, );
    Aim a;
    a.x = GATHER(F, tables, cell, ) + u * width;
    a.y = GATHER(F, tables + 1, cell, ) + v * height;
    a.inverse_density = width * height;
    return a;
}

#else
// Tables: per node its centre u, v and half axes u, v, and one node more; then, per node and direction, the radius there,
// in the next direction, and both again at the next node along x.
typedef struct { F u, v, a, b, r; } Outline;

static F blend(F p, F q, F t) { return p + t * (q - p); }

// Between a node and the next one along x.
static Outline outline_at(const __global float *tables, int nodes, I node, F share, I direction, F between)
{
    Eight frames = load_eight(tables, node * 4);
    Eight radii = load_eight(tables + 4 * (nodes + 1), (node * PUPIL_DIRECTIONS + direction) * 4);
    Outline o;
    o.u = blend(frames.f[0], frames.f[4], share);
    o.v = blend(frames.f[1], frames.f[5], share);
    o.a = blend(frames.f[2], frames.f[6], share);
    o.b = blend(frames.f[3], frames.f[7], share);
    o.r = blend(blend(radii.f[0], radii.f[1], between), blend(radii.f[2], radii.f[3], between), share);
    return o;
}

static Aim aim(F fx, F fy, F u, F v, const __global RealisticCamera *own, const __global float *tables)
{
    F turn = u * (float)PUPIL_DIRECTIONS;
    I direction = MIN(TO_I(turn), (I)(PUPIL_DIRECTIONS - 1));
    F between = turn - TO_F(direction);
    F s, c;
    sincos_turns(u, &s, &c);
    F rho = sqrt(v);
    Aim a;
    F radius = sqrt(fx * fx + fy * fy);
    F inverse = ONE / radius;
    F ex = radius > 0.0f ? fx * inverse : ONE;
    F ey = radius > 0.0f ? fy * inverse : ZERO;
#if PUPIL_RADIAL
    F place = radius * own->pupil.grid.per_mm_across;
    I lit = place < own->pupil.grid.across - 1.0f;
    place = MIN(place, (F)(own->pupil.grid.across - 1.0f));
    I node = MIN(TO_I(place), (I)((int)own->pupil.grid.across - 2));
    F share = place - TO_F(node);
    Outline o = outline_at(tables, (int)own->pupil.grid.across, node, share, direction, between);
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
    F sy = along - TO_F(line);
    int all = (lines + 1) * nodes;
    const __global float *reaches = tables + 4 * (all + 1) + 4 * (all * PUPIL_DIRECTIONS + 1);
    F here = GATHER(F, reaches, line, );
    F reach = here + sy * (GATHER(F, reaches + 1, line, ) - here);
    I lit = radius < reach;
    F place = (ONE - sqrt(lit ? ONE - radius / reach : ZERO)) * (float)(nodes - 1);   // nodes grow denser outwards
    I column = MIN(TO_I(place), (I)(nodes - 2));
    F sx = place - TO_F(column);
    I node = line * nodes + column;
    Outline o = outline_at(tables, all, node, sx, direction, between);
    Outline p = outline_at(tables, all, node + nodes, sx, direction, between);
    o.u = blend(o.u, p.u, sy);
    o.v = blend(o.v, p.v, sy);
    o.a = blend(o.a, p.a, sy);
    o.b = blend(o.b, p.b, sy);
    o.r = blend(o.r, p.r, sy);
#endif
    F pu = o.u + o.a * o.r * rho * c;
    F pv = o.v + o.b * o.r * rho * s;
    a.x = ex * pu - ey * pv;
    a.y = ey * pu + ex * pv;
    a.inverse_density = lit ? PI_F * o.a * o.b * o.r * o.r : ZERO;
    return a;
}
#endif

#endif
