// Where a ray meets one surface of a lens, in the frame of its vertex with z along the travel; the same steps as the
// float64 reference in rptcam_cl/optics/shapes. Every kind goes to the vertex plane first, or near it, and then to the surface,
// so that no large radius is ever subtracted. Facts: LENS_CONIC, LENS_GENERAL, LENS_ODD, LENS_CYLINDER,
// LENS_REGION, LENS_RING.
#ifndef LENS_SURFACE_H
#define LENS_SURFACE_H
#include "common/records.h"

typedef struct {
    F3 p;          // hit point
    F3 n;          // unit normal along the travel
    F  cosine;     // of incidence
    F  cosine2;    // its square
    I  met;        // the ray meets the part of the surface about its vertex
    I  resolved;   // met or missed for certain: an iteration, where one was needed, found which
} LensHit;

// What x^2 and y^2 count in the profile: 0 for the axis along which a cylinder is straight.
#if LENS_CYLINDER
#define WEIGHT_X(surface) ((surface)->weight_x)
#define WEIGHT_Y(surface) ((surface)->weight_y)
#else
#define WEIGHT_X(surface) ((real)1)
#define WEIGHT_Y(surface) ((real)1)
#endif

// The ray is followed by the height of its start first, which brings it near the vertex plane without a division; then
// c |q + t d|^2 = 2 (q + t d).z with the curvature c = 1/R. The normal (-c x, -c y, 1 - c z) has unit length by construction.
static LensHit meet_sphere(const __global Surface *s, F3 p, F3 d)
{
    real c = s->curvature;
    F3 q = along(p, d, -p.z);
    F f = c * dot3(q, q) - 2.0f * q.z;
    F g = d.z - c * dot3(q, d);
    F discriminant = g * g - c * f;
    LensHit hit;
    hit.cosine = root(discriminant);
    hit.cosine2 = discriminant;
    F t = f / (g + hit.cosine);
    hit.p = along(q, d, t);
    hit.n = f3(-c * hit.p.x, -c * hit.p.y, 1.0f - c * hit.p.z);
    hit.met = (discriminant >= 0.0f) & (hit.n.z > 0.0f);
    hit.resolved = TRUE;
    return hit;
}

#if LENS_CONIC || LENS_GENERAL
// A conic of revolution, or with a weight of 0 a cylinder: c (wx x^2 + wy y^2 + (1 + k) z^2) = 2 z.
static LensHit meet_conic(const __global Surface *s, F3 p, F3 d)
{
    real c = s->curvature, k = s->conic, wx = WEIGHT_X(s), wy = WEIGHT_Y(s);
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
    hit.cosine2 = hit.cosine * hit.cosine;
    hit.met = (discriminant >= 0.0f) & (n.z > 0.0f);
    hit.resolved = TRUE;
    return hit;
}
#endif

