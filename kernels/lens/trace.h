// A ray through every surface of a lens, in order of travel, as lanes of float32.
// Coordinates: millimetres, z along the direction of travel and relative to the vertex of the current surface.
// Each surface is met in the tangent-plane form: go to the vertex plane, then solve for the sag with curvature c = 1/R, so
// that planes are exact and no large radius is ever subtracted. Snell's law is exact in vector form; the normal
// (-c x, -c y, 1 - c z) of a sphere has unit length by construction.
#ifndef LENS_TRACE_H
#define LENS_TRACE_H
#include "common/records.h"

typedef struct {
    F3 p;         // on the last surface, relative to its vertex
    F3 d;         // unit
    I  passed;
    I  status;    // RAY_OK, RAY_MISSED, RAY_CLIPPED, RAY_TOTAL_INTERNAL_REFLECTION
    I  surface;   // where it failed, in order of travel; -1 when it passed
} LensRay;

// Within this relative distance of the critical angle float32 cannot tell refraction from total reflection.
#define CRITICAL  1e-6f

static LensRay trace_lens(F3 p, F3 d, const __global Surface *surfaces, int count)
{
    LensRay ray;
    ray.passed = TRUE;
    ray.status = (I)(RAY_OK);
    ray.surface = (I)(-1);
    for (int k = 0; k < count; ++k) {
        const __global Surface *s = surfaces + k;
        float c = s->curvature;
        F t0 = (s->gap - p.z) / d.z;
        F x = p.x + t0 * d.x;
        F y = p.y + t0 * d.y;
        F h = c * (x * x + y * y);
        F g = d.z - c * (x * d.x + y * d.y);
        F discriminant = g * g - c * h;
        F cosine = root(discriminant);
        F t = h / (g + cosine);
        p = f3(x + t * d.x, y + t * d.y, t * d.z);
        I met = (discriminant >= 0.0f) & (1.0f - c * p.z > 0.0f);
        I within = p.x * p.x + p.y * p.y <= s->semi_diameter2;
        float eta = s->eta;
        F k2 = 1.0f - eta * eta * (1.0f - cosine * cosine);
        F cosine_after = root(k2);
        F bend = cosine_after - eta * cosine;
        F tilt = bend * c;
        d = f3(eta * d.x - tilt * p.x, eta * d.y - tilt * p.y, eta * d.z - tilt * p.z + bend);
        I goes_on = met & within & (k2 > CRITICAL);
        I stops = ray.passed & NOT(goes_on);
        ray.status = stops ? (met ? (within ? (I)(RAY_TOTAL_INTERNAL_REFLECTION) : (I)(RAY_CLIPPED)) : (I)(RAY_MISSED))
                           : ray.status;
        ray.surface = stops ? (I)(k) : ray.surface;
        ray.passed = ray.passed & goes_on;
    }
    ray.p = p;
    ray.d = normalized(d);
    return ray;
}

#endif
