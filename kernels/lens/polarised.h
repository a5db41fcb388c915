// Polarisation that is carried through a lens, as rptcam_cl/optics/ghosts.py does: of two orthogonal polarisations
// of the source the amplitudes across a ray, along a vector and along direction x vector. Complex with LENS_LAYERS, whose
// coatings turn the phase; that of total reflection is left out. A surface that reflects a ghost is a mirror whose `eta`
// says what lies behind it. Facts: LENS_LAYERS, LENS_STACKS,
// LENS_DARK_LAYERS.
#ifndef POLARISED_H
#define POLARISED_H
#include "lens/coating.h"

typedef struct {
    F re, im;
} Amplitude;

typedef struct {
    F3        across;          // unit vector of the first component
    Amplitude jones[4];        // first component of both polarisations, then the second
} Polarisation;

static Polarisation unpolarised(F3 d)
{
    Polarisation light;
    F length = sqrt(d.x * d.x + d.z * d.z);
    light.across = f3(d.z / length, ZERO, -d.x / length);
    for (int i = 0; i < 4; ++i) {
        light.jones[i].re = i == 0 || i == 3 ? ONE : ZERO;
        light.jones[i].im = ZERO;
    }
    return light;
}

static F power_of(const Polarisation *light)
{
    F sum = ZERO;
    for (int i = 0; i < 4; ++i) {
        sum += light->jones[i].re * light->jones[i].re;
#if LENS_LAYERS
        sum += light->jones[i].im * light->jones[i].im;
#endif
    }
    return 0.5f * sum;
}

static inline Amplitude real_amplitude(F a)
{
    Amplitude r;
    r.re = a;
    r.im = ZERO;
    return r;
}

static inline Amplitude times(Amplitude a, Amplitude b)
{
    Amplitude r;
#if LENS_LAYERS
    r.re = a.re * b.re - a.im * b.im;
    r.im = a.re * b.im + a.im * b.re;
#else
    r.re = a.re * b.re;
    r.im = ZERO;
#endif
    return r;
}

#if LENS_LAYERS
// The quotient of an amplitude and of one that is given conjugated.
static inline Amplitude over(Amplitude a, Amplitude conjugated)
{
    F inverse = 1.0f / (conjugated.re * conjugated.re + conjugated.im * conjugated.im);
    Amplitude quotient = times(a, conjugated);
    quotient.re *= inverse;
    quotient.im *= inverse;
    return quotient;
}

// What a layer makes of amplitudes r and t at its two faces, with the phase of light that crosses it once (Airy).
static inline Amplitude layer_amplitude(F r, F t, F sine, F cosine, int reflects)
{
    F sine2 = 2.0f * sine * cosine, cosine2 = 1.0f - 2.0f * sine * sine;
    Amplitude below, above;
    below.re = 1.0f + r * t * cosine2;
    below.im = -(r * t * sine2);                            // conjugated
    F pass = root((1.0f - r * r) * (1.0f - t * t));
    above.re = reflects ? r + t * cosine2 : pass * cosine;
    above.im = reflects ? t * sine2 : pass * sine;
    return over(above, below);
}
#endif

#if LENS_STACKS
// What several layers make of light, from the fields before them (rptcam_cl/optics/glass.py).
static inline Amplitude stack_amplitude(Fields a, F front, F behind, int reflects)
{
    Amplitude whole, above;
    whole.re = front * a.one_re + a.other_re;
    whole.im = -(front * a.one_im + a.other_im);            // conjugated
    above.re = reflects ? front * a.one_re - a.other_re : 2.0f * root(front * behind);
    above.im = reflects ? front * a.one_im - a.other_im : ZERO;
#if LENS_DARK_LAYERS
    above.re = reflects ? above.re : above.re * a.left;
#endif
    return over(above, whole);
}
#endif

