// Next-event estimation: one emitter per vertex, picked by power or by light/light_tree.h, one direction towards it.
// Rectangles, parallelograms and disks are sampled by area, spheres by the cone that they subtend (stable for small
// angles: 1 - cos is never formed by subtraction) and suns likewise, solids as light/solids.h says, points and directional
// lights exactly, a picture of the environment by its brightness.
#ifndef EMITTERS_H
#define EMITTERS_H
#include "common/curve.h"
#include "light/emitter.h"
#include "light/environment.h"
#include "light/groups.h"
#include "light/emitter_texture.h"
#include "light/point.h"
#if EMITTER_SOLIDS
#include "light/solids.h"
#endif
#if LIGHT_TREE
#include "light/light_tree.h"
#endif

// Probability with which sample_emitter picks emitter e, a lamp with a surface, at p on a surface.
static inline F emitter_pick(Scene scene, I e, F3 p, Receiver receiver)
{
#if LIGHT_TREE
    return pick_of_lamp(scene, e, p, receiver);
#else
    const __global Emitter *es = scene.emitters;
    return OF_EMITTER(F, pick);
#endif
}

// Density, over the solid angle seen from `o`, with which sample_emitter would have chosen the point that a ray along `d`
// met at distance t with cosine `cos_there` on the emitter, if it picks that with probability `pick`.
static F emitter_pdf(const __global Emitter *es, I e, F pick, F3 o, F3 d, F t, F cos_there)
{
    F extent = OF_EMITTER(F, a.w);
    F pdf = pick * t * t / (extent * MAX(cos_there, (F)(1e-20f)));
#if EMITTER_SPHERES
    I sphere = OF_EMITTER(I, kind) == EMITTER_SPHERE;
    F3 to_centre = sub(THREE_OF_EMITTER(a), o);
    F sin2 = extent * extent / dot3(to_centre, to_centre);
    F cone = 2.0f * PI_F * sin2 / (1.0f + root(1.0f - sin2));
    pdf = sphere ? (sin2 < 1.0f ? pick / cone : ZERO) : pdf;
#endif
#if EMITTER_SOLIDS
    I kind = OF_EMITTER(I, kind);
    I solid = kind >= EMITTER_BOX;
    if (ANY(solid))
        pdf = solid ? pick * solid_pdf(es, e, kind, o, d, t) : pdf;
#endif
    return pdf;
}

#if EMITTER_FLATS
static inline I is_flat(I kind)
{
    I flat = (kind == EMITTER_RECTANGLE) | (kind == EMITTER_DISK);
#if EMITTER_TRIANGLES
    flat |= kind == EMITTER_TRIANGLE;
#endif
    return flat;
}

// The place on a flat emitter, along its edges or axes, that two random numbers choose.
static void place_on_flat(I kind, F u, F v, F *x, F *y)
{
    *x = u;
    *y = v;
#if EMITTER_DISKS
    I disk = kind == EMITTER_DISK;
    if (ANY(disk)) {
        F sn, cs;
        sincos_turns(u, &sn, &cs);
        F r = sqrt(v);
        *x = disk ? r * cs : *x;
        *y = disk ? r * sn : *y;
    }
#endif
#if EMITTER_TRIANGLES
    I triangle = kind == EMITTER_TRIANGLE;      // by folding the square along its diagonal
    I beyond = triangle & (*x + *y > 1.0f);
    F folded_x = ONE - *y;
    *y = beyond ? ONE - *x : *y;
    *x = beyond ? folded_x : *x;
#endif
}

// Density and weight of the point at the squared distance d2; s->direction leads there.
static inline void sample_flat(const __global Emitter *es, I e, F pick, I flat, F d2, LightSample *s, F *weight)
{
    F extent = OF_EMITTER(F, a.w);
    F cos_there = -dot3(THREE_OF_EMITTER(normal), s->direction);
    I two_sided = OF_EMITTER(I, two_sided) != 0;
    cos_there = two_sided ? absolute(cos_there) : cos_there;
    I faces = flat & (cos_there > 0.0f);
    s->pdf = faces ? pick * d2 / (extent * cos_there) : s->pdf;
    *weight = faces ? ONE / s->pdf : *weight;
}
#endif

