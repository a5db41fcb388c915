// exp(x) for x <= 88, from + - * and bits alone: x = k ln 2 + r, then a Taylor polynomial on +-ln(2)/2 (error 1e-7 of the
// value, plus 6e-8 |x|); below -87 it is 0 to float32.
#ifndef EXPONENTIAL_H
#define EXPONENTIAL_H
#include "common/math.h"

static inline F exponential(F x)
{
    F bounded = MAX(x, (F)(-87.0f));
    F k = FLOOR(bounded * 1.44269504f + 0.5f);
    F r = (bounded - k * 0.693359375f) + k * 2.12194440e-4f;
    F p = 1.0f + r * (1.0f + r * (0.5f + r * (1.66666667e-1f + r * (4.16666667e-2f
                                                                  + r * (8.33333333e-3f + r * 1.38888889e-3f)))));
    F power = AS_F((TO_I(k) + EXPONENT_BIAS) << EXPONENT_SHIFT);
    return x < -87.0f ? ZERO : p * power;
}

#if HAS_SHEEN || HAS_MEDIA || HAS_HAIR
// ln(x) for normal x > 0: x = 2^k m with m in [0.71, 1.42], then the series of artanh (error 1e-7 of the value).
static F logarithm(F x)
{
    I k = (AS_I(x) >> EXPONENT_SHIFT) - EXPONENT_BIAS;
    F m = AS_F(AS_I(x) - (k << EXPONENT_SHIFT));
    I high = m > 1.41421356f;
    m = high ? 0.5f * m : m;
    k = high ? k + 1 : k;
    F q = (m - 1.0f) / (m + 1.0f);
    F s = q * q;
    F series = q * (2.0f + s * (6.66666667e-1f + s * (0.4f + s * (2.85714286e-1f + s * 2.22222222e-1f))));
    return TO_F(k) * 0.69314718056f + series;
}
#endif

#endif
