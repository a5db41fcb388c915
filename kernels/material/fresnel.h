// Unpolarised Fresnel reflectance of a smooth dielectric and the refracted cosine; exact at total internal reflection.
#ifndef FRESNEL_H
#define FRESNEL_H
#include "common/math.h"

// `eta` is the index behind the surface over the index in front, `cos_i` the cosine of incidence (>= 0).
static F fresnel(F cos_i, F eta, F *cos_t)
{
    F sin2_t = (1.0f - cos_i * cos_i) / (eta * eta);
    I total = sin2_t >= 1.0f;
    F ct = root(1.0f - sin2_t);
    F s = (cos_i - eta * ct) / (cos_i + eta * ct);
    F p = (eta * cos_i - ct) / (eta * cos_i + ct);
    *cos_t = ct;
    return total ? ONE : 0.5f * (s * s + p * p);
}

#endif