#if LAMPS_BEHIND_GLASS
// Lanes whose light sample follows glass to the lamp.
static inline I follows_glass(I kind)
{
    I follows = FALSE;
#if EMITTER_SPHERES
    follows |= kind == EMITTER_SPHERE;
#endif
#if EMITTER_FLATS
    follows |= is_flat(kind);
#endif
    return follows | (kind == EMITTER_SUN) | (kind == EMITTER_ENVIRONMENT);
}

// Density with which sample_picked chooses the direction d at o where glass stands in the way: d leads straight to a lamp near by.
static F aim_pdf(const __global Emitter *es, I e, F pick, F3 o, F3 d)
{
    I kind = OF_EMITTER(I, kind);
    F3 to = sub(THREE_OF_EMITTER(a), o);
    F t = ONE, cos_there = ONE;
    I meets = FALSE;
#if EMITTER_SPHERES
    F extent = OF_EMITTER(F, a.w);
    F3 off = cross3(to, d);
    meets = (kind == EMITTER_SPHERE) & (dot3(off, off) <= extent * extent) & (dot3(to, d) > 0.0f);
#endif
#if EMITTER_FLATS
    I flat = is_flat(kind);
    if (ANY(flat)) {
        F3 normal = THREE_OF_EMITTER(normal);
        F3 u = THREE_OF_EMITTER(u);
        F3 v = THREE_OF_EMITTER(v);
        F facing = -dot3(normal, d);
        F way = -dot3(normal, to) / facing;
        F3 at = sub(scale(d, way), to);
        F uu = dot3(u, u), uv = dot3(u, v), vv = dot3(v, v), au = dot3(at, u), av = dot3(at, v);
        F all = uu * vv - uv * uv;
        F x = (vv * au - uv * av) / all;
        F y = (uu * av - uv * au) / all;
        I inside = (x >= 0.0f) & (y >= 0.0f) & (x <= 1.0f) & (y <= 1.0f);
#if EMITTER_DISKS
        inside = kind == EMITTER_DISK ? x * x + y * y <= 1.0f : inside;
#endif
#if EMITTER_TRIANGLES
        inside &= (kind != EMITTER_TRIANGLE) | (x + y <= 1.0f);
#endif
        inside &= (way > 0.0f) & ((facing > 0.0f) | (OF_EMITTER(I, two_sided) != 0));
        meets = flat ? inside : meets;
        t = flat ? way : t;
        cos_there = flat ? absolute(facing) : cos_there;
    }
#endif
    return meets ? emitter_pdf(es, e, pick, o, d, t, cos_there) : ZERO;
}
#endif

#if EMITTER_SPHERES || EMITTER_SUNS
// A direction within the cone of a sphere or a sun, whose axis is s->direction; the centre is `distance` away.
static void sample_round(const __global Emitter *es, I e, F pick, I kind, F distance, F d2, F u, F v, LightSample *s,
                         F *weight)
{
    I round = (kind == EMITTER_SPHERE) | (kind == EMITTER_SUN);
    if (!ANY(round))
        return;
    F extent = OF_EMITTER(F, a.w);
    F sin2_max = extent * extent / d2;
#if EMITTER_SUNS
    I sun = kind == EMITTER_SUN;
    sin2_max = sun ? extent : sin2_max;
    s->direction = select3(sun, THREE_OF_EMITTER(normal), s->direction);
#endif
    F versine = u * sin2_max / (1.0f + root(1.0f - sin2_max));      // 1 - cos of the sampled angle
    F sin2 = versine * (2.0f - versine);
    F sn, cs;
    sincos_turns(v, &sn, &cs);
    F sine = root(sin2);
    F3 tx, ty;
    frame(s->direction, &tx, &ty);
    F3 w = from_frame(tx, ty, s->direction, f3(sine * cs, sine * sn, 1.0f - versine));
    F near = distance * (1.0f - versine) - root(extent * extent - d2 * sin2);
    I outside = round & (sin2_max < 1.0f);
    F density = pick * (1.0f + root(1.0f - sin2_max)) / (2.0f * PI_F * sin2_max);
    s->direction = select3(round, w, s->direction);
    s->reach = round ? near : s->reach;
#if EMITTER_SUNS
    s->reach = sun ? (F)(NEVER) : s->reach;
    outside |= sun;
#endif
    s->pdf = outside ? density : s->pdf;
    *weight = outside ? ONE / density : *weight;
}
#endif

