// The way of a path through media to its next vertex: on a surface, or where a medium scatters it. Distances are sampled by
// the transmittance of one of the path's three wavelengths, weighted against the others by their throughput (Wilkie et al.
// 2014), and what a medium scatters once towards the path is estimated twice: there, and at a distance that is chosen by the
// angle that it has as a lamp sees it (Kulla and Fajardo 2012), weighted against each other by the balance heuristic.
#ifndef MEDIA_H
#define MEDIA_H
#include "common/angles.h"
#include "geometry/nearest.h"
#include "integrator/column.h"
#include "integrator/path.h"

#if LIGHT_GROUPS
#define GLOW_GROUP    (LIGHT_GROUPS - 1)  // of media, which no lamp lights
#else
#define GLOW_GROUP    0
#endif
#define MOST_BOUNDARIES 64u     // that a ray may pass on its way to a vertex or a lamp
#define LEAST_ALBEDO    0.1f    // by which wavelengths count that a medium hardly scatters
#define SHORT_OF_LAMP   0.99999f    // share of the way to a lamp behind which is the lamp itself

#if HAS_BOUNDARY
// Takes the rays of the lanes `on` past the surface that they hit, and their stacks into what is behind; false where that
// is a surface of its own.
static I pass_boundary(Ray *ray, Hit hit, I *stack, I on, Scene scene)
{
    Vertex vertex = vertex_of(*ray, hit, on, ZERO, scene);
    I boundary = on & (vertex.kind == MATERIAL_BOUNDARY);
    *stack = boundary ? stack_beyond(*stack, hit.primitive, vertex.ng, ray->d, ray->d, scene) : *stack;
    ray->o = select3(on, departure(vertex, ray->d), ray->o);
    ray->origin = on ? hit.primitive : ray->origin;
    ray->triangle = on ? hit.triangle : ray->triangle;
    return boundary;
}
#endif

// What media leave of the light of shadow rays that nothing blocks.
static F3 shadow_transmittance(Ray ray, I stack, F reach, I on, Scene scene)
{
    F3 left = f3(ONE, ONE, ONE);
#if HAS_BOUNDARY
    reach = MIN(reach, (F)(FARTHEST));
    F margin = reach * (1.0f - SHORT_OF_LAMP);
    for (uint step = 0u; step < MOST_BOUNDARIES && ANY(on); ++step) {
        ray.origin = on ? ray.origin : (I)(PATH_ENDED);
        Hit hit = nearest_hit(ray, scene);
        I before = on & (hit.primitive >= 0) & (hit.t < reach - margin);
        F way = before ? hit.t : reach;
        Inside medium = inside_of(stack, on, scene);
        left = select3(on, mul(left, transmittance_of(medium.extinction, column_of(medium, ray, way))), left);
        on = before;
        if (ANY(on))
            pass_boundary(&ray, hit, &stack, on, scene);    // or what shadow rays do not see
        reach -= way;
    }
#else
    Inside medium = inside_of(stack, on, scene);
    left = transmittance_of(medium.extinction, column_of(medium, ray, MIN(reach, (F)(FARTHEST))));
#endif
    return left;
}

// A piece of a path's way, in one medium.
typedef struct {
    Ray  ray;
    F    length;
    Inside medium;
    F3   shares;        // with which each wavelength chooses the distance
    U    dimension;     // of its random numbers
} Stretch;

// Density with which the transmittance chooses a column.
static inline F density_at(Stretch s, F column)
{
    return dot3(mul(s.shares, s.medium.extinction), transmittance_of(s.medium.extinction, column));
}

#if HAS_EMITTERS
// Distances spread evenly over the angle in which a point sees the stretch.
typedef struct { F aside, ahead, turns; } Equiangular;    // its distance from the line, how far ahead it is, the angle

static Equiangular seen_from(F3 point, Stretch s)
{
    Equiangular view;
    F3 to = sub(point, s.ray.o);
    view.ahead = dot3(to, s.ray.d);
    F3 off = along(to, s.ray.d, -view.ahead);
    view.aside = MAX(sqrt(dot3(off, off)), 1e-5f * (absolute(view.ahead) + 1e-3f));
    view.turns = turns_of(view.aside * view.aside - view.ahead * (s.length - view.ahead), view.aside * s.length);
    return view;
}

static inline F equiangular_density(Equiangular view, F t)
{
    F beyond = t - view.ahead;
    return view.aside / (2.0f * PI_F * MAX(view.turns, (F)(1e-12f)) * (view.aside * view.aside + beyond * beyond));
}

static inline F equiangular_distance(Equiangular view, F u, F length)
{
    F sn, cs;
    sincos_turns(u * view.turns, &sn, &cs);
    F t = sn * (view.aside * view.aside + view.ahead * view.ahead) / MAX(view.aside * cs + view.ahead * sn, (F)(SMALLEST));
    return MIN(MAX(t, ZERO), length);
}

