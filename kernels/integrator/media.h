// The way of a path through media to its next vertex: on a surface, or where a medium scatters it. Distances are sampled by
// the transmittance of one of the path's three wavelengths, weighted against the others by their throughput (Wilkie et al.
// 2014), and what a medium scatters once towards the path is estimated twice: there, and at a distance that is chosen by the
// angle that it has as a lamp sees it (Kulla and Fajardo 2012), weighted against each other by the balance heuristic.
#ifndef MEDIA_H
#define MEDIA_H
#include "common/angles.h"
#include "geometry/nearest.h"
#include "integrator/column.h"
#include "integrator/density.h"
#include "integrator/path.h"

#if LIGHT_GROUPS
#define GLOW_GROUP    (LIGHT_GROUPS - 1)  // of media, which no lamp lights
#else
#define GLOW_GROUP    0
#endif
#define MOST_BOUNDARIES 1024u   // that a ray may pass on its way to a vertex or a lamp
#define LEAST_ALBEDO    0.1f    // by which wavelengths count that a medium hardly scatters
#if HAS_DENSITY
// Dimensions of random numbers that go on without end, beside those of a stretch.
#define TO_COLLIDE     0x10000000u
#define TO_THE_POINT   0x10000001u
#define TO_THE_LAMP    0x20000000u
#define TO_GLOW        0x20000002u
#define FROM_A_SURFACE 0x70000000u
#define LEAST_LIKELY   1e-20f   // density by which ways to sample along a grid are weighed: its own is not known
#endif
#define HAS_BEAMS (EMITTER_SPOTS && !HAS_BOUNDARY && !HAS_DENSITY && !HAS_ABSORPTION && !HAS_DISPERSION && !HAS_ENTRIES)
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

// What a medium leaves of light along a way.
static F3 left_along(Ray ray, F way, Inside medium, I on, Scene scene WITH_CHANCE(Chance *chance))
{
    F3 left = transmittance_of(medium.extinction, column_of(medium, ray, way));
#if HAS_DENSITY
    I gridded = on & (medium.grid > 0) & has_extinction(medium);
    if (ANY(gridded)) {
        F guess = ZERO;
        enter_grid(&ray, &way, medium.grid, gridded, grids_of(scene));
        F3 tracked = track_ratio(ray, way, medium.grid, medium.extinction, max3(medium.extinction), chance, gridded, &guess,
                                 0, grids_of(scene));
        left = select3(gridded, tracked, left);
    }
#endif
    return left;
}

// What media leave of the light of shadow rays that nothing blocks.
static F3 shadow_transmittance(Ray ray, I stack, F reach, I on, Scene scene WITH_CHANCE(Chance chance))
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
        left = select3(on, mul(left, left_along(ray, way, medium, on, scene WITH_CHANCE(&chance))), left);
        on = before;
        if (ANY(on))
            pass_boundary(&ray, hit, &stack, on, scene);    // or what shadow rays do not see
        reach -= way;
    }
#else
    Inside medium = inside_of(stack, on, scene);
    left = left_along(ray, MIN(reach, (F)(FARTHEST)), medium, on, scene WITH_CHANCE(&chance));
#endif
    return left;
}

// What a camera ray meets first but for boundaries, and what media leave of light on the way there.
static Hit hit_through_media(Ray ray, F3 *left, I on, Scene scene WITH_CHANCE(Chance chance))
{
    I stack = (I)(scene.media_at_camera);
    F behind = ZERO;
    Hit hit = nearest_hit(ray, scene);
    *left = f3(ONE, ONE, ONE);
    for (uint step = 0u; step < MOST_BOUNDARIES && ANY(on); ++step) {
        Inside medium = inside_of(stack, on, scene);
        F3 there = left_along(ray, MIN(hit.t, (F)(FARTHEST)), medium, on, scene WITH_CHANCE(&chance));
        *left = select3(on, mul(*left, there), *left);
        on = on & (hit.primitive >= 0);
#if HAS_BOUNDARY
        if (ANY(on)) {
            on = pass_boundary(&ray, hit, &stack, on, scene);
            behind += on ? hit.t : ZERO;
            ray.origin = on ? ray.origin : (I)(PATH_ENDED);
            Hit next = nearest_hit(ray, scene);
            hit.primitive = on ? next.primitive : hit.primitive;
            hit.t = on ? next.t : hit.t;
            hit.triangle = on ? next.triangle : hit.triangle;
            hit.b1 = on ? next.b1 : hit.b1;
            hit.b2 = on ? next.b2 : hit.b2;
        }
#else
        on = FALSE;
#endif
    }
    hit.t += behind;
    return hit;
}

