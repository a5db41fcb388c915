// Light that surfaces and glass of a lens leave to a ray, the mean of both polarisations: the closed forms of
// rptcam_cl/optics/glass.py. Facts: LENS_FRESNEL (surfaces reflect), LENS_LAYERS (some through layers), LENS_STACKS (through
// several), LENS_DARK_LAYERS (that absorb), LENS_ABSORPTION (glass absorbs), LENS_TINTED (what they do depends on the wavelengths of the lanes: tables of one number
// per nm from LOSS_TABLE_NM on, LOSS_TABLE_LENGTH long).
#ifndef LENS_COATING_H
#define LENS_COATING_H
#include "common/math.h"

#if LENS_TINTED
// A value at a wavelength [nm] from the table that begins at `first`; where there is none, one value holds for all.
static inline F over_wavelength(real value, int first, const __global real *tables, F wavelength)
{
    if (first < 0)
        return (F)(value);
    F place = MIN(MAX(wavelength - (real)LOSS_TABLE_NM, ZERO), (F)(LOSS_TABLE_LENGTH - 1));
    I cell = MIN(TO_I(place), (I)(LOSS_TABLE_LENGTH - 2));
    F low = GATHER(F, tables + first, cell, );
    F high = GATHER(F, tables + first + 1, cell, );
    return low + (place - TO_F(cell)) * (high - low);
}
#else
#define over_wavelength(value, first, tables, wavelength) ((F)(value))
#endif

#if LENS_FRESNEL
// Fresnel's equations between media of indices n and m, met at cosines c and d: 1 - (s^2 + p^2) / 2 with one division.
static inline F bare_share(F n, F m, F c, F d)
{
    F s = n * c + m * d;
    F p = m * c + n * d;
    F s2 = s * s, p2 = p * p;
    return 2.0f * n * m * c * d * (s2 + p2) / (s2 * p2);
}

#if LENS_LAYERS
// The same through a layer of index f; `turns` is how far the phase of light that crosses it twice at a right angle gets.
static F layer_share(F n, F m, real f, F turns, F c, F d)
{
    F ratio = n / f;
    F inside = root(1.0f - ratio * ratio * (1.0f - c * c));
    F turn = turns * inside;
    F sine, cosine;
    sincos_turns(turn - FLOOR(turn), &sine, &cosine);
    F nc = n * c, fi = f * inside, md = m * d;
    F fc = f * c, ni = n * inside, mi = m * inside, fd = f * d;
    F s = (nc + fi) * (fi + md), s_back = (nc - fi) * (fi - md);
    F p = (fc + ni) * (mi + fd), p_back = (fc - ni) * (mi - fd);
    F s2 = s * s + s_back * (s_back + 2.0f * s * cosine);
    F p2 = p * p + p_back * (p_back + 2.0f * p * cosine);
    return 8.0f * nc * md * fi * fi * (s2 + p2) / (s2 * p2);
}
#endif

#if LENS_STACKS
#define LEAST_COSINE 1e-4f      // in a layer, along which light does not quite travel

#if LENS_DARK_LAYERS
#include "common/exponential.h"
#define DARK_TURNS 6.2831853f
#endif

// The tangential fields before layers whose fields behind are 1 and `behind`, an admittance: complex numbers.
typedef struct {
    F one_re, one_im, other_re, other_im;
#if LENS_DARK_LAYERS
    F left;                     // what the layers damp the amplitude to, not in the fields
#endif
} Fields;

