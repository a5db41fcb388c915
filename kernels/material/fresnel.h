// Unpolarised Fresnel reflectance.
#ifndef FRESNEL_H
#define FRESNEL_H
#include "common/math.h"

// Of a smooth dielectric, with the refracted cosine; exact at total internal reflection. `eta` is the index behind the
// surface over the index in front, `cos_i` the cosine of incidence (>= 0).
static inline F fresnel(F cos_i, F eta, F *cos_t)
{
    F sin2_t = (1.0f - cos_i * cos_i) / (eta * eta);
    I total = sin2_t >= 1.0f;
    F ct = root(1.0f - sin2_t);
    F s = (cos_i - eta * ct) / (cos_i + eta * ct);
    F p = (eta * cos_i - ct) / (eta * cos_i + ct);
    *cos_t = ct;
    return total ? ONE : 0.5f * (s * s + p * p);
}

// (1 - c)^5: Schlick 1994.
static inline F schlick(F c)
{
    F x = MAX(1.0f - c, ZERO);
    F x2 = x * x;
    return x2 * x2 * x;
}

#if HAS_METAL
// Of a metal of index n + i k (Born and Wolf, Principles of Optics, ch. 14; both polarisations over one divisor).
static F metal_fresnel(F cosine, F n, F k)
{
    F c2 = cosine * cosine;
    F s2 = 1.0f - c2;
    F n2 = n * n;
    F k2 = k * k;
    F t = n2 - k2 - s2;
    F size = sqrt(t * t + 4.0f * n2 * k2);
    F a = root(0.5f * (size + t));
    F t1 = size + c2;
    F t2 = 2.0f * a * cosine;
    F t3 = c2 * size + s2 * s2;
    return (t1 - t2) * t3 / ((t1 + t2) * (t3 + t2 * s2));
}
#endif

#endif