// A piece of a path's way, in one medium.
typedef struct {
    Ray  ray;
    F    length;
    Inside medium;
    F3   shares;        // with which each wavelength chooses the distance
    F    chosen;        // the extinction of the one that has,
    F    column;        // and the column after which it scatters
    U    dimension;     // of its random numbers
#if HAS_DENSITY
    I    gridded;       // whether its density is a grid's, within whose box it is then
#endif
} Stretch;

// Density with which the transmittance chooses a column.
static inline F density_at(Stretch s, F column)
{
    return dot3(mul(s.shares, s.medium.extinction), transmittance_of(s.medium.extinction, column));
}

#if HAS_EMITTERS
// Distances spread evenly over the angle in which a point sees the stretch.
typedef struct {
    F start, length;            // of the part of the stretch
    F aside, ahead, turns;      // distance of the point from the line, how far ahead of the start it is, the angle
} Equiangular;

static Equiangular seen_from(F3 point, Ray ray, F start, F end)
{
    Equiangular view;
    F3 to = sub(point, ray.o);
    view.ahead = dot3(to, ray.d);
    F3 off = along(to, ray.d, -view.ahead);
    view.aside = MAX(sqrt(dot3(off, off)), 1e-5f * (absolute(view.ahead) + 1e-3f));
    view.ahead -= start;
    view.start = start;
    view.length = end - start;
    view.turns = turns_of(view.aside * view.aside - view.ahead * (view.length - view.ahead), view.aside * view.length);
    return view;
}

static inline F equiangular_density(Equiangular view, F t)
{
    t -= view.start;
    F beyond = t - view.ahead;
    F density = view.aside / (2.0f * PI_F * MAX(view.turns, (F)(1e-12f)) * (view.aside * view.aside + beyond * beyond));
    return ((t >= 0.0f) & (t <= view.length)) ? density : ZERO;
}

static inline F equiangular_distance(Equiangular view, F u)
{
    F sn, cs;
    sincos_turns(u * view.turns, &sn, &cs);
    F t = sn * (view.aside * view.aside + view.ahead * view.ahead) / MAX(view.aside * cs + view.ahead * sn, (F)(SMALLEST));
    return view.start + MIN(MAX(t, ZERO), MAX(view.length, ZERO));
}

#if EMITTER_SPOTS
// The part of a ray that the cone of a spot lights; of other lamps, and of cones wider than a half space, it stays.
static void within_cone(const __global Emitter *es, I e, Ray ray, F *start, F *end)
{
    F3 axis = THREE_OF_EMITTER(normal);
    F cap = OF_EMITTER(F, u.w);
    F cosine = 1.0f - cap;
    F c2 = cosine * cosine, s2 = cap * (2.0f - cap);
    // From the place nearest to the apex, and across the axis: differences of squares would lose a cone that is thin there.
    F3 q = sub(ray.o, THREE_OF_EMITTER(a));
    F nearest = -dot3(q, ray.d);
    q = along(q, ray.d, nearest);
    F rise = dot3(ray.d, axis), high = dot3(q, axis);
    F3 turn = along(ray.d, axis, -rise), off = along(q, axis, -high);
    // s2 (high + t rise)^2 = c2 (off + t turn)^2
    F a = s2 * rise * rise - c2 * dot3(turn, turn);
    a = absolute(a) > SMALLEST ? a : (F)(SMALLEST);
    F b = s2 * high * rise - c2 * dot3(off, turn);
    F c = s2 * high * high - c2 * dot3(off, off);
    F under = b * b - a * c;
    F r = -b - with_sign(root(under), b);
    F one = r / a;
    F two = absolute(r) > SMALLEST ? c / r : one;
    F low = MIN(one, two), top = MAX(one, two);
    I across = a < 0.0f;        // the ray meets the cone on its way in and out, or neither
    I met = (under > 0.0f) & (high + 0.5f * (low + top) * rise > 0.0f);
    low += nearest;
    top += nearest;
    F from = across ? (met ? low : *end) : (rise > 0.0f ? top : *start);
    F to = across ? (met ? top : *start) : (rise > 0.0f ? *end : low);
    I cone = (OF_EMITTER(I, kind) == EMITTER_SPOT) & (cosine > 0.0f);
    *start = cone ? MIN(MAX(from, *start), *end) : *start;
    *end = cone ? MAX(MIN(to, *end), *start) : *end;
}
#endif

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

// Whether an emitter lies at infinity, and the probability with which it is picked at a point then.
static inline int is_afar(int kind)
{
    return kind == EMITTER_DIRECTIONAL || kind == EMITTER_SUN || kind == EMITTER_ENVIRONMENT;
}

static inline F pick_afar_at(Scene scene, int e, F3 p)
{
#if LIGHT_TREE
    return pick_of_distant(scene, e, p, all_round());
#else
    return (F)(scene.emitters[e].pick);
#endif
}