#if LENS_GENERAL
// The polynomial part of an asphere and its slope d/ds at s = r^2: even powers by Horner's rule in s, odd ones r times such.
static void polynomial(const __global Surface *surface, F s, F *value, F *slope)
{
    int top = surface->even_terms > 0 ? surface->even_terms - 1 : 0;
    F v = (F)(surface->even[top]), dv = ZERO;
    for (int i = top - 1; i >= 0; --i) {
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
static inline void profile(const __global Surface *surface, F s, F *z, F *slope)
{
    real c = surface->curvature;
    F r = sqrt(1.0f - (1.0f + surface->conic) * c * c * s);
    F q = c / (r * (1.0f + r));                         // one division for both
    F more, its_slope;
    polynomial(surface, s, &more, &its_slope);
    *z = s * (r * q) + more;
    *slope = 0.5f * (q + r * q) + its_slope;
}

// z and its slopes of the kinds that have numbers of their own, as their `fill` in rptcam_cl/optics/shapes writes them.
// Of a biconic these are the curvature and the conic constant in the x-z section.
static void biconic(const __global Surface *surface, F x, F y, F *z, F *zx, F *zy)
{
    real cx = surface->own[0], cy = surface->curvature;
    real qx = (1.0f + surface->own[1]) * cx * cx, qy = (1.0f + surface->conic) * cy * cy;
    F top = cx * x * x + cy * y * y;
    F r = sqrt(1.0f - qx * x * x - qy * y * y);
    F q = 1.0f / (r * (1.0f + r));                  // one division for all
    F inverse = r * q;                              // 1 / (1 + r)
    F shared = top * q * inverse;
    F more, slope;
    polynomial(surface, x * x + y * y, &more, &slope);
    *z = top * inverse + more;
    *zx = x * (2.0f * cx * inverse + shared * qx + 2.0f * slope);
    *zy = y * (2.0f * cy * inverse + shared * qy + 2.0f * slope);
}

// Of a toroid the curvature in the x-z section.
static void toroid(const __global Surface *surface, F x, F y, F *z, F *zx, F *zy)
{
    real cx = surface->own[0];
    F arc, slope;
    profile(surface, y * y, &arc, &slope);
    F w = 1.0f - cx * arc;
    F r = sqrt(w * w - cx * cx * x * x);
    F q = 1.0f / (r * (w + r));                     // one division for all
    F inverse = (w + r) * q;                        // 1 / r
    *z = arc + cx * x * x * (r * q);
    *zx = cx * x * inverse;
    *zy = 2.0f * y * slope * w * inverse;
}

static inline void sag_and_slopes(const __global Surface *surface, F x, F y, F *z, F *zx, F *zy)
{
    if (surface->kind == LENS_BICONIC)
        biconic(surface, x, y, z, zx, zy);
    else
        toroid(surface, x, y, z, zx, zy);
}

// Where Newton's iteration starts on the ray from the vertex plane: on the base conic, moved by the polynomial's value
// there; on the vertex plane where the ray misses that.
static F first_guess(const __global Surface *surface, F x, F y, F3 d)
{
    real c = surface->curvature, q = 1.0f + surface->conic, wx = WEIGHT_X(surface), wy = WEIGHT_Y(surface);
    F s = wx * x * x + wy * y * y;
    F z, slope;
    polynomial(surface, s, &z, &slope);
    F f = c * (s + q * z * z) + 2.0f * z;
    F g = d.z - c * (wx * d.x * x + wy * d.y * y - q * d.z * z);
    F a = c * (wx * d.x * d.x + wy * d.y * d.y + q * d.z * d.z);
    F discriminant = g * g - a * f;
    F t = f / (g + root(discriminant));
    return ((discriminant >= 0.0f) & (1.0f - c * q * (t * d.z - z) > 0.0f)) ? t : ZERO;
}

// Newton's step for a ray at a point, and on which side of the surface that lies, by its sign. With w = z - polynomial an
// asphere is the conic w = c (s + (1 + k) w^2) / 2, which needs neither a root nor, but for the step itself, a division.
static F newton_step(const __global Surface *surface, F x, F y, F z, F3 d, F *side)
{
    if (surface->kind != LENS_ASPHERE) {
        F sag, zx, zy;
        sag_and_slopes(surface, x, y, &sag, &zx, &zy);
        *side = z - sag;
        return *side / (d.z - zx * d.x - zy * d.y);
    }
    real half_c = 0.5f * surface->curvature, q = 1.0f + surface->conic;
    real wx = WEIGHT_X(surface), wy = WEIGHT_Y(surface);
    F s = wx * x * x + wy * y * y;
    F along_s = 2.0f * (wx * x * d.x + wy * y * d.y);
    F more, slope;
    polynomial(surface, s, &more, &slope);
    F w = z - more;
    F along_w = d.z - slope * along_s;
    *side = w - half_c * (s + q * w * w);
    return *side / (along_w - half_c * (along_s + 2.0f * q * w * along_w));
}

// A normal of any length; its z is negative on the far sheet of an asphere.
static F3 normal_at(const __global Surface *surface, F x, F y, F z)
{
    if (surface->kind != LENS_ASPHERE) {
        F sag, zx, zy;
        sag_and_slopes(surface, x, y, &sag, &zx, &zy);
        return f3(-zx, -zy, ONE);
    }
    real c = surface->curvature, q = 1.0f + surface->conic;
    F more, slope;
    polynomial(surface, WEIGHT_X(surface) * x * x + WEIGHT_Y(surface) * y * y, &more, &slope);
    F nz = 1.0f - c * q * (z - more);
    F sideways = -(c + 2.0f * slope * nz);
    return f3(WEIGHT_X(surface) * x * sideways, WEIGHT_Y(surface) * y * sideways, nz);
}

// Newton's iteration along the ray from a first guess, or from the vertex plane where the sections differ. A step below
// LAST_STEP of the distance scale ends it: what it leaves is as its square. A ray that strays to three clear radii, where
// a polynomial means nothing, has missed, and so has one that does not converge and is never seen on the other side.
static LensHit meet_general(const __global Surface *surface, F3 p, F3 d)
{
    F t0 = -p.z / d.z;
    F x0 = p.x + t0 * d.x;
    F y0 = p.y + t0 * d.y;
    F t = surface->kind == LENS_ASPHERE ? first_guess(surface, x0, y0, d) : ZERO;
    F last_step = LAST_STEP * (absolute(x0) + absolute(y0) + absolute(t)) + SMALLEST;
    F limit = 9.0f * surface->semi_diameter2;
    I converged = FALSE, lost = FALSE;
    I some = FALSE, all = (I)(-1);                             // sign bits: of any point, of every point
    for (int i = 0; i < NEWTON_STEPS && ANY(NOT(converged | lost)); ++i) {
        F x = x0 + t * d.x;
        F y = y0 + t * d.y;
        F side;
        F change = newton_step(surface, x, y, t * d.z, d, &side);
        some |= AS_I(side);
        all &= AS_I(side);
        lost |= NOT(converged | (x * x + y * y <= limit));          // or nowhere, where it is not a number
        t -= change;
        converged |= NOT(lost) & (absolute(change) <= last_step);
    }
    LensHit hit;
    hit.p = f3(x0 + t * d.x, y0 + t * d.y, t * d.z);
    F3 n = normal_at(surface, hit.p.x, hit.p.y, hit.p.z);
    hit.n = scale(n, ONE / sqrt(dot3(n, n)));
    hit.cosine = dot3(hit.n, d);
    hit.cosine2 = hit.cosine * hit.cosine;
    hit.met = converged & NOT(lost) & (hit.n.z > 0.0f) & (hit.cosine > 0.0f);
    hit.resolved = converged | lost | ((some ^ all) >= 0);
    return hit;
}
#endif

static inline LensHit meet_surface(const __global Surface *surface, F3 p, F3 d)
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
static inline I within_mask(const __global Surface *surface, const __global real *cells, int side, F3 p)
{
    F half_cells = 0.5f * (real)side;
    F column = (p.x / surface->stop_radius + 1.0f) * half_cells;
    F row = (1.0f - p.y / surface->stop_radius) * half_cells;
    I inside = (column >= 0.0f) & (column < (real)side) & (row >= 0.0f) & (row < (real)side);
    I index = inside ? TO_I(row) * side + TO_I(column) : FALSE;
    return inside & (GATHER(F, cells, index, ) > 0.5f);
}
#endif

// Inside the rim, outside of a hole and, at a stop with a shape, inside that.
static inline I within_rim(const __global Surface *surface, const __global real *stop, F3 p)
{
    I within = p.x * p.x + p.y * p.y <= surface->semi_diameter2;
#if LENS_RING
    within = within & (p.x * p.x + p.y * p.y >= surface->inner_semi_diameter2);
#endif
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
// A rectangle, half plane or ring of the vertex plane, or what lies outside of it.
static inline I within_region(const __global Surface *surface, F3 p)
{
    if (surface->region == REGION_NONE)
        return TRUE;
#if LENS_ROUND_REGION
    F x = p.x - surface->centre_x, y = p.y - surface->centre_y;
    F square = x * x + y * y;
    I inside = (absolute(x) <= surface->half_width) & (absolute(y) <= surface->half_height)
             & (square <= surface->radius2) & (square >= surface->inner_radius2)
#else
    I inside = (absolute(p.x) <= surface->half_width) & (absolute(p.y) <= surface->half_height)
#endif
             & (p.x * surface->edge_x + p.y * surface->edge_y >= surface->edge);
    return surface->inverted ? NOT(inside) : inside;
}
#endif

#endif