// The middle of an emitter, and whether it has one: those at infinity do not.
static F3 middle_of(const __global Emitter *es, I e, I *near)
{
    I kind = OF_EMITTER(I, kind);
    *near = (kind != EMITTER_DIRECTIONAL) & (kind != EMITTER_SUN) & (kind != EMITTER_ENVIRONMENT);
    F3 middle = THREE_OF_EMITTER(a);
#if EMITTER_FLATS
    F share = kind == EMITTER_RECTANGLE ? (F)(0.5f) : (kind == EMITTER_TRIANGLE ? (F)(1.0f / 3.0f) : ZERO);
    middle = add(middle, scale(add(THREE_OF_EMITTER(u), THREE_OF_EMITTER(v)), share));
#endif
    return middle;
}

// Adds the light that the stretches of the lanes `on` scatter once towards their path: of a lamp picked where the
// transmittance scatters the path, at `met` in the lanes `scatters`, and of one picked for the stretch as a whole.
static void add_scattered(Path *path, Stretch s, F met, I scatters, I on, Scene scene, Rules rules)
{
    Receiver nowhere = all_round();
    F3 mean = s.medium.extinction;
    F middle = MIN(0.5f * column_of(s.medium, s.ray, s.length), 3.0f / (mean.x + mean.y + mean.z));
    F3 amid = along(s.ray.o, s.ray.d, distance_after(s.medium, s.ray, middle));
    F g = GATHER(F, scene.media, path->medium & MEDIUM_MASK, .asymmetry);
    F3 per_metre = mul(path->beta, s.medium.scattering);
#pragma nounroll
    for (uint way = 0u; way < 2u; ++way) {
        I wanted = way == 0u ? scatters : on;
        if (!ANY(wanted))
            continue;
        // Choose a lamp, and where on the stretch.
        F4 u = random4(path->pixel, path->sample, s.dimension + 2u * way + 1u, rules.seed);
        F first, other;
        F3 p = way == 0u ? along(s.ray.o, s.ray.d, MIN(met, s.length)) : amid;
        I e = pick_lamp(scene, p, nowhere, u.a, &first);
        I near;
        Equiangular view = seen_from(middle_of(scene.emitters, e, &near), s);
        F t = way == 0u ? met : equiangular_distance(view, u.d, s.length);
        wanted = wanted & (near | (I)(way == 0u ? -1 : 0));
        p = along(s.ray.o, s.ray.d, t);
        other = emitter_pick(scene, near ? e : FALSE, way == 0u ? amid : p, nowhere);
        other = near ? other : ZERO;
        // Take light from there.
        F here = way == 0u ? first : other;         // probability of the lamp at the place itself
        F whole = way == 0u ? other : first;        // and for the stretch
        LightSample light = sample_picked(scene, e, here, p, u.b, u.c);
        F phase = henyey_greenstein(g, dot3(s.ray.d, light.direction));
        F column = column_of(s.medium, s.ray, t);
        F spread = near ? equiangular_density(view, t) : ZERO;
#if HAS_LAYERED_FOG
        // Densities are per metre of the column, as what is scattered is.
        spread = MIN(spread / MAX(relative_density(s.medium, s.ray, t), (F)(SMALLEST)), (F)(LARGEST_DENSITY));
#endif
        F both_ways = density_at(s, column) * here + whole * spread;
        F weight = phase * here / MAX(both_ways, (F)(SMALLEST));
#if !LAMPS_BY_SAMPLES
        F rival = MIN(light.pdf, (F)(LARGEST_DENSITY));
        weight *= rival > 0.0f ? rival * rival / (rival * rival + phase * phase) : ONE;
#endif
        F3 added = scale(mul(mul(per_metre, transmittance_of(s.medium.extinction, column)), light.radiance), weight);
        F reach = (wanted & (max3(added) > 0.0f)) ? light.reach : ZERO;
        I lit = reach > 0.0f;
        if (!ANY(lit))
            continue;
        // Add it where nothing is in the way.
        Ray ray = s.ray;
        ray.o = p;
        ray.d = light.direction;
        ray.origin = (I)(IN_MEDIUM);
        ray.triangle = (I)(NO_TRIANGLE);
        lit = lit & NOT(any_hit(ray, reach, light.primitive, light.triangle, scene));
        if (ANY(lit)) {
            added = mul(added, shadow_transmittance(ray, path->medium, light.reach, lit, scene));
            gather_light(path, lit, added, group_of_emitter(scene, e));
        }
    }
}
#endif