// Amplitudes of both components at a surface that light meets at cosine c. Totally reflected light keeps all of it.
static void surface_amplitudes(const __global Surface *s, F c, int reflects, Amplitude *across, Amplitude *other)
{
    real eta = s->eta;
    F behind2 = 1.0f - eta * eta * (1.0f - c * c);
    F d = root(behind2);
    F rs = (eta * c - d) / (eta * c + d), rp = (c - eta * d) / (c + eta * d);
    I total = behind2 <= 0.0f;
#if LENS_STACKS
    if (s->stacked > 0) {
        real n = s->index, m = n / eta;
        F front = n * c, behind = m * d;
#if LENS_DARK_LAYERS
        total = FALSE;
#endif
        *across = stack_amplitude(through_layers(s, (F)(n), c, ONE, behind, 0), front, behind, reflects);
        front = c / n, behind = d / m;
        *other = stack_amplitude(through_layers(s, (F)(n), c, ONE, behind, 1), front, behind, reflects);
    } else
#endif
#if LENS_LAYERS
    if (s->layer > 0.0f) {
        real n = s->index, m = n / eta, f = s->layer;
        F inside = root(1.0f - (n / f) * (n / f) * (1.0f - c * c));
        F turn = 0.5f * s->layer_turns * inside, sine, cosine;
        sincos_turns(turn - FLOOR(turn), &sine, &cosine);
        F first_s = (n * c - f * inside) / (n * c + f * inside), second_s = (f * inside - m * d) / (f * inside + m * d);
        F first_p = (f * c - n * inside) / (f * c + n * inside), second_p = (m * inside - f * d) / (m * inside + f * d);
        *across = layer_amplitude(first_s, second_s, sine, cosine, reflects);
        *other = layer_amplitude(first_p, second_p, sine, cosine, reflects);
    } else
#endif
    {
        F ts = root(1.0f - rs * rs), tp = root(1.0f - rp * rp);
        if (s->gain != 1.0f) {                              // measured: both alike
            F passed = MIN(s->gain * bare_share((F)(eta), ONE, c, d), ONE);
            F back = root(1.0f - passed);
            rs = with_sign(back, rs);
            rp = with_sign(back, rp);
            ts = tp = root(passed);
        }
        *across = real_amplitude(reflects ? rs : ts);
        *other = real_amplitude(reflects ? rp : tp);
    }
    across->re = total ? (F)(reflects ? 1.0f : 0.0f) : across->re;
    other->re = total ? (F)(reflects ? 1.0f : 0.0f) : other->re;
#if LENS_LAYERS
    across->im = total ? ZERO : across->im;
    other->im = total ? ZERO : other->im;
#endif
}

#define LEAST_SINE2 1e-12f      // of incidence, below which any plane of incidence is as good

// Turn the components into the plane of incidence and out of it again, behind a surface with normal n, in its frame.
static void polarise(Polarisation *light, const __global Surface *s, F3 d, F3 n, F c)
{
    F3 across = cross3(d, n);
    F sine2 = dot3(across, across);
    I slanted = sine2 > LEAST_SINE2;
    F inverse = ONE / sqrt(slanted ? sine2 : ONE);
    across = select3(slanted, scale(across, inverse), light->across);
    F turn_c = dot3(light->across, across), turn_s = dot3(cross3(d, light->across), across);
    int reflects = s->refracts < 0.0f;
    Amplitude first, second;
    if (reflects && s->eta == 1.0f) {                       // a mirror of the lens
        F r = root((F)(s->gain));
        first = real_amplitude(-r);
        second = real_amplitude(r);
    } else
        surface_amplitudes(s, c, reflects, &first, &second);
    for (int i = 0; i < 2; ++i) {
        Amplitude a = light->jones[i], b = light->jones[i + 2], turned, other;
        turned.re = a.re * turn_c + b.re * turn_s;
        turned.im = a.im * turn_c + b.im * turn_s;
        other.re = b.re * turn_c - a.re * turn_s;
        other.im = b.im * turn_c - a.im * turn_s;
        light->jones[i] = times(turned, first);
        light->jones[i + 2] = times(other, second);
    }
    light->across = across;
}

// A mirror turns z round, which makes a left-handed frame of a right-handed one.
static void turn_round(Polarisation *light)
{
    light->across.z = -light->across.z;
    for (int i = 2; i < 4; ++i) {
        light->jones[i].re = -light->jones[i].re;
        light->jones[i].im = -light->jones[i].im;
    }
}

#endif
