// Where a ray meets one surface of a lens, in the frame of its vertex with z along the travel; the same steps as the
// float64 reference in rptcam_cl/optics/shapes.py. Every kind goes to the vertex plane first and then to the surface, so that
// planes are exact and no large radius is ever subtracted. Facts: LENS_CONIC, LENS_GENERAL, LENS_ODD, LENS_REGION.
#ifndef LENS_SURFACE_H
#define LENS_SURFACE_H
#include "common/records.h"

typedef struct {
    F3 p;          // hit point
    F3 n;          // unit normal along the travel
    F  cosine;     // of incidence
    I  met;        // the ray meets the part of the surface about its vertex
    I  settled;    // an iteration, where one was needed, has converged
} LensHit;

// Tangent-plane form with curvature c = 1/R; the normal (-c x, -c y, 1 - c z) of a sphere has unit length by construction.
static LensHit meet_sphere(const __global Surface *s, F3 p, F3 d)
{
    real c = s->curvature;
    F t0 = -p.z / d.z;
    F x = p.x + t0 * d.x;
    F y = p.y + t0 * d.y;
    F f = c * (x * x + y * y);
    F g = d.z - c * (x * d.x + y * d.y);
    F discriminant = g * g - c * f;
    LensHit hit;
    hit.cosine = root(discriminant);
    F t = f / (g + hit.cosine);
    hit.p = f3(x + t * d.x, y + t * d.y, t * d.z);
    hit.n = f3(-c * hit.p.x, -c * hit.p.y, 1.0f - c * hit.p.z);
    hit.met = (discriminant >= 0.0f) & (hit.n.z > 0.0f);
    hit.settled = TRUE;
    return hit;
}

#if LENS_CONIC || LENS_GENERAL
// A conic of revolution, or with a weight of 0 a cylinder: c (wx x^2 + wy y^2 + (1 + k) z^2) = 2 z.
static LensHit meet_conic(const __global Surface *s, F3 p, F3 d)
{
    real c = s->curvature, k = s->conic, wx = s->weight_x, wy = s->weight_y;
    F t0 = -p.z / d.z;
    F x = p.x + t0 * d.x;
    F y = p.y + t0 * d.y;
    F f = c * (wx * x * x + wy * y * y);
    F g = d.z - c * (wx * d.x * x + wy * d.y * y);
    F a = c * (wx * d.x * d.x + wy * d.y * d.y + (1.0f + k) * d.z * d.z);
    F discriminant = g * g - a * f;
    F r = root(discriminant);
    F t = f / (g + r);
    LensHit hit;
    hit.p = f3(x + t * d.x, y + t * d.y, t * d.z);
    F3 n = f3(-c * wx * hit.p.x, -c * wy * hit.p.y, 1.0f - c * (1.0f + k) * hit.p.z);
    F inverse = ONE / sqrt(dot3(n, n));
    hit.n = scale(n, inverse);
    hit.cosine = r * inverse;
    hit.met = (discriminant >= 0.0f) & (n.z > 0.0f);
    hit.settled = TRUE;
    return hit;
}
#endif

#if LENS_GENERAL
// The polynomial part of an asphere and its slope d/ds at s = r^2: even powers by Horner's rule in s, odd ones r times such.
static void polynomial(const __global Surface *surface, F s, F *value, F *slope)
{
    F v = ZERO, dv = ZERO;
    for (int i = surface->even_terms - 1; i >= 0; --i) {
        dv = dv * s + v;
        v = v * s + surface->even[i];
    }
    *value = v * s;                                     // even[0] belongs to s^1
    *slope = dv * s + v;
#if LENS_ODD
    F q = ZERO, dq = ZERO;
    for (int i = surface->odd_terms - 1; i >= 0; --i) {
        dq = dq * s + q;
        q = q * s + surface->odd[i];
    }
    F r = sqrt(s);                                      // odd[0] belongs to r^1
    *value += r * q;
    *slope += (r > 0.0f ? 0.5f * q / r : ZERO) + r * dq;
#endif
}

// z and its slope d/ds of the profile c s / (1 + sqrt(1 - (1 + k) c^2 s)) + polynomial.
static void profile(const __global Surface *surface, F s, F *z, F *slope)
{
    real c = surface->curvature;
    F r = sqrt(1.0f - (1.0f + surface->conic) * c * c * s);
    F more, its_slope;
    polynomial(surface, s, &more, &its_slope);
    *z = c * s / (1.0f + r) + more;
    *slope = 0.5f * c / r + its_slope;
}

static void sag_and_slopes(const __global Surface *surface, F x, F y, F *z, F *zx, F *zy)
{
    if (surface->kind == LENS_BICONIC) {
        real cx = surface->curvature_x, cy = surface->curvature;
        real qx = (1.0f + surface->conic_x) * cx * cx, qy = (1.0f + surface->conic) * cy * cy;
        F top = cx * x * x + cy * y * y;
        F r = sqrt(1.0f - qx * x * x - qy * y * y);
        F under = 1.0f + r;
        F shared = top / (r * under * under);
        F more, slope;
        polynomial(surface, x * x + y * y, &more, &slope);
        *z = top / under + more;
        *zx = 2.0f * cx * x / under + shared * qx * x + 2.0f * x * slope;
        *zy = 2.0f * cy * y / under + shared * qy * y + 2.0f * y * slope;
    } else if (surface->kind == LENS_TOROID) {
        real cx = surface->curvature_x;
        F arc, slope;
        profile(surface, y * y, &arc, &slope);
        F w = 1.0f - cx * arc;
        F r = sqrt(w * w - cx * cx * x * x);
        *z = arc + cx * x * x / (w + r);
        *zx = cx * x / r;
        *zy = 2.0f * y * slope * w / r;
    } else {
        real wx = surface->weight_x, wy = surface->weight_y;
        F slope;
        profile(surface, wx * x * x + wy * y * y, z, &slope);
        *zx = 2.0f * wx * x * slope;
        *zy = 2.0f * wy * y * slope;
    }
}