// The part of a ray that lies before a flat lamp, where its back does not shine.
#if EMITTER_FLATS
static void before_lamp(const __global Emitter *es, I e, Ray ray, F *start, F *end)
{
    F3 axis = THREE_OF_EMITTER(normal);
    F high = dot3(sub(ray.o, THREE_OF_EMITTER(a)), axis);
    F rise = dot3(ray.d, axis);
    F level = -high / (absolute(rise) > SMALLEST ? rise : (F)(SMALLEST));
    I faces = is_flat(OF_EMITTER(I, kind)) & (OF_EMITTER(I, two_sided) == 0);
    *start = (faces & (rise > 0.0f)) ? MIN(MAX(level, *start), *end) : *start;
    *end = (faces & (rise <= 0.0f)) ? MAX(MIN(level, *end), *start) : *end;
}
#endif

// The part of a stretch that a lamp lights, and distances spread evenly over the angle in which it sees that.
static Equiangular lit_part(const __global Emitter *es, I e, Stretch s, I *near)
{
    F start = ZERO, end = s.length;
#if EMITTER_SPOTS
    within_cone(es, e, s.ray, &start, &end);
#endif
#if EMITTER_FLATS
    before_lamp(es, e, s.ray, &start, &end);
#endif
    Equiangular view = seen_from(middle_of(es, e, near), s.ray, start, end);
    *near = *near & (end > start);
    return view;
}

// How a medium scatters, as far as picks of lamps know.
typedef struct { F g; F3 droplets; F extinction; } Air;

#define LEAST_PHASE 0.02f   // so that no lamp is ruled out by an estimate

// About the light that a lamp near by sends to a stretch, or to a place of it at distance t, which scatter it towards the path.
static F light_in_air(const __global Emitter *es, I e, Stretch s, Air air, F t, int of_stretch)
{
    I near;
    F3 middle = middle_of(es, e, &near);
    F bright = OF_EMITTER(F, pick);
#if EMITTER_SPOTS
    I spot = OF_EMITTER(I, kind) == EMITTER_SPOT;
    bright = spot ? 2.0f * bright / MAX(OF_EMITTER(F, u.w), (F)(SMALLEST)) : bright;
#endif
    F spread;
    if (of_stretch) {
        Equiangular view = lit_part(es, e, s, &near);
        t = equiangular_distance(view, 0.5f);
        spread = view.turns / view.aside;
    }
    F3 to = sub(middle, along(s.ray.o, s.ray.d, t));
    F extent = OF_EMITTER(F, a.w);
    F d2 = MAX(dot3(to, to), (F)(SMALLEST));
    F distance = sqrt(d2);
    if (!of_stretch) {
        spread = ONE / d2;
#if EMITTER_SPOTS
        spread = spot ? spread * spot_share(es, e, scale(to, ONE / distance)) : spread;
#endif
#if EMITTER_FLATS
        I behind = is_flat(OF_EMITTER(I, kind)) & (OF_EMITTER(I, two_sided) == 0) & (dot3(to, THREE_OF_EMITTER(normal)) > 0.0f);
        spread = behind ? ZERO : spread;
#endif
    }
    F way = distance + (of_stretch ? t : ZERO);
    F left = exponential(-MIN(air.extinction * way, (F)(10.0f)));
    F phase = LEAST_PHASE + phase_of(air.g, air.droplets, dot3(to, s.ray.d) / distance);
    return near ? bright * spread * left * phase : ZERO;
}

// The lamp that u and v pick for a stretch, or for a place of it at distance t, and the probability of that; of the lamps in
// `known`, where they are not negative, that alone. Lamps at infinity have their share of places, those near by what is left.
static I pick_in_air(Scene scene, Stretch s, Air air, F t, int of_stretch, I known, F u, F v, F *pick)
{
    const __global Emitter *es = scene.emitters;
    F sum = ZERO, afar = ZERO, taken = ZERO;
    I e = FALSE;
    for (int lamp = 0; lamp < scene.emitter_count; ++lamp) {
        if (is_afar(es[lamp].kind)) {
            afar += of_stretch ? ZERO : pick_afar_at(scene, lamp, along(s.ray.o, s.ray.d, t));
            continue;
        }
        F light = light_in_air(es, (I)(lamp), s, air, t, of_stretch);
        sum += light;
        I take = known < 0 ? u * sum < light : known == (I)(lamp);
        F share = light / MAX(sum, (F)(SMALLEST));
        u = take ? u / MAX(share, (F)(SMALLEST)) : (u - share) / MAX(1.0f - share, (F)(SMALLEST));
        e = take ? (I)(lamp) : e;
        taken = take ? light : taken;
    }
    afar = MIN(afar, ONE);
    *pick = sum > 0.0f ? (1.0f - afar) * taken / sum : ZERO;
    F whole = sum > 0.0f ? ONE : afar;
    F left = v * whole;
    I open = (known < 0) & (left < afar);
    for (int lamp = 0; lamp < scene.emitter_count && ANY(open); ++lamp) {
        if (!is_afar(es[lamp].kind))
            continue;
        F share = pick_afar_at(scene, lamp, along(s.ray.o, s.ray.d, t));
        e = open ? (I)(lamp) : e;
        *pick = open ? share / whole : *pick;
        open = open & (left >= share);
        left -= share;
    }
    return e;
}