#if EMITTER_DIRECTIONS
static inline void sample_directional(const __global Emitter *es, I e, F pick, I kind, LightSample *s, F *weight)
{
    I parallel = kind == EMITTER_DIRECTIONAL;
    s->direction = select3(parallel, THREE_OF_EMITTER(normal), s->direction);
    s->reach = parallel ? (F)(NEVER) : s->reach;
    *weight = parallel ? ONE / pick : *weight;
}
#endif

#if ENVIRONMENT_SAMPLED
static void sample_environment(Scene scene, F pick, I kind, F u, F v, LightSample *s, F *weight)
{
    I sky = kind == EMITTER_ENVIRONMENT;
    if (!ANY(sky))
        return;
    F3 arriving;
    F density;
    F3 w = environment_sample(u, v, scene, &arriving, &density);
    s->direction = select3(sky, w, s->direction);
    s->reach = sky ? (F)(NEVER) : s->reach;
    s->radiance = select3(sky, arriving, s->radiance);
    s->pdf = sky ? pick * density : s->pdf;
#if CAUSTICS || LAMPS_BEHIND_GLASS
    s->primitive = sky ? (I)(FROM_SKY) : s->primitive;
#endif
    *weight = (sky & (density > 0.0f)) ? ONE / s->pdf : *weight;
}
#endif

#if TINY_LAMPS
#define FAR_ROUNDING   4e-6f        // of the distance: how far before or behind it then meets them

// How far a shadow ray goes to a lamp at distance `reach`. Where that is far beside its size the ray ends before what lies
// round the place that was chosen, as other triangles of its mesh. Not where backs shine, which the front of the lamp hides.
static F reach_of_tiny(const __global Emitter *es, I e, I kind, F reach)
{
    F extent = OF_EMITTER(F, a.w);
    F angle = TINY_ANGLE * reach;
    I flat = (kind == EMITTER_RECTANGLE) | (kind == EMITTER_DISK) | (kind == EMITTER_TRIANGLE);
    I tiny = (flat & (extent < angle * angle)) | ((kind >= EMITTER_BOX) & (extent < angle));
    return (tiny & (OF_EMITTER(I, two_sided) == 0)) ? reach * (1.0f - FAR_ROUNDING) : reach;
}
#endif

// The emitter that a random number picks at p, on a surface, and the probability of that.
static inline I pick_lamp(Scene scene, F3 p, Receiver receiver, F u, F *pick)
{
#if LIGHT_TREE
    return pick_emitter(scene, p, receiver, u, pick);
#else
    const __global Emitter *es = scene.emitters;
#if ONE_EMITTER
    I e = FALSE;
#else
    F inside, share;
    I e = cell_at(scene.distribution, FALSE, scene.emitter_count, u, &inside, &share);
#endif
    *pick = OF_EMITTER(F, pick);
    return e;
#endif
}