// Takes the paths of the lanes `on` along a stretch: adds what it emits and scatters towards them, and its transmittance.
// Returns which of them it scatters, at distance *met.
static I pass_stretch(Path *path, Stretch s, I on, F *met, Scene scene, Rules rules)
{
    F3 extinction = s.medium.extinction;
    F3 glow = s.medium.glow;
    F whole = column_of(s.medium, s.ray, s.length);
    if (ANY(on & (max3(glow) > 0.0f))) {
        F3 all = scale(f3(mean_transmittance(extinction.x * whole), mean_transmittance(extinction.y * whole),
                          mean_transmittance(extinction.z * whole)), whole);
        gather_light(path, on, mul(path->beta, mul(glow, all)), (I)(GLOW_GROUP));
    }
    on = on & has_extinction(s.medium);
    I murky = on & (max3(s.medium.scattering) > 0.0f);
    I scatters = FALSE;
    F3 left = transmittance_of(extinction, whole);
    if (ANY(murky)) {
        // Choose a distance by the transmittance of one of three.
        F3 albedo = f3(s.medium.scattering.x / MAX(extinction.x, (F)(SMALLEST)),
                       s.medium.scattering.y / MAX(extinction.y, (F)(SMALLEST)),
                       s.medium.scattering.z / MAX(extinction.z, (F)(SMALLEST)));
        s.shares = f3(path->beta.x * MAX(albedo.x, (F)(LEAST_ALBEDO)), path->beta.y * MAX(albedo.y, (F)(LEAST_ALBEDO)),
                      path->beta.z * MAX(albedo.z, (F)(LEAST_ALBEDO)));
        s.shares = scale(s.shares, ONE / MAX(s.shares.x + s.shares.y + s.shares.z, (F)(SMALLEST)));
        F4 u = random4(path->pixel, path->sample, s.dimension, rules.seed);
        F chosen = u.a < s.shares.x ? extinction.x : (u.a < s.shares.x + s.shares.y ? extinction.y : extinction.z);
        F column = -logarithm(MAX(1.0f - u.b, (F)(1e-9f))) / MAX(chosen, (F)(1e-20f));
        F t = MIN(distance_after(s.medium, s.ray, column), s.length);
        scatters = murky & (column < whole);
#if HAS_EMITTERS
        I lightable = murky & (path->depth < rules.max_depth);
        if (ANY(lightable))
            add_scattered(path, s, t, scatters & lightable, lightable, scene, rules);
#endif
        F3 over = transmittance_of(extinction, column);
        F3 scattered = scale(mul(s.medium.scattering, over), ONE / MAX(density_at(s, column), (F)(SMALLEST)));
        F3 passed = scale(left, ONE / MAX(dot3(s.shares, left), (F)(SMALLEST)));
        left = select3(scatters, scattered, select3(murky, passed, left));
        *met = t;
    }
    path->beta = select3(on, mul(path->beta, left), path->beta);
    return scatters;
}

// What a path meets next: a surface, or IN_MEDIUM where it is scattered, at a distance from its last vertex.
static Hit travel_on(Path *path, Scene scene, Rules rules)
{
    Ray ray = path->ray;
    I on = ray.origin != PATH_ENDED;
    F behind = ZERO;
    Hit result;
    result.primitive = (I)(NO_PRIMITIVE);
    result.t = (F)(NEVER);
    result.triangle = (I)(NO_TRIANGLE);
    result.b1 = ZERO;
    result.b2 = ZERO;
    for (uint step = 0u; step < MOST_BOUNDARIES && ANY(on); ++step) {
        ray.origin = on ? ray.origin : (I)(PATH_ENDED);
        Hit hit = nearest_hit(ray, scene);
        Stretch s;
        s.ray = ray;
        s.length = MIN(hit.t, (F)(FARTHEST));
        s.medium = inside_of(path->medium, on, scene);
        s.dimension = 0x40000000u + 4u * (path->depth * MOST_BOUNDARIES + step);
        s.shares = f3(ZERO, ZERO, ZERO);
        I foggy = on & (has_extinction(s.medium) | (max3(s.medium.glow) > 0.0f));
        I scatters = FALSE;
        F met = ZERO;
        if (ANY(foggy))
            scatters = pass_stretch(path, s, foggy, &met, scene, rules);
        result.primitive = on ? (scatters ? (I)(IN_MEDIUM) : hit.primitive) : result.primitive;
        result.t = on ? behind + (scatters ? met : hit.t) : result.t;
        result.triangle = on ? (scatters ? (I)(NO_TRIANGLE) : hit.triangle) : result.triangle;
        result.b1 = on ? hit.b1 : result.b1;
        result.b2 = on ? hit.b2 : result.b2;
        on = on & NOT(scatters) & (hit.primitive >= 0);
#if HAS_BOUNDARY
        if (ANY(on)) {
            on = pass_boundary(&ray, hit, &path->medium, on, scene);
            behind += on ? hit.t : ZERO;
        }
#else
        on = FALSE;
#endif
    }
    // A path that only boundaries hold goes no farther.
    path->ray.origin = on ? (I)(PATH_ENDED) : path->ray.origin;
    return result;
}

#endif
