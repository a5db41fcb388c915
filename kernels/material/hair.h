// A fibre of hair (Chiang et al. 2016, after Marschner et al. 2003 and d'Eon et al. 2011): light is reflected (R), passes the
// fibre (TT), is reflected in it once (TRT) or more often, each a lobe of its own along the fibre (M) and round it (N).
// In the frame of the fibre x lies along it, y across as the path sees it and z towards the path; `across` is where the
// path meets the fibre, -1 to 1. The value is that of the BSDF times the cosine, which cancels.
#ifndef HAIR_H
#define HAIR_H
#include "common/angles.h"
#include "common/exponential.h"
#include "material/bsdf.h"

#if HAS_HAIR
#define HAIR_LOBES 4        // R, TT, TRT and all that follows

static inline I hair_is(I kind) { return kind == MATERIAL_HAIR; }

// What is the same for every direction on.
typedef struct {
    F  sine, cosine, azimuth;       // of the direction to the path
    F  gamma_out, gamma_in;         // angles at the fibre's surface, outside and inside [rad]
    F3 share[HAIR_LOBES];           // of light that each lobe sends on
    F  chance[HAIR_LOBES];          // of choosing it
    F  scale, whole;                // of the logistic distribution round the fibre, and its integral over -pi to pi
} Fibre;

static inline F arc_sine(F x) { return 2.0f * PI_F * turns_of(root(1.0f - x * x), x); }

// The sine and cosine that a direction has to the normals of the cuticle of a lobe.
static inline void tilted(Vertex vertex, Fibre f, int lobe, F *sine, F *cosine)
{
    F s = vertex.closure.hair_tilt;
    F c = root(1.0f - s * s);
    F s2 = 2.0f * s * c;
    F c2 = c * c - s * s;
    F turn = lobe == 0 ? -s2 : lobe == 1 ? s : lobe == 2 ? 2.0f * s2 * c2 : ZERO;
    F rest = lobe == 0 ? c2 : lobe == 1 ? c : lobe == 2 ? c2 * c2 - s2 * s2 : ONE;
    *sine = f.sine * rest + f.cosine * turn;
    *cosine = absolute(f.cosine * rest - f.sine * turn);
}

static inline F hair_variance(Vertex vertex, int lobe)
{
    return vertex.closure.hair_variance * (lobe == 0 ? 1.0f : lobe == 1 ? 0.25f : 4.0f);
}

// I0, the modified Bessel function, over exp(x): its series to 10 terms, or its expansion for large x (error below 1e-4).
static F bessel_scaled(F x)
{
    F square = 0.25f * x * x;
    F term = ONE, sum = ONE;
    for (int k = 1; k < 20; ++k) {
        term *= square * (1.0f / (float)(k * k));
        sum += term;
    }
    F inverse = ONE / MAX(x, ONE);
    F large = sqrt(0.159154943f * inverse) * (1.0f + inverse * (0.125f + inverse * (0.0703125f + inverse * 0.0732421875f)));
    return x < 12.0f ? sum * exponential(-MIN(x, (F)(12.0f))) : large;
}

// Density along the fibre (d'Eon et al. 2011): exp(-s s' / v) I0(c c' / v) / (2 v sinh(1 / v)), exponents put together.
static F along_fibre(F sine_in, F cosine_in, F sine_out, F cosine_out, F v)
{
    F inverse = ONE / v;
    F a = cosine_in * cosine_out * inverse;
    F b = sine_in * sine_out * inverse;
    return bessel_scaled(a) * exponential(MIN(a - b - inverse, (F)(60.0f))) * inverse / (1.0f - exponential(-2.0f * inverse));
}

static inline F logistic(F x, F s)      // its integral from -infinity to x
{
    F e = exponential(-absolute(x) / s);
    return x < 0.0f ? e / (1.0f + e) : 1.0f / (1.0f + e);
}

// The azimuth by which a lobe turns light, and the density of one that is `turn` farther [rad].
static inline F turn_of(Fibre f, int lobe) { return 2.0f * (float)lobe * f.gamma_in - 2.0f * f.gamma_out + (float)lobe * PI_F; }

static F round_fibre(Fibre f, F turn, int lobe)
{
    F x = turn - turn_of(f, lobe);
    x -= 2.0f * PI_F * FLOOR(x * (0.5f * INV_PI_F) + 0.5f);
    F e = exponential(-absolute(x) / f.scale);
    return e / (f.scale * (1.0f + e) * (1.0f + e) * f.whole);
}

static Fibre fibre_of(Vertex vertex, F3 w)
{
    Fibre f;
    f.sine = MIN(MAX(w.x, (F)(-1.0f)), ONE);
    f.cosine = root(1.0f - f.sine * f.sine);
    f.azimuth = 2.0f * PI_F * turns_of(w.y, w.z);
    F h = vertex.closure.across;
    F index = vertex.parameter;
    F bent = sqrt(index * index - f.sine * f.sine) / MAX(f.cosine, (F)(1e-4f));     // index across the fibre
    F inner = h / bent;
    f.gamma_out = arc_sine(h);
    f.gamma_in = arc_sine(inner);
    F inner_sine = f.sine / index;
    F way = -2.0f * root(1.0f - inner * inner) / sqrt(1.0f - inner_sine * inner_sine);
    // The colour of much hair, turned into absorption per radius.
    F3 root_of = f3(logarithm(MAX(vertex.color.x, (F)(1e-6f))), logarithm(MAX(vertex.color.y, (F)(1e-6f))),
                    logarithm(MAX(vertex.color.z, (F)(1e-6f))));
    root_of = scale(root_of, ONE / vertex.closure.hair_depth);
    F3 t = f3(exponential(root_of.x * root_of.x * way), exponential(root_of.y * root_of.y * way),
              exponential(root_of.z * root_of.z * way));
    F unused;
    F r = fresnel(f.cosine * root(1.0f - h * h), index, &unused);
    F past = (1.0f - r) * (1.0f - r);
    f.share[0] = f3(r, r, r);
    f.share[1] = scale(t, past);
    f.share[2] = scale(mul(f.share[1], t), r);
    F3 again = scale(mul(f.share[2], t), r);
    f.share[3] = f3(again.x / (1.0f - t.x * r), again.y / (1.0f - t.y * r), again.z / (1.0f - t.z * r));
    F sum = ZERO;
    for (int k = 0; k < HAIR_LOBES; ++k) {
        f.chance[k] = f.share[k].x + f.share[k].y + f.share[k].z;
        sum += f.chance[k];
    }
    for (int k = 0; k < HAIR_LOBES; ++k)
        f.chance[k] /= sum;
    f.scale = vertex.closure.hair_scale;
    f.whole = 2.0f * logistic((F)(PI_F), f.scale) - 1.0f;
    return f;
}