// One direction for each lane, from p towards emitter e, which was picked with that probability.
static LightSample sample_picked(Scene scene, I e, F pick, F3 p, F u, F v)
{
    const __global Emitter *es = scene.emitters;
    I kind = OF_EMITTER(I, kind);
    F3 a = THREE_OF_EMITTER(a);
    LightSample s;
    s.primitive = OF_EMITTER(I, primitive);
#if EMITTER_TRIANGLES
    s.triangle = OF_EMITTER(I, triangle);
#else
    s.triangle = (I)(NO_TRIANGLE);
#endif
#if LIGHT_GROUPS
    s.group = group_of_emitter(scene, e);
#endif
    s.radiance = THREE_OF_EMITTER(radiance);
    s.pdf = ZERO;
    F weight = ZERO;
    // Go to its centre or position, of a flat one to a point on it.
    F3 to = sub(a, p);
#if EMITTER_FLATS || EMITTER_TEXTURES
    F x = ZERO, y = ZERO;
#endif
#if EMITTER_FLATS
    F3 bu = THREE_OF_EMITTER(u);
    F3 bv = THREE_OF_EMITTER(v);
    I flat = is_flat(kind);
    place_on_flat(kind, u, v, &x, &y);
    to = select3(flat, add(to, add(scale(bu, x), scale(bv, y))), to);
#endif
#if EMITTER_SOLIDS
    I solid = kind >= EMITTER_BOX;
    F solid_density = ZERO;
    if (ANY(solid))
        to = select3(solid, sample_solid(es, e, kind, p, u, v, &solid_density), to);
#endif
    F d2 = dot3(to, to);
    F distance = sqrt(d2);
    s.direction = scale(to, ONE / distance);
    s.reach = distance;
    // Weigh the sample by its density, and turn towards what has no such point.
#if EMITTER_SOLIDS
    I seen = solid & (solid_density > 0.0f);
    s.pdf = seen ? pick * solid_density : s.pdf;
    weight = seen ? ONE / s.pdf : weight;
#endif
#if EMITTER_FLATS
    sample_flat(es, e, pick, flat, d2, &s, &weight);
#endif
#if EMITTER_SPHERES || EMITTER_SUNS
    sample_round(es, e, pick, kind, distance, d2, u, v, &s, &weight);
#endif
#if EMITTER_TEXTURES
    I textured = (OF_EMITTER(I, texture) >= 0) & (s.primitive >= 0) & (weight > 0.0f);
    if (ANY(textured)) {
        F3 there = along(p, s.direction, s.reach);
        s.radiance = select3(textured, textured_radiance(e, textured, x, y, there, scene), s.radiance);
    }
#endif
#if EMITTER_SIZELESS
    sample_point(scene, e, pick, kind, d2, &s, &weight);
#endif
#if EMITTER_DIRECTIONS
    sample_directional(es, e, pick, kind, &s, &weight);
#endif
#if ENVIRONMENT_SAMPLED
    sample_environment(scene, pick, kind, u, v, &s, &weight);
#endif
#if TINY_LAMPS
    s.reach = reach_of_tiny(es, e, kind, s.reach);
#endif
    // Take the radiance at the wavelengths of the path.
#if SPECTRAL_COLOURS
    s.radiance = lamp_colour(scene.spectral, s.radiance, OF_EMITTER(F, radiance.w), scene.colours);
#endif
#if LAMPS_BEHIND_GLASS
    s.weight = follows_glass(kind) ? weight : ZERO;
    s.primitive = kind == EMITTER_SUN ? FROM_SUN - e : s.primitive;
#endif
    s.radiance = scale(s.radiance, weight);
    return s;
}

// One emitter for each lane, and one direction towards it from p, on a surface.
static inline LightSample sample_emitter(Scene scene, F3 p, Receiver receiver, F pick_u, F u, F v)
{
    F pick;
    I e = pick_lamp(scene, p, receiver, pick_u, &pick);
    return sample_picked(scene, e, pick, p, u, v);
}

#endif