#if LENS_DARK_LAYERS
// The same through one more layer, of index f + i k, whose phase turns `per_index` times in a vacuum of its thickness.
static Fields through_dark_layer(Fields b, real f, real k, F per_index, F sine2, int p)
{
    F square_re = f * f - k * k - sine2, square_im = (F)(2.0f * f * k);     // of f + i k times the cosine within
    F length = sqrt(square_re * square_re + square_im * square_im);
    F large = MAX(root(0.5f * (length + absolute(square_re))), (F)(LEAST_COSINE)), small = 0.5f * square_im / large;
    F re = square_re > 0.0f ? large : small, im = square_re > 0.0f ? small : large;
    F turn = re * per_index, sine, cosine;
    sincos_turns(turn - FLOOR(turn), &sine, &cosine);
    F damped = exponential(-DARK_TURNS * im * per_index), back = damped * damped;
    F sum = 0.5f + 0.5f * back, rest = 0.5f - 0.5f * back;
    F c_re = cosine * sum, c_im = -(sine * rest);                           // of the cosine and of -i sine, damped
    F s_re = cosine * rest, s_im = -(sine * sum);
    F y_re = re, y_im = im;                                                 // admittance
    if (p) {
        real n_re = f * f - k * k, n_im = 2.0f * f * k, inverse = 1.0f / (n_re * n_re + n_im * n_im);
        y_re = (re * n_re + im * n_im) * inverse;
        y_im = (im * n_re - re * n_im) * inverse;
    }
    F inverse = 1.0f / (y_re * y_re + y_im * y_im);
    F under_re = (s_re * y_re + s_im * y_im) * inverse, under_im = (s_im * y_re - s_re * y_im) * inverse;
    F over_re = s_re * y_re - s_im * y_im, over_im = s_re * y_im + s_im * y_re;
    Fields a;
    a.one_re = c_re * b.one_re - c_im * b.one_im + under_re * b.other_re - under_im * b.other_im;
    a.one_im = c_re * b.one_im + c_im * b.one_re + under_re * b.other_im + under_im * b.other_re;
    a.other_re = c_re * b.other_re - c_im * b.other_im + over_re * b.one_re - over_im * b.one_im;
    a.other_im = c_re * b.other_im + c_im * b.other_re + over_re * b.one_im + over_im * b.one_re;
    a.left = b.left * damped;
    return a;
}
#endif

// Fields of s or of p polarised light that meets layers at cosine c in index n; `per` turns thicknesses into turns.
static Fields through_layers(const __global Surface *s, F n, F c, F per, F behind, int p)
{
    Fields a;
    a.one_re = ONE;
    a.one_im = ZERO;
    a.other_re = behind;
    a.other_im = ZERO;
#if LENS_DARK_LAYERS
    a.left = ONE;
    F deep = root(s->eta * s->eta * (1.0f - c * c) - 1.0f);                 // beyond total reflection, which may lose light
    a.other_im = p ? deep * s->eta / n : deep * n / s->eta;
#endif
    for (int k = 0; k < s->stacked; ++k) {
        real f = s->stack[2 * k];
#if LENS_DARK_LAYERS
        if (s->extinction[k] > 0.0f) {
            a = through_dark_layer(a, f, s->extinction[k], s->stack[2 * k + 1] / f * per, n * n * (1.0f - c * c), p);
            continue;
        }
#endif
        F part = n / f;
        F inside = MAX(root(1.0f - part * part * (1.0f - c * c)), (F)(LEAST_COSINE));
        F turn = s->stack[2 * k + 1] * per * inside, sine, cosine;
        sincos_turns(turn - FLOOR(turn), &sine, &cosine);
        F admittance = p ? inside / f : f * inside;
        F under = sine / admittance, over = sine * admittance;
        Fields b = a;
        a.one_re = cosine * b.one_re + under * b.other_im;
        a.one_im = cosine * b.one_im - under * b.other_re;
        a.other_re = cosine * b.other_re + over * b.one_im;
        a.other_im = cosine * b.other_im - over * b.one_re;
    }
    return a;
}

static inline F fields_share(Fields a, F front, F behind)
{
    F re = front * a.one_re + a.other_re, im = front * a.one_im + a.other_im;
    F share = 4.0f * front * behind / (re * re + im * im);
#if LENS_DARK_LAYERS
    share *= a.left * a.left;
#endif
    return share;
}
#endif

// What a surface lets through; `eta` is the index before over that after, c and d the cosines of the ray before and after.
static F surface_share(const __global Surface *s, const __global real *tables, F wavelength, F eta, F c, F d)
{
#if LENS_STACKS
    if (s->stacked > 0) {
        F n = over_wavelength(s->index, s->index_table, tables, wavelength), m = n / eta;
#if LENS_TINTED
        F per = ONE / wavelength;
#else
        F per = ONE;
#endif
        Fields across = through_layers(s, n, c, per, m * d, 0), other = through_layers(s, n, c, per, d / m, 1);
        return 0.5f * (fields_share(across, n * c, m * d) + fields_share(other, c / n, d / m));
    }
#endif
#if LENS_LAYERS
    if (s->layer > 0.0f) {
        F n = over_wavelength(s->index, s->index_table, tables, wavelength);
#if LENS_TINTED
        F turns = s->layer_turns / wavelength;
#else
        F turns = (F)(s->layer_turns);
#endif
        return layer_share(n, n / eta, s->layer, turns, c, d);
    }
#endif
    F gain = over_wavelength(s->gain, s->gain_table, tables, wavelength);
    return MIN(gain * bare_share(eta, ONE, c, d), ONE);
}
#endif

#endif
