// A lens without aberrations: every ray of a film point leaves it towards the point of the scene that is sharp there. Where
// the ray leaves, and what it weighs, stay those of the lens. `camera->conjugates` says where these points stand among the
// tables: homogeneous, in the camera's frame [m], at STIGMATIC nodes across the film and as many down. The way to a point is
// as long as the share of the aberrations that the ray is to be without (rptcam_cl/rendering/point_waves.py).
// Fact: STIGMATIC, how many nodes; 0 for the rays of the lens.
#ifndef STIGMATIC_H
#define STIGMATIC_H
#include "common/records.h"
#include "common/transpose.h"

#if STIGMATIC
// Which node comes before a place from -1 to 1, and the share of the way to the next.
static inline I node_before(F place, F *share)
{
    F nodes = (place + 1.0f) * (0.5f * (STIGMATIC - 1));
    I node = MAX(MIN(TO_I(nodes), (I)(STIGMATIC - 2)), FALSE);
    *share = nodes - TO_F(node);
    return node;
}

// `o` and `d` of the ray of a film point [mm] as it leaves the lens.
static F3 towards_conjugate(F fx, F fy, F3 o, F3 d, const __global Camera *camera, const __global float *tables)
{
    const __global float *points = tables + camera->conjugates;
    F across, down, at[4];
    I column = node_before(-fx / camera->own.realistic.film_half_width, &across);
    I row = node_before(-fy / camera->own.realistic.film_half_height, &down);
    Eight low = load_eight(points, (row * STIGMATIC + column) * 4);
    Eight high = load_eight(points, ((row + 1) * STIGMATIC + column) * 4);
#pragma unroll
    for (int k = 0; k < 4; ++k) {
        F near = low.f[k] + across * (low.f[k + 4] - low.f[k]);
        F far = high.f[k] + across * (high.f[k + 4] - high.f[k]);
        at[k] = near + down * (far - near);
    }
    F3 way = f3(at[0] - at[3] * o.x, at[1] - at[3] * o.y, at[2] - at[3] * o.z);
    F3 mixed = add(way, scale(d, MAX(ONE - sqrt(dot3(way, way)), ZERO)));
    return scale(mixed, ONE / sqrt(dot3(mixed, mixed)));
}
#endif

#endif
