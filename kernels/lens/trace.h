// A ray through every surface of a lens, in order of travel. Coordinates in millimetres, z along the direction of travel
// and relative to the vertex of the current surface. Snell's law is exact in vector form. A ray that fails keeps the
// state in which it failed. A mirror turns z round, so that it runs along the travel behind it as well. Facts: those of
// lens/surface.h, LENS_POSE, LENS_MIRROR, LENS_POLARISED, and LENS_DISPERSION: how many coefficients give the
// ratio of the indices at a wavelength, 0 where one ratio holds for all rays; those of lens/coating.h.
#ifndef LENS_TRACE_H
#define LENS_TRACE_H
#include "lens/surface.h"
#define LENS_LOSSES (LENS_FRESNEL || LENS_ABSORPTION)
#if LENS_LOSSES
#include "common/exponential.h"
#include "lens/coating.h"
#endif
#if LENS_POLARISED
#include "lens/polarised.h"
#endif

typedef struct {
    F3 p;         // on the last surface that it met, relative to its vertex
    F3 d;         // unit
    I  passed;
    I  status;    // RAY_…
    I  surface;   // where it failed, in order of travel; -1 when it passed
#if LENS_LOSSES
    F  transmittance;
#endif
} LensRay;

#if LENS_POSE
static inline F3 turned_to(const __global real *m, F3 v)
{
    return f3(m[0] * v.x + m[1] * v.y + m[2] * v.z, m[3] * v.x + m[4] * v.y + m[5] * v.z,
              m[6] * v.x + m[7] * v.y + m[8] * v.z);
}

static inline F3 turned_back(const __global real *m, F3 v)
{
    return f3(m[0] * v.x + m[3] * v.y + m[6] * v.z, m[1] * v.x + m[4] * v.y + m[7] * v.z,
              m[2] * v.x + m[5] * v.y + m[8] * v.z);
}

static inline F3 offset_of(const __global Surface *s) { return f3((F)(s->offset[0]), (F)(s->offset[1]), (F)(s->offset[2])); }
#endif

#define NEAR_CRITICAL 0.1f     // of cosine^2 behind a surface

// Direction after a surface by Snell's law, its cosine, and whether the ray is bent and not totally reflected.
// 1 - eta^2 (1 - cosine^2) is known before the hit point, so that its root is taken beside the division for that. It is
// wrong by eta^2 roundings, which weigh more as the critical angle comes near; there the part along the surface comes first.
static F3 refracted(F3 d, LensHit hit, F eta, Kept wanted, F *cosine_after, I *bends)
{
    F cosine2_after = (1.0f - eta) * (1.0f + eta) + eta * eta * hit.cosine2;
    F after = root(cosine2_after);
    F3 bent = along(scale(d, eta), hit.n, after - eta * hit.cosine);
    I near_critical = cosine2_after < NEAR_CRITICAL;
    if (ANY_KEPT(wanted & KEPT(near_critical))) {
        F3 along_surface = along(bent, hit.n, -dot3(bent, hit.n));
        F precise2 = 1.0f - dot3(along_surface, along_surface);
        F precise = root(precise2);
        cosine2_after = near_critical ? precise2 : cosine2_after;
        after = near_critical ? precise : after;
        bent = select3(near_critical, along(along_surface, hit.n, precise), bent);
    }
    *bends = cosine2_after > CRITICAL;
    *cosine_after = after;
    return bent;
}

#if LENS_DISPERSION
// Index before a surface over index after it, as a polynomial in the inverse wavelength, scaled to -1 … 1.
static F eta_of(const __global Surface *s, F x)
{
    F eta = (F)(s->dispersion[LENS_DISPERSION - 1]);
    for (int i = LENS_DISPERSION - 2; i >= 0; --i)
        eta = eta * x + s->dispersion[i];
    return eta;
}
#endif

