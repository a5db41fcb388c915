// Where a ray from a film point aims: a point of the plane of the last vertex, and the area density of its choice. The
// choice changes noise only, as a blocked ray weighs zero; every choice holds all rays that pass.
//   PUPIL_CIRCLE    one circle, which a film point at distance r from the axis sees shifted by r * shift
//   PUPIL_BOXES     a box per cell of the film
//   PUPIL_OUTLINES  the true outline, interpolated between nodes: along a film radius (PUPIL_RADIAL) or over the film
// Tables come from rptcam_cl/cameras/pupil.py.
#ifndef PUPIL_H
#define PUPIL_H
#include "common/records.h"

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
// A node: centre u, v, half axes u, v, then the radius in PUPIL_DIRECTIONS directions and again the first.
#define NODE_FLOATS (4 + PUPIL_DIRECTIONS + 1)

typedef struct { F u, v, a, b, r; } Outline;

static Outline outline_at(const __global float *tables, I node, I direction, F between)
{
    I at = node * NODE_FLOATS;
    Outline o;
    o.u = GATHER(F, tables, at, );
    o.v = GATHER(F, tables + 1, at, );
    o.a = GATHER(F, tables + 2, at, );
    o.b = GATHER(F, tables + 3, at, );
    F r0 = GATHER(F, tables + 4, at + direction, );
    F r1 = GATHER(F, tables + 5, at + direction, );
    o.r = r0 + between * (r1 - r0);
    return o;
}

static Outline mix_outlines(Outline p, Outline q, F t)
{
    Outline o;
    o.u = p.u + t * (q.u - p.u);
    o.v = p.v + t * (q.v - p.v);
    o.a = p.a + t * (q.a - p.a);
    o.b = p.b + t * (q.b - p.b);
    o.r = p.r + t * (q.r - p.r);
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
    F ex = radius > 0.0f ? fx / radius : ONE;
    F ey = radius > 0.0f ? fy / radius : ZERO;
    F place = radius * camera->pupil.x;
    I lit = place < camera->pupil.z - 1.0f;
    place = MIN(place, (F)(camera->pupil.z - 1.0f));
    I node = MIN(TO_I(place), (I)((int)camera->pupil.z - 2));
    F share = place - TO_F(node);
    Outline o = mix_outlines(outline_at(tables, node, direction, between),
                             outline_at(tables, node + 1, direction, between), share);
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
    I below = node + (int)camera->pupil.z;
    Outline o = mix_outlines(
        mix_outlines(outline_at(tables, node, direction, between), outline_at(tables, node + 1, direction, between), sx),
        mix_outlines(outline_at(tables, below, direction, between), outline_at(tables, below + 1, direction, between), sx),
        sy);
    a.x = o.u + o.a * o.r * rho * c;
    a.y = o.v + o.b * o.r * rho * s;
    a.inverse_density = PI_F * o.a * o.b * o.r * o.r;
#endif
    return a;
}
#endif

#endif