#if HAS_BEAMS
// Beams of spots in a medium, which paths that are scattered towards them meet by chance: from each vertex a place of a beam
// is chosen, along a direction of its cone by the angle that x sees of that. Of the two ways there each counts by a density
// that only the places say, so that both know the other's.

// The ray along which a spot lights a place.
static Ray ray_of_beam(const __global Emitter *es, I e, F3 y, F *distance)
{
    Ray ray;
    ray.o = THREE_OF_EMITTER(a);
    F3 away = sub(y, ray.o);
    *distance = MAX(sqrt(dot3(away, away)), (F)(SMALLEST));
    ray.d = scale(away, ONE / *distance);
    return ray;
}

// The spot of which u picks a beam at x, or the one `known`, and the probability of that; 0 for other lamps.
static I pick_beam(Scene scene, F3 x, I known, F u, F *pick)
{
    const __global Emitter *es = scene.emitters;
    F sum = ZERO, taken = ZERO;
    I chosen = FALSE;
    for (int lamp = 0; lamp < scene.emitter_count; ++lamp) {
        if (es[lamp].kind != EMITTER_SPOT)
            continue;
        I e = (I)(lamp);
        Ray axis;
        axis.o = THREE_OF_EMITTER(a);
        axis.d = THREE_OF_EMITTER(normal);
        Equiangular view = seen_from(x, axis, ZERO, (F)(FARTHEST));
        F light = OF_EMITTER(F, pick) * view.turns / view.aside;
        sum += light;
        I take = known < 0 ? u * sum < light : known == e;
        F share = light / MAX(sum, (F)(SMALLEST));
        u = take ? u / MAX(share, (F)(SMALLEST)) : (u - share) / MAX(1.0f - share, (F)(SMALLEST));
        chosen = take ? e : chosen;
        taken = take ? light : taken;
    }
    *pick = sum > 0.0f ? taken / sum : ZERO;
    return chosen;
}

// Density per volume with which the beam of a spot, picked with that probability, is met at y from x.
static F beam_density(const __global Emitter *es, I e, F pick, F3 x, F3 y)
{
    F r;
    Ray ray = ray_of_beam(es, e, y, &r);
    F cone = MAX(OF_EMITTER(F, u.w), (F)(SMALLEST));
    return pick * 0.5f * INV_PI_F / cone * equiangular_density(seen_from(x, ray, ZERO, (F)(FARTHEST)), r) / (r * r);
}

// Share of the light by the beam's way of what comes from y to x, whence a path goes there with density `pdf`.
static F share_of_beam(const __global Emitter *es, I e, F density, F pdf, F3 x, F3 y)
{
    F r;
    ray_of_beam(es, e, y, &r);
    F3 to = sub(y, x);
    F cone = MAX(OF_EMITTER(F, u.w), (F)(SMALLEST));
    F by_chance = pdf / MAX(dot3(to, to) * 2.0f * r * sqrt(2.0f * cone), (F)(SMALLEST));
    return density / MAX(density + by_chance, (F)(SMALLEST));
}