// A ray on its way. Lanes that have failed go on for nothing; masks remember why, and a count how far they came.
typedef struct {
    F3   p, d;
    Kept passed, missed, clipped;
    I    crossed;      // surfaces behind the ray
#if LENS_DISPERSION
    F  colour;       // inverse wavelength, as eta_of takes it
#endif
#if LENS_LOSSES
    F  wavelength;   // [nm]
    F  share;        // of the light that surfaces have left
    F  depth;        // optical depth of the glass behind the ray
#endif
#if LENS_GENERAL
    Kept undecided;
#endif
#if LENS_REGION
    I  beside;       // lanes that pass beside the half lens at hand
#endif
#if LENS_POLARISED
    Polarisation light;
#endif
#if LENS_KEEP_FAILED
    F3 stopped_p, stopped_d;
#endif
} LensPath;

// From a point on the plane of the first vertex, or near it. `wavelength` in nanometres.
static LensPath enter_lens(F3 p, F3 d, F wavelength)
{
    LensPath path;
    path.p = p;
    path.d = d;
    path.passed = KEPT(TRUE);
#if LENS_DISPERSION
    path.colour = DISPERSION_SCALE / wavelength - DISPERSION_SHIFT;
#endif
#if LENS_LOSSES
    path.wavelength = wavelength;
    path.share = ONE;
    path.depth = ZERO;
#endif
    path.missed = path.clipped = KEPT(FALSE);
    path.crossed = FALSE;
#if LENS_GENERAL
    path.undecided = KEPT(FALSE);
#endif
#if LENS_REGION
    path.beside = FALSE;
#endif
#if LENS_POLARISED
    path.light = unpolarised(d);
#endif
#if LENS_KEEP_FAILED
    path.stopped_p = p;
    path.stopped_d = d;
#endif
    return path;
}

// Returns the direction of what a surface lets through, or a mirror reflects, and which lanes it does not reflect totally;
// takes from their shares what is lost. `v` and `hit` are in the frame of the surface.
IN_PLACE static F3 bent_by(LensPath *path, const __global Surface *s, const __global real *stop, F3 v, LensHit hit, I *bends)
{
    F3 bent = v;
    *bends = TRUE;
#if LENS_MIRROR
    if (s->refracts < 0.0f) {
        bent = along(v, hit.n, -2.0f * hit.cosine);
#if LENS_FRESNEL
        path->share *= over_wavelength(s->gain, s->gain_table, stop, path->wavelength);
#endif
    } else
#endif
    if (s->refracts != 0.0f) {
#if LENS_DISPERSION
        F eta = eta_of(s, path->colour);
#else
        F eta = (F)(s->eta);
#endif
        F cosine_after;
        bent = refracted(v, hit, eta, path->passed, &cosine_after, bends);
#if LENS_FRESNEL
        F share = surface_share(s, stop, path->wavelength, eta, hit.cosine, cosine_after);
#if LENS_REGION
        share = path->beside ? ONE : share;
#endif
        path->share *= share;
#endif
    }
    return bent;
}

#if LENS_POLARISED
// Turns the polarisation into the plane of incidence of a surface, and changes it as the surface does.
IN_PLACE static void polarise_at(LensPath *path, const __global Surface *s, F3 v, LensHit hit)
{
#if LENS_POSE
    if (s->posed)
        path->light.across = turned_back(s->rotation, path->light.across);
#endif
    if (s->refracts != 0.0f)
        polarise(&path->light, s, v, hit.n, hit.cosine);
#if LENS_POSE
    if (s->posed)
        path->light.across = turned_to(s->rotation, path->light.across);
#endif
#if LENS_MIRROR
    if (s->refracts < 0.0f)
        turn_round(&path->light);
#endif
}
#endif

