// A ray through every surface of a lens, in order of travel. Coordinates in millimetres, z along the direction of travel
// and relative to the vertex of the current surface. Snell's law is exact in vector form. A ray that fails keeps the
// state in which it failed. Facts: those of lens/surface.h, and LENS_POSE.
#ifndef LENS_TRACE_H
#define LENS_TRACE_H
#include "lens/surface.h"

typedef struct {
    F3 p;         // on the last surface that it met, relative to its vertex
    F3 d;         // unit
    I  passed;
    I  status;    // RAY_…
    I  surface;   // where it failed, in order of travel; -1 when it passed
} LensRay;

#if LENS_POSE
static F3 turned(const __global real *m, F3 v)
{
    return f3(m[0] * v.x + m[1] * v.y + m[2] * v.z, m[3] * v.x + m[4] * v.y + m[5] * v.z,
              m[6] * v.x + m[7] * v.y + m[8] * v.z);
}

static F3 turned_back(const __global real *m, F3 v)
{
    return f3(m[0] * v.x + m[3] * v.y + m[6] * v.z, m[1] * v.x + m[4] * v.y + m[7] * v.z,
              m[2] * v.x + m[5] * v.y + m[8] * v.z);
}

static F3 offset_of(const __global Surface *s) { return f3((F)(s->offset[0]), (F)(s->offset[1]), (F)(s->offset[2])); }
#endif

// Direction after a surface by Snell's law, and whether the ray is bent and not totally reflected.
static F3 refracted(F3 d, F3 n, F cosine, real eta, I *bends)
{
    F3 along_surface = scale(along(d, n, -cosine), eta);       // formed first: 1 - cosine^2 would lose it near grazing
    F cosine2_after = 1.0f - dot3(along_surface, along_surface);
    *bends = cosine2_after > CRITICAL;
    return along(along_surface, n, root(cosine2_after));
}

// `stop` holds the shape of the stop, where it has one: edges of an outline or cells of a mask.
static LensRay trace_lens(F3 p, F3 d, const __global Surface *surfaces, int count, const __global real *stop)
{
    LensRay ray;
    ray.p = p;
    ray.d = d;
    ray.passed = TRUE;
    ray.status = (I)(RAY_OK);
    ray.surface = (I)(-1);
#if LENS_REGION
    I beside = FALSE;          // lanes that pass beside the half lens at hand
#endif
    for (int k = 0; k < count; ++k) {
        const __global Surface *s = surfaces + k;
        p.z -= s->gap;
        F3 q = p;
        F3 v = d;
#if LENS_POSE
        if (s->posed) {
            q = turned_back(s->rotation, sub(p, offset_of(s)));
            v = turned_back(s->rotation, d);
        }
#endif
        LensHit hit = meet_surface(s, q, v);
        I met = hit.met & (v.z > 0.0f);
        I within = within_rim(s, stop, hit.p);
#if LENS_REGION
        I outside = NOT(within_region(s, hit.p));
        if (s->region == REGION_BLOCKS)
            within = within & NOT(outside);
        if (s->region == REGION_GOES_ON)
            within = within & NOT(outside ^ beside);           // neither in nor out through the cut face
        else
            beside = s->region == REGION_OPENS ? outside : FALSE;
#endif
        F3 bent = v;
        I bends = TRUE;
        if (s->eta != 1.0f)
            bent = refracted(v, hit.n, hit.cosine, s->eta, &bends);
#if LENS_REGION
        bent = select3(beside, v, bent);
        bends = bends | beside;
#endif
        I stops = ray.passed & NOT(met & within & bends);
        if (ANY(stops)) {                                      // rare where rays aim at the pupil
            I reason = met ? (within ? (I)(RAY_TOTAL_INTERNAL_REFLECTION) : (I)(RAY_CLIPPED)) : (I)(RAY_MISSED);
#if LENS_GENERAL
            reason = hit.settled ? reason : (I)(RAY_NO_CONVERGENCE);
#endif
            ray.status = stops ? reason : ray.status;
            ray.surface = stops ? (I)(k) : ray.surface;
        }
        p = hit.p;
        d = bent;
#if LENS_POSE
        if (s->posed) {
            p = add(turned(s->rotation, hit.p), offset_of(s));
            d = turned(s->rotation, bent);
        }
#endif
#if LENS_KEEP_FAILED
        ray.p = f3(ray.p.x, ray.p.y, ray.p.z - s->gap);
        ray.p = select3(ray.passed & met, p, ray.p);
        ray.d = select3(ray.passed & NOT(stops), d, ray.d);
#endif
        ray.passed = ray.passed & NOT(stops);
    }
#if !LENS_KEEP_FAILED
    ray.p = p;
    ray.d = d;
#endif
    ray.d = normalized(ray.d);
    return ray;
}

#endif