// Adds what beams send to the vertices where the paths of the lanes `on` have come along a ray.
static void add_beams(Path *path, Ray ray, Hit hit, I on, Scene scene, Rules rules)
{
    const __global Emitter *es = scene.emitters;
    on = on & (path->depth + 1u < rules.max_depth);
    if (!ANY(on))
        return;
    I afloat = on & (hit.primitive == IN_MEDIUM);
#if HAS_MIX
    F choice = random4(path->pixel, path->sample, 2u * path->depth, rules.seed).c;
#else
    F choice = ZERO;
#endif
    Vertex vertex = vertex_of(ray, hit, on & NOT(afloat), choice, scene);
    if (ANY(afloat))
        take_phase(&vertex, afloat, path->medium, ray.d, scene);
    F3 x = select3(afloat, along(ray.o, ray.d, hit.t), vertex.p);
    on = on & (vertex.kind != MATERIAL_EMISSIVE);
    // Choose a place of a beam.
    F4 u = random4(path->pixel, path->sample, 0x40000002u + 256u * path->depth, rules.seed);
    F pick;
    I e = pick_beam(scene, x, (I)(-1), u.a, &pick);
    F low = u.b * OF_EMITTER(F, u.w);
    F sine = root(low * (2.0f - low));
    F sn, cs;
    sincos_turns(u.c, &sn, &cs);
    F3 axis = THREE_OF_EMITTER(normal), ax, ay;
    frame(axis, &ax, &ay);
    Ray beam;
    beam.o = THREE_OF_EMITTER(a);
    beam.d = from_frame(ax, ay, axis, f3(sine * cs, sine * sn, 1.0f - low));
    F3 y = along(beam.o, beam.d, equiangular_distance(seen_from(x, beam, ZERO, (F)(FARTHEST)), u.d));
    // Take light from there.
    F3 to = sub(y, x);
    F distance = MAX(sqrt(dot3(to, to)), (F)(SMALLEST));
    Ray first = ray;
    first.d = scale(to, ONE / distance);
    first.o = select3(afloat, x, departure(vertex, first.d));
    first.origin = hit.primitive;
    first.triangle = hit.triangle;
    F pdf;
    F3 value = scatter_eval(vertex, ray.d, side_seen(vertex, ray.d), first.d, &pdf);
    I stack = stack_beyond(path->medium, hit.primitive, vertex.ng, ray.d, first.d, scene);
    Inside medium = inside_of(stack, on, scene);
    F density = beam_density(es, e, pick, x, y);
    LightSample light = sample_picked(scene, e, ONE, y, ZERO, ZERO);
    F g = GATHER(F, scene.media, stack & MEDIUM_MASK, .asymmetry);
    F phase = phase_of(g, droplets_in(stack & MEDIUM_MASK, scene), dot3(first.d, light.direction));
    F weight = phase * share_of_beam(es, e, density, pdf, x, y) / MAX(density * distance * distance, (F)(SMALLEST));
#if HAS_LAYERED_FOG
    weight *= relative_density(medium, first, distance);
#endif
    F3 added = mul(mul(path->beta, value), mul(medium.scattering, scale(light.radiance, weight)));
    added = mul(added, left_along(first, distance, medium, on, scene));
    on = on & (pick > 0.0f) & (density > 0.0f) & (pdf > 0.0f) & (max3(added) > 0.0f)
        & (GATHER(I, scene.media, stack & MEDIUM_MASK, .in_shade) == 0);
    // Add it where nothing is in the way.
    I passed;
    if (!ANY(on))
        return;
    on = on & NOT(blocked_before(first, on ? distance : ZERO, (I)(NO_PRIMITIVE), (I)(NO_TRIANGLE), 0, &passed, scene));
#if LIGHT_PASSES
    on = on & NOT(passed);
#endif
    if (!ANY(on))
        return;
    Ray second = first;
    second.o = y;
    second.d = light.direction;
    second.origin = (I)(IN_MEDIUM);
    second.triangle = (I)(NO_TRIANGLE);
    on = on & NOT(blocked_before(second, on ? light.reach : ZERO, light.primitive, light.triangle, 0, &passed, scene));
    if (ANY(on))
        gather_light(path, on, mul(added, shadow_transmittance(second, stack, light.reach, on, scene)),
                     group_of_emitter(scene, e));
}
#endif

#if HAS_DENSITY
#define AT_MET_TYPE(type, name) , type name
#define AT_MET(name) , name
#else
#define AT_MET_TYPE(type, name)
#define AT_MET(name)
#endif