#if LENS_KEEP_FAILED
// Keeps, in the frame of the surface, where rays were that end at it or ended before.
IN_PLACE static void keep_failed(LensPath *path, const __global Surface *s, Kept met)
{
    path->stopped_p.z -= s->gap;
#if LENS_MIRROR
    if (s->refracts < 0.0f) {
        path->stopped_p.z = -path->stopped_p.z;
        path->stopped_d.z = -path->stopped_d.z;
    }
#endif
    path->stopped_p = select3(MASK_OF(met), path->p, path->stopped_p);
    path->stopped_d = select3(MASK_OF(path->passed), path->d, path->stopped_d);
}
#endif

// `stop` holds the shape of the stop, where it has one: edges of an outline or cells of a mask.
static void cross_surface(LensPath *path, const __global Surface *s, const __global real *stop)
{
    F3 p = path->p, d = path->d;
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
#if LENS_ABSORPTION
    if (s->attenuation > 0.0f || s->attenuation_table >= 0) {
        F depth = over_wavelength(s->attenuation, s->attenuation_table, stop, path->wavelength) * dot3(sub(hit.p, q), v);
#if LENS_REGION
        depth = path->beside ? ZERO : depth;
#endif
        path->depth += depth;
    }
#endif
    I within = within_rim(s, stop, hit.p);
#if LENS_REGION
    I outside = NOT(within_region(s, hit.p));
    if (s->region == REGION_BLOCKS)
        within = within & NOT(outside);
    if (s->region == REGION_GOES_ON)
        within = within & NOT(outside ^ path->beside);         // neither in nor out through the cut face
    else
        path->beside = s->region == REGION_OPENS ? outside : FALSE;
#endif
    I bends;
    F3 bent = bent_by(path, s, stop, v, hit, &bends);
#if LENS_POLARISED
    polarise_at(path, s, v, hit);
#endif
#if LENS_REGION
    bent = select3(path->beside, v, bent);
    bends = bends | path->beside;
#endif
    Kept passed = path->passed;
    Kept met = passed & KEPT(hit.met & (v.z > 0.0f));
    Kept inside = met & KEPT(within);
    path->missed |= passed ^ met;
    path->clipped |= met ^ inside;
#if LENS_GENERAL
    path->undecided |= (passed ^ met) & KEPT(NOT(hit.resolved));
#endif
    path->passed = inside & KEPT(bends);
    path->crossed += MASK_OF(path->passed) & 1;
    path->p = hit.p;
    path->d = bent;
#if LENS_POSE
    if (s->posed) {
        path->p = add(turned_to(s->rotation, hit.p), offset_of(s));
        path->d = turned_to(s->rotation, bent);
    }
#endif
#if LENS_MIRROR
    if (s->refracts < 0.0f) {
        path->p.z = -path->p.z;
        path->d.z = -path->d.z;
    }
#endif
#if LENS_KEEP_FAILED
    keep_failed(path, s, met);
#endif
}

static LensRay leave_lens(const LensPath *path)
{
    LensRay ray;
#if LENS_KEEP_FAILED
    ray.p = path->stopped_p;
    ray.d = normalized(path->stopped_d);
#else
    ray.p = path->p;
    ray.d = normalized(path->d);
#endif
    ray.passed = MASK_OF(path->passed);
#if LENS_LOSSES
    F left = path->share;
#if LENS_ABSORPTION
    left *= exponential(-path->depth);
#endif
    ray.transmittance = ray.passed ? left : ZERO;
#endif
    I reason = MASK_OF(path->clipped) ? (I)(RAY_CLIPPED) : (I)(RAY_TOTAL_INTERNAL_REFLECTION);
    reason = MASK_OF(path->missed) ? (I)(RAY_MISSED) : reason;
#if LENS_GENERAL
    reason = MASK_OF(path->undecided) ? (I)(RAY_NO_CONVERGENCE) : reason;
#endif
    ray.status = ray.passed ? (I)(RAY_OK) : reason;
    ray.surface = ray.passed ? (I)(-1) : path->crossed;
    return ray;
}

#endif