// Newton's iteration along the ray from the base conic, or from the vertex plane where the sections differ. A step below
// CLOSE of the distance scale ends it: a few roundings, more cannot be resolved.
static LensHit meet_general(const __global Surface *surface, F3 p, F3 d)
{
    F t0 = -p.z / d.z;
    F x0 = p.x + t0 * d.x;
    F y0 = p.y + t0 * d.y;
    F t = ZERO;
    if (surface->kind == LENS_ASPHERE) {
        LensHit base = meet_conic(surface, f3(x0, y0, ZERO), d);
        t = base.met ? base.p.z / d.z : ZERO;
    }
    F reach = absolute(x0) + absolute(y0) + absolute(t);
    I settled = FALSE;
    for (int i = 0; i < NEWTON_STEPS && ANY(NOT(settled)); ++i) {
        F z, zx, zy;
        sag_and_slopes(surface, x0 + t * d.x, y0 + t * d.y, &z, &zx, &zy);
        F change = (t * d.z - z) / (d.z - zx * d.x - zy * d.y);
        settled |= absolute(change) <= CLOSE * (reach + absolute(t)) + SMALLEST;
        t -= change;
    }
    LensHit hit;
    F z, zx, zy;
    F x = x0 + t * d.x;
    F y = y0 + t * d.y;
    sag_and_slopes(surface, x, y, &z, &zx, &zy);
    F inverse = ONE / sqrt(1.0f + zx * zx + zy * zy);
    hit.p = f3(x, y, z);
    hit.n = f3(-zx * inverse, -zy * inverse, inverse);
    hit.cosine = dot3(hit.n, d);
    I near = x * x + y * y <= 9.0f * surface->semi_diameter2;   // farther out the iteration follows other sheets
    I reached = NOT(not_finite(t)) & NOT(not_finite(z)) & near;
    hit.met = reached & settled & (hit.cosine > 0.0f);
    hit.settled = settled | NOT(reached);
    return hit;
}
#endif

static LensHit meet_surface(const __global Surface *surface, F3 p, F3 d)
{
#if LENS_GENERAL
    if (surface->kind >= LENS_ASPHERE)
        return meet_general(surface, p, d);
#endif
#if LENS_CONIC
    if (surface->kind == LENS_CONIC_KIND)
        return meet_conic(surface, p, d);
#endif
    return meet_sphere(surface, p, d);
}

#if LENS_OUTLINE
// Inside a polygon by the even-odd rule; an edge is y0, y1, x0 and dx/dy.
static I within_outline(const __global real *edges, int count, F3 p)
{
    I inside = FALSE;
    for (int i = 0; i < count; ++i) {
        const __global real *e = edges + 4 * i;
        I spans = (p.y < e[0]) ^ (p.y < e[1]);
        inside ^= spans & (p.x < e[2] + e[3] * (p.y - e[0]));
    }
    return inside;
}
#endif

#if LENS_MASK
// In an open cell of a square mask of `side` cells, row 0 at +y; half its side is the stop's radius.
static I within_mask(const __global Surface *surface, const __global real *cells, int side, F3 p)
{
    F half_cells = 0.5f * (real)side;
    F column = (p.x / surface->stop_radius + 1.0f) * half_cells;
    F row = (1.0f - p.y / surface->stop_radius) * half_cells;
    I inside = (column >= 0.0f) & (column < (real)side) & (row >= 0.0f) & (row < (real)side);
    I index = inside ? TO_I(row) * side + TO_I(column) : FALSE;
    return inside & (GATHER(F, cells, index, ) > 0.5f);
}
#endif

// Inside the rim and, at a stop with a shape, inside that.
static I within_rim(const __global Surface *surface, const __global real *stop, F3 p)
{
    I within = p.x * p.x + p.y * p.y <= surface->semi_diameter2;
#if LENS_OUTLINE
    if (surface->stop_shape == STOP_OUTLINE)
        within = within & within_outline(stop, surface->stop_count, p);
#endif
#if LENS_MASK
    if (surface->stop_shape == STOP_MASK)
        within = within & within_mask(surface, stop, surface->stop_count, p);
#endif
    return within;
}

#if LENS_REGION
// A rectangle or half plane of the vertex plane, or what lies outside of it.
static I within_region(const __global Surface *surface, F3 p)
{
    if (surface->region == REGION_NONE)
        return TRUE;
    I inside = (absolute(p.x) <= surface->half_width) & (absolute(p.y) <= surface->half_height)
             & (p.x * surface->edge_x + p.y * surface->edge_y >= surface->edge);
    return surface->inverted ? NOT(inside) : inside;
}
#endif

#endif