// Adds the light that the stretches of the lanes `on` scatter once towards their path: of a lamp picked where the
// transmittance scatters the path, at `met` in the lanes `scatters`, and of one picked for the stretch as a whole. Along grids
// `scattered` is the weight of the former, and `guess` the column to there by which both ways are weighed.
static void add_scattered(Path *path, Stretch s, F met, I scatters, I on, Scene scene, Rules rules
                          AT_MET_TYPE(F3, scattered) AT_MET_TYPE(F, guess))
{
    Receiver nowhere = all_round();
    F3 mean = s.medium.extinction;
    F middle = MIN(0.5f * column_of(s.medium, s.ray, s.length), 3.0f / (mean.x + mean.y + mean.z));
    F3 amid = along(s.ray.o, s.ray.d, distance_after(s.medium, s.ray, middle));
#if HAS_DENSITY
    amid = select3(s.gridded, along(s.ray.o, s.ray.d, 0.5f * s.length), amid);
#endif
    F3 droplets = droplets_in(path->medium & MEDIUM_MASK, scene);
    F g = GATHER(F, scene.media, path->medium & MEDIUM_MASK, .asymmetry);
    Air air = {g, droplets, (mean.x + mean.y + mean.z) * (1.0f / 3.0f)};
#if HAS_DENSITY
    air.extinction = s.gridded ? ZERO : air.extinction;
#endif
#if HAS_LAYERED_FOG
    air.extinction *= relative_density(s.medium, s.ray, distance_after(s.medium, s.ray, middle));
#endif
    I by_air = picks_by_air(scene);
    F3 per_metre = mul(path->beta, s.medium.scattering);
#pragma nounroll
    for (uint way = 0u; way < 2u; ++way) {
        I wanted = way == 0u ? scatters : on;
        if (!ANY(wanted))
            continue;
        // Choose a lamp, and where on the stretch.
        F4 u = random4(path->pixel, path->sample, s.dimension + 2u * way + 1u, rules.seed);
        F first, other;
        F t = MIN(met, s.length);
        F3 p = way == 0u ? along(s.ray.o, s.ray.d, t) : amid;
        I e = ANY(by_air) ? pick_in_air(scene, s, air, t, way == 1u, (I)(-1), u.a, u.d, &first)
                          : pick_lamp(scene, p, nowhere, u.a, &first);
        I near;
        Equiangular view = lit_part(scene.emitters, e, s, &near);
        t = way == 0u ? met : equiangular_distance(view, u.d);
        wanted = wanted & (near | (I)(way == 0u ? -1 : 0)) & (first > 0.0f);
        p = along(s.ray.o, s.ray.d, t);
        if (ANY(by_air))
            pick_in_air(scene, s, air, t, way == 0u, e, ZERO, ZERO, &other);
        else
            other = emitter_pick(scene, near ? e : FALSE, way == 0u ? amid : p, nowhere);
        other = near ? other : ZERO;
        // Take light from there.
        F here = way == 0u ? first : other;         // probability of the lamp at the place itself
        F whole = way == 0u ? other : first;        // and for the stretch
        LightSample light = sample_picked(scene, e, first, p, u.b, u.c);
        F phase = phase_of(g, droplets, dot3(s.ray.d, light.direction));
        F column = column_of(s.medium, s.ray, t);
        F3 left = transmittance_of(s.medium.extinction, column);
#if HAS_DENSITY
        F density = ONE;
        I gridded = wanted & s.gridded;
        if (ANY(gridded)) {
            density = gridded ? density_at_point(p, s.medium.grid, grids_of(scene)) : ONE;
            F seen = guess;
            if (way != 0u) {
                Chance chance = chance_of(path->pixel, path->sample, s.dimension + TO_THE_POINT, rules.seed);
                seen = ZERO;
                F3 tracked = track_ratio(s.ray, t, s.medium.grid, s.medium.extinction, max3(s.medium.extinction), &chance,
                                         gridded & (density > 0.0f), &seen, 0, grids_of(scene));
                left = select3(gridded, tracked, left);
            }
            column = gridded ? seen : column;
        }
#endif
        F likely = density_at(s, column);
        F spread = near ? equiangular_density(view, t) : ZERO;
#if HAS_LAYERED_FOG
        // Densities are per metre of the column, as what is scattered is.
        spread = MIN(spread / MAX(relative_density(s.medium, s.ray, t), (F)(SMALLEST)), (F)(LARGEST_DENSITY));
#endif
#if HAS_DENSITY
        spread = gridded ? MIN(spread / MAX(density, (F)(SMALLEST)), (F)(LARGEST_DENSITY)) : spread;
        likely = gridded ? MAX(likely, (F)(LEAST_LIKELY)) : likely;
#endif
        F both_ways = likely * here + whole * spread;
        F weight = phase * first / MAX(both_ways, (F)(SMALLEST));
#if HAS_BEAMS
        I beam = wanted & by_air & (path->depth > 1u) & (path->pdf > 0.0f) & (GATHER(I, scene.emitters, e, .kind) == EMITTER_SPOT);
        if (ANY(beam)) {
            F pick;
            pick_beam(scene, path->ray.o, e, ZERO, &pick);
            F density = beam_density(scene.emitters, e, pick, path->ray.o, p);
            weight *= beam ? 1.0f - share_of_beam(scene.emitters, e, density, path->pdf, path->ray.o, p) : ONE;
        }
#endif
#if !LAMPS_BY_SAMPLES
        F surely = (by_air & near) ? ONE : here;
        F rival = MIN(light.pdf / MAX(first, (F)(SMALLEST)) * surely, (F)(LARGEST_DENSITY));
        F mis = rival > 0.0f ? rival * rival / (rival * rival + phase * phase) : ONE;
#if LIGHT_PASSES
        mis = hidden_from_paths(light.primitive, scene) ? ONE : mis;
#else
        weight *= mis;
#endif
#endif
        F3 added = scale(mul(mul(per_metre, left), light.radiance), weight);
#if HAS_DENSITY
        if (way == 0u)
            added = select3(gridded, scale(mul(mul(path->beta, scattered), light.radiance), weight * likely), added);
        wanted = wanted & (density > 0.0f);
#endif
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
        I passed;
        lit = lit & NOT(blocked_before(ray, reach, light.primitive, light.triangle, 0, &passed, scene));
#if LIGHT_PASSES
        added = scale(added, passed ? ONE : mis);
#endif
        if (ANY(lit)) {
#if HAS_DENSITY
            Chance chance = chance_of(path->pixel, path->sample, s.dimension + TO_THE_LAMP + way, rules.seed);
#endif
            added = mul(added, shadow_transmittance(ray, path->medium, light.reach, lit, scene WITH_CHANCE(chance)));
            gather_light(path, lit, added, group_of_emitter(scene, e));
        }
    }
}
#endif

