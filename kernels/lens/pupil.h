// Where a ray from a film point aims: a point of the plane of the last vertex, and the area density of its choice. The
// choice changes noise only, as a blocked ray weighs zero; every choice holds all rays that pass.
//   PUPIL_CIRCLE    one circle, which a film point at distance r from the axis sees shifted by r * shift
//   PUPIL_BOXES     a box per cell of the film
//   PUPIL_OUTLINES  the true outline, interpolated between nodes: along a film radius (PUPIL_RADIAL) or over the film
// Tables come from rptcam_cl/cameras/pupil.py.
#ifndef PUPIL_H
#define PUPIL_H
#include "common/records.h"
#include "common/transpose.h"

typedef struct { F x, y, inverse_density; } Aim;

#if PUPIL_KIND == PUPIL_CIRCLE
// pupil = (shift, radius)
static Aim aim(F fx, F fy, F u, F v, const __global Camera *camera, const __global float *tables)
{
    F s, c;
    sincos_turns(u, &s, &c);
    F rho = camera->pupil.y * sqrt(v);
    Aim a;
    a.x = camera->pupil.x * fx + rho * c;
    a.y = camera->pupil.x * fy + rho * s;
    a.inverse_density = (F)(PI_F * camera->pupil.y * camera->pupil.y);
    return a;
}

#elif PUPIL_KIND == PUPIL_BOXES
// pupil = (cells per mm across, down, cells across, down); tables = u0, v0, width, height per cell
static Aim aim(F fx, F fy, F u, F v, const __global Camera *camera, const __global float *tables)
{
    I ix = TO_I(fx * camera->pupil.x + 0.5f * camera->pupil.z);
    I iy = TO_I(fy * camera->pupil.y + 0.5f * camera->pupil.w);
    ix = MAX(MIN(ix, (I)((int)camera->pupil.z - 1)), FALSE);
    iy = MAX(MIN(iy, (I)((int)camera->pupil.w - 1)), FALSE);
    I cell = (iy * (int)camera->pupil.z + ix) * 4;
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

// pupil = (nodes per mm across, down, nodes across, down)
static Aim aim(F fx, F fy, F u, F v, const __global Camera *camera, const __global float *tables)
{
    F turn = u * (float)PUPIL_DIRECTIONS;
    I direction = MIN(TO_I(turn), (I)(PUPIL_DIRECTIONS - 1));
    F between = turn - TO_F(direction);
    F s, c;
    sincos_turns(u, &s, &c);
    F rho = sqrt(v);
    Aim a;
#if PUPIL_RADIAL
    F radius = sqrt(fx * fx + fy * fy);
    F inverse = ONE / radius;
    F ex = radius > 0.0f ? fx * inverse : ONE;
    F ey = radius > 0.0f ? fy * inverse : ZERO;
    F place = radius * camera->pupil.x;
    I lit = place < camera->pupil.z - 1.0f;
    place = MIN(place, (F)(camera->pupil.z - 1.0f));
    I node = MIN(TO_I(place), (I)((int)camera->pupil.z - 2));
    F share = place - TO_F(node);
    Outline o = outline_at(tables, (int)camera->pupil.z, node, share, direction, between);
    F pu = o.u + o.a * o.r * rho * c;
    F pv = o.v + o.b * o.r * rho * s;
    a.x = ex * pu - ey * pv;
    a.y = ey * pu + ex * pv;
    a.inverse_density = lit ? PI_F * o.a * o.b * o.r * o.r : ZERO;
#else
    F px = MAX(fx * camera->pupil.x + 0.5f * (camera->pupil.z - 1.0f), ZERO);
    F py = MAX(fy * camera->pupil.y + 0.5f * (camera->pupil.w - 1.0f), ZERO);
    I nx = MIN(TO_I(px), (I)((int)camera->pupil.z - 2));
    I ny = MIN(TO_I(py), (I)((int)camera->pupil.w - 2));
    F sx = px - TO_F(nx);
    F sy = py - TO_F(ny);
    I node = ny * (int)camera->pupil.z + nx;
    int nodes = (int)(camera->pupil.z * camera->pupil.w);
    Outline o = outline_at(tables, nodes, node, sx, direction, between);
    Outline p = outline_at(tables, nodes, node + (int)camera->pupil.z, sx, direction, between);
    o.u = blend(o.u, p.u, sy);
    o.v = blend(o.v, p.v, sy);
    o.a = blend(o.a, p.a, sy);
    o.b = blend(o.b, p.b, sy);
    o.r = blend(o.r, p.r, sy);
    a.x = o.u + o.a * o.r * rho * c;
    a.y = o.v + o.b * o.r * rho * s;
    a.inverse_density = PI_F * o.a * o.b * o.r * o.r;
#endif
    return a;
}
#endif

#endif