static F3 fibre_eval(Vertex vertex, Fibre f, F3 w, F *pdf)
{
    F sine = MIN(MAX(w.x, (F)(-1.0f)), ONE);
    F cosine = root(1.0f - sine * sine);
    F turn = 2.0f * PI_F * turns_of(w.y, w.z) - f.azimuth;
    F3 sum = f3(ZERO, ZERO, ZERO);
    *pdf = ZERO;
    for (int k = 0; k < HAIR_LOBES; ++k) {
        F s, c;
        tilted(vertex, f, k, &s, &c);
        F density = along_fibre(sine, cosine, s, c, hair_variance(vertex, k));
        density *= k < 3 ? round_fibre(f, turn, k) : (F)(0.5f * INV_PI_F);
        sum = along(sum, f.share[k], density);
        *pdf += density * f.chance[k];
    }
    return sum;
}

static inline void fibre_frame(Vertex vertex, F3 d, F3 *x, F3 *y, F3 *z)
{
    F length2 = dot3(vertex.tangent, vertex.tangent);
    *x = scale(vertex.tangent, ONE / sqrt(MAX(length2, (F)(SMALLEST))));
    F3 side = cross3(*x, d);
    F size2 = dot3(side, side);
    F3 other, unused;
    frame(*x, &other, &unused);
    *y = select3(size2 > SMALLEST, scale(side, ONE / sqrt(MAX(size2, (F)(SMALLEST)))), other);
    *z = cross3(*x, *y);
}

static F3 hair_eval(Vertex vertex, F3 d, Side side, F3 wo, F *pdf)
{
    F3 x, y, z;
    fibre_frame(vertex, d, &x, &y, &z);
    Fibre f = fibre_of(vertex, to_frame(x, y, z, scale(d, -ONE)));
    return fibre_eval(vertex, f, to_frame(x, y, z, wo), pdf);
}

static Scattered hair_sample(Vertex vertex, F3 d, Side side, F u, F v, F lobe)
{
    F3 x, y, z;
    fibre_frame(vertex, d, &x, &y, &z);
    Fibre f = fibre_of(vertex, to_frame(x, y, z, scale(d, -ONE)));
    // Choose a lobe, and keep what is left of its number for the turn round the fibre.
    F below = ZERO;
    F s, c, variance = ONE, centre = ZERO, rest = lobe;
    tilted(vertex, f, HAIR_LOBES - 1, &s, &c);
    I found = FALSE;
    I last = TRUE;
    for (int k = 0; k < HAIR_LOBES; ++k) {
        I mine = NOT(found) & ((lobe < below + f.chance[k]) | (I)(k == HAIR_LOBES - 1 ? -1 : 0));
        F own_s, own_c;
        tilted(vertex, f, k, &own_s, &own_c);
        s = mine ? own_s : s;
        c = mine ? own_c : c;
        variance = mine ? hair_variance(vertex, k) : variance;
        centre = mine ? turn_of(f, k) : centre;
        rest = mine ? (lobe - below) / MAX(f.chance[k], (F)(SMALLEST)) : rest;
        last = mine ? (I)(k == HAIR_LOBES - 1 ? -1 : 0) : last;
        found = found | mine;
        below += f.chance[k];
    }
    rest = MIN(MAX(rest, ZERO), (F)(0.99999994f));
    // Along the fibre.
    F height = MAX(1.0f + variance * logarithm(MAX(u, (F)(1e-5f)) + (1.0f - u) * exponential(-2.0f / variance)), (F)(-1.0f));
    F aside = root(1.0f - height * height);
    F sn, cs;
    sincos_turns(v, &sn, &cs);
    F sine = MIN(MAX(aside * cs * c - height * s, (F)(-1.0f)), ONE);
    F cosine = root(1.0f - sine * sine);
    // Round it: the logistic distribution cut at half a turn.
    F low = logistic((F)(-PI_F), f.scale);
    F share = MIN(MAX(low + rest * f.whole, (F)(1e-7f)), (F)(0.9999999f));
    F turn = centre - f.scale * logarithm((1.0f - share) / share);
    turn = last ? 2.0f * PI_F * rest : turn;
    F azimuth = (f.azimuth + turn) * (0.5f * INV_PI_F);
    sincos_turns(azimuth - FLOOR(azimuth), &sn, &cs);
    F3 w = f3(sine, cosine * cs, cosine * sn);
    Scattered out;
    F3 value = fibre_eval(vertex, f, w, &out.pdf);
    out.direction = from_frame(x, y, z, w);
    out.weight = scale(value, ONE / MAX(out.pdf, (F)(SMALLEST)));
    return out;
}
#endif

#endif