#if HAS_DENSITY
// Weight of a path that delta tracking has taken to a collision or past all: what scatters there or is left at each wavelength,
// over the probability with which any of them would have come there. Both have the densities met in common.
static F3 weight_of(Collision c, Stretch s)
{
    F most = max3(s.medium.extinction);
    F3 share = scale(s.medium.extinction, ONE / MAX(most, (F)(SMALLEST)));
    F3 power = f3(c.tries * logarithm(MAX(share.x, (F)(1e-20f))) + (most - s.medium.extinction.x) * c.bound,
                  c.tries * logarithm(MAX(share.y, (F)(1e-20f))) + (most - s.medium.extinction.y) * c.bound,
                  c.tries * logarithm(MAX(share.z, (F)(1e-20f))) + (most - s.medium.extinction.z) * c.bound);
    F top = max3(power);
    F3 chance = f3(exponential(power.x - top), exponential(power.y - top), exponential(power.z - top));
    F3 albedo = f3(s.medium.scattering.x / MAX(s.medium.extinction.x, (F)(SMALLEST)),
                   s.medium.scattering.y / MAX(s.medium.extinction.y, (F)(SMALLEST)),
                   s.medium.scattering.z / MAX(s.medium.extinction.z, (F)(SMALLEST)));
    F3 value = scale(chance, ONE / MAX(dot3(s.shares, chance), (F)(SMALLEST)));
    return select3(c.scatters, mul(value, albedo), value);
}
#endif

// Chooses where a stretch may scatter, by the transmittance of one of three wavelengths.
static void choose_column(const Path *path, Stretch *s, Rules rules)
{
    F3 extinction = s->medium.extinction, scattering = s->medium.scattering;
    F3 albedo = f3(scattering.x / MAX(extinction.x, (F)(SMALLEST)), scattering.y / MAX(extinction.y, (F)(SMALLEST)),
                   scattering.z / MAX(extinction.z, (F)(SMALLEST)));
    F3 shares = f3(path->beta.x * MAX(albedo.x, (F)(LEAST_ALBEDO)), path->beta.y * MAX(albedo.y, (F)(LEAST_ALBEDO)),
                   path->beta.z * MAX(albedo.z, (F)(LEAST_ALBEDO)));
    s->shares = shares = scale(shares, ONE / MAX(shares.x + shares.y + shares.z, (F)(SMALLEST)));
    F4 u = random4(path->pixel, path->sample, s->dimension, rules.seed);
    s->chosen = u.a < shares.x ? extinction.x : (u.a < shares.x + shares.y ? extinction.y : extinction.z);
    s->column = -logarithm(MAX(1.0f - u.b, (F)(1e-9f))) / MAX(s->chosen, (F)(1e-20f));
}

// How far what a stretch meets matters: where no lamp sees it, to where it scatters and no farther.
static F reach_in_shade(const Path *path, Stretch s, I on, Scene scene)
{
    I shade = on & (max3(s.medium.scattering) > 0.0f) & NOT(max3(s.medium.glow) > 0.0f);
#if HAS_DENSITY
    shade = shade & NOT(s.gridded);
#endif
    shade = shade & (GATHER(I, scene.media, path->medium & MEDIUM_MASK, .in_shade) != 0);
    return shade ? distance_after(s.medium, s.ray, s.column) * 1.00001f + SMALLEST : (F)(NEVER);
}

// Takes the paths of the lanes `on` along a stretch: adds what it emits and scatters towards them, and its transmittance.
// Returns which of them it scatters, at distance *met.
static I pass_stretch(Path *path, Stretch s, I on, F *met, Scene scene, Rules rules)
{
    F3 extinction = s.medium.extinction;
    F3 glow = s.medium.glow;
#if HAS_DENSITY
    F before = enter_grid(&s.ray, &s.length, s.medium.grid, on & s.gridded, grids_of(scene));
    on = on & (NOT(s.gridded) | (s.length > 0.0f));
    s.gridded = s.gridded & on;
    s.length = MAX(s.length, ZERO);
#endif
    F whole = column_of(s.medium, s.ray, s.length);
    if (ANY(on & (max3(glow) > 0.0f))) {
        F3 all = scale(f3(mean_transmittance(extinction.x * whole), mean_transmittance(extinction.y * whole),
                          mean_transmittance(extinction.z * whole)), whole);
#if HAS_DENSITY
        I shines = s.gridded & (max3(glow) > 0.0f);
        if (ANY(shines)) {
            Chance chance = chance_of(path->pixel, path->sample, s.dimension + TO_GLOW, rules.seed);
            F rate = MAX(max3(extinction), GATHER(F, scene.media, s.medium.grid, .glow_rate));
            F guess = ZERO;
            F3 seen = f3(ZERO, ZERO, ZERO);
            track_ratio(s.ray, s.length, s.medium.grid, extinction, rate, &chance, shines, &guess, &seen, grids_of(scene));
            all = select3(s.gridded, scale(seen, ONE / rate), all);
        }
#endif
        gather_light(path, on, mul(path->beta, mul(glow, all)), (I)(GLOW_GROUP));
    }
    on = on & has_extinction(s.medium);
    I murky = on & (max3(s.medium.scattering) > 0.0f);
    I scatters = FALSE;
    F3 left = transmittance_of(extinction, whole);
#if HAS_DENSITY
    I dim = s.gridded & on & NOT(murky);
    if (ANY(dim)) {
        Chance chance = chance_of(path->pixel, path->sample, s.dimension + TO_THE_POINT, rules.seed);
        F guess = ZERO;
        F3 tracked = track_ratio(s.ray, s.length, s.medium.grid, extinction, max3(extinction), &chance, dim, &guess, 0, grids_of(scene));
        left = select3(dim, tracked, left);
    }
#endif
    if (ANY(murky)) {
        F column = s.column;
        F t = MIN(distance_after(s.medium, s.ray, column), s.length);
        scatters = murky & (column < whole);
#if HAS_DENSITY
        I gridded = murky & s.gridded;
        Collision c;
        F3 tracked = f3(ZERO, ZERO, ZERO);
        c.guess = ZERO;
        if (ANY(gridded)) {
            Chance chance = chance_of(path->pixel, path->sample, s.dimension + TO_COLLIDE, rules.seed);
            c = collide(s.ray, s.length, s.medium.grid, MAX(s.chosen, (F)(1e-20f)), chance, gridded, grids_of(scene));
            t = gridded ? c.t : t;
            scatters = gridded ? c.scatters : scatters;
            tracked = weight_of(c, s);
        }
#endif
#if HAS_EMITTERS
        I shade = GATHER(I, scene.media, path->medium & MEDIUM_MASK, .in_shade);
        I lightable = murky & (path->depth < rules.max_depth) & (shade == 0);
        if (ANY(lightable))
            add_scattered(path, s, t, scatters & lightable, lightable, scene, rules AT_MET(tracked) AT_MET(c.guess));
#endif
        F3 over = transmittance_of(extinction, column);
        F3 scattered = scale(mul(s.medium.scattering, over), ONE / MAX(density_at(s, column), (F)(SMALLEST)));
        F3 passed = scale(left, ONE / MAX(dot3(s.shares, left), (F)(SMALLEST)));
        left = select3(scatters, scattered, select3(murky, passed, left));
#if HAS_DENSITY
        left = select3(gridded, tracked, left);
        t += before;
#endif
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
        Stretch s;
        s.ray = ray;
        s.medium = inside_of(path->medium, on, scene);
#if HAS_ENTRIES
        s.medium.scattering = select3(s.medium.by_entry, mul(s.medium.extinction, path->entry), s.medium.scattering);
#endif
        s.dimension = 0x40000000u + 4u * (path->depth * 64u + step % 64u) + (step / 64u << 24);
        s.shares = f3(ZERO, ZERO, ZERO);
        s.chosen = s.column = ZERO;
#if HAS_DENSITY
        s.gridded = on & (s.medium.grid > 0);
#endif
        F reach = (F)(NEVER);
        if (ANY(on & (max3(s.medium.scattering) > 0.0f))) {
            choose_column(path, &s, rules);
            reach = reach_in_shade(path, s, on, scene);
        }
        Hit hit = hit_before(ray, reach, scene);
        hit.t = hit.primitive >= 0 ? hit.t : (F)(NEVER);
        s.length = MIN(hit.t, (F)(FARTHEST));
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
#if HAS_EMITTERS && HAS_BEAMS
    I arrived = (path->ray.origin != PATH_ENDED) & ((result.primitive >= 0) | (result.primitive == IN_MEDIUM));
    if (scene.emitter_count <= FEW_LAMPS && ANY(arrived))
        add_beams(path, path->ray, result, arrived, scene, rules);
#endif
    // A path that only boundaries hold goes no farther.
    path->ray.origin = on ? (I)(PATH_ENDED) : path->ray.origin;
    return result;
}

#endif
