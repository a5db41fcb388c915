// A path under way and what happens at one of its vertices. The passes of a wave and the stream share this code.
#ifndef PATH_H
#define PATH_H
#include "common/sampler.h"
#include "material/scatter.h"
#if HAS_ABSORPTION
#include "material/absorption.h"
#endif
#include "light/groups.h"
#include "light/infinity.h"
#if HAS_EMITTERS
#include "light/emitters.h"
#endif
#if LIGHT_PASSES
#include "geometry/hidden.h"
#endif
#if CAUSTICS
#include "caustics/gather.h"
#endif
#if VIRTUAL_LIGHTS
#include "geometry/nearest.h"
#include "light/virtual_lights.h"
#endif

#define LEAST_UNLIT   4.0f      // chance of a path without light to go on, over its throughput, at least
#define LARGEST_DENSITY 1e18f   // of a direction, whose square float32 still holds; far above that of any BSDF
#define LEAST_CHANCE  0.05f     // of a path to go on: what survives less is seldom, but then weighs much

// How a path has come on since the last receiver of photons, by glass and mirrors alone: past none but straight panes; with one
// more, the last such where photons start, or where none do. 0 is any other way.
#define SINCE_DIRECT   1
#define SINCE_PHOTONS  2
#define SINCE_OTHERS   3
#define STRAIGHT_ALONE SIGN_BIT     // of the number that chooses the way of a light sample through glass

// What limits and seeds the paths of a wave.
typedef struct {
    uint2 seed;
    uint  max_depth, roulette_depth;
} Rules;

static inline Rules rules_of(Wave wave, Limits limits)
{
    Rules r;
    r.seed = wave.seed;
    r.max_depth = limits.max_depth;
    r.roulette_depth = limits.roulette_depth;
    return r;
}

typedef struct {
    Ray ray;
    F   weight;     // of the camera ray, multiplied in on the film: roulette must not depend on the exposure
    F   survival_scale;   // of roulette, where the path's pixel lies
    F3  beta;       // throughput behind the camera
    F3  radiance;   // gathered so far
#if LIGHT_GROUPS
    GroupLight groups;      // the same by groups of lamps
#endif
    F   pdf;        // density of the last direction; 0 where light sampling cannot compete
#if LAMPS_BEHIND_GLASS
    Departure scattered;
#endif
#if LIGHT_TREE
    Receiver receiver;  // the surface where the ray starts, as light sampling takes it
#endif
    U   pixel, sample, depth;
#if HAS_MEDIA
    I   medium;         // stack of the media around, material/medium.h
#if HAS_ENTRIES
    F3  entry;          // share of light that a medium scatters whose colour is a texture, by where the path entered it
#endif
#endif
#if CAUSTICS
    I   since_receiver;     // of the last vertices, one of SINCE_…
#endif
#if SPECTRUM
    F   wavelength_sample;        // chooses the wavelength, common/wavelength.h
#endif
} Path;

typedef struct {
    Ray ray;
    F3  light;      // what arrives if nothing is in the way
#if LIGHT_PASSES
    F   mis;        // its weight, but where it passes what a path would meet
#endif
    F   reach;      // distance to the emitter; 0: no light sample
    I   target;     // the emitter's primitive
    I   target_triangle;    // and its triangle
#if LAMPS_BEHIND_GLASS
    F3  share;      // of the radiance of what the ray meets behind glass; 0: it does not follow glass
    F   chance;     // random: which way it takes there; with the bit STRAIGHT_ALONE it goes on by straight panes alone
#endif
#if LIGHT_GROUPS
    I   group;
#endif
#if HAS_MEDIA
    I   medium;     // where it starts, as that of a path
#endif
} ShadowRay;

// Adds to what a path has gathered light of a group of lamps, in the lanes `on`.
static inline void gather_light(Path *path, I on, F3 light, I group)
{
    F3 added = keep3(on, light);
    path->radiance = add(path->radiance, added);
#if LIGHT_GROUPS
    add_to_group(&path->groups, group, on, light);
#endif
}

// Where a ray along `d` leaves a vertex: just off a mesh, on the side where it goes.
static inline F3 departure(Vertex vertex, F3 d)
{
#if HAS_MESH
    return along(vertex.p, vertex.ng, with_sign(vertex.offset, dot3(vertex.ng, d)));
#else
    return vertex.p;
#endif
}

// Where light sampling would have done as a path did. Here and below a path is named by its address: of one passed by value
// LLVM 14 lost the copy of a part, `receiver`, in sixteen lanes, so that lamps met by chance counted twice.
static inline Departure departure_of(const Path *path)
{
#if LAMPS_BEHIND_GLASS
    return path->scattered;
#else
    return (Departure){path->ray.o, path->ray.d, path->pdf};
#endif
}

// Its density where it looks for lamps and suns: none where photons bring what a receiver gets of them by glass.
static inline F rival_of_lamps(const Path *path)
{
#if LAMPS_BEHIND_GLASS && CAUSTICS
    return path->since_receiver > SINCE_DIRECT ? ZERO : path->scattered.pdf;
#else
    return departure_of(path).pdf;
#endif
}

static inline Receiver receiver_behind(const Path *path)
{
#if LIGHT_TREE
    return path->receiver;
#else
    return all_round();
#endif
}

#if LIGHT_LOBES
#define FACET_F0 0.04f

// Share of what a surface scatters that its facets reflect; 0 where there are none, or where they pass light on, too.
static F share_of_facets(Vertex vertex, F cosine)
{
    F share = ((vertex.kind == MATERIAL_CONDUCTOR) | (vertex.kind == MATERIAL_METAL)) ? ONE : ZERO;
    F steep = 1.0f - absolute(cosine);
    F steep2 = steep * steep;
    F fresnel = steep2 * steep2 * steep;
#if HAS_ROUGH_PLASTIC
    F mirrored = FACET_F0 + (1.0f - FACET_F0) * fresnel;
    F below = (1.0f - mirrored) * max3(vertex.color);
    share = vertex.kind == MATERIAL_ROUGH_PLASTIC ? mirrored / (mirrored + below) : share;
#endif
#if HAS_PRINCIPLED
    F metallic = vertex.closure.metallic;
    F f0 = FACET_F0 * vertex.closure.specular + metallic * max3(vertex.color);
    F reflected = f0 + (1.0f - f0) * fresnel * MAX(metallic, MIN(vertex.closure.specular, ONE));
    F rest = (1.0f - metallic) * (1.0f - reflected) * max3(vertex.color);
    share = vertex.kind == MATERIAL_PRINCIPLED ? reflected / (reflected + rest + SMALLEST) : share;
#endif
    return share;
}
#endif

#if LIGHT_TREE
// What is known of a vertex, on the side from which a path comes along d; nothing where light from behind counts, too.
static Receiver receiver_of(Vertex vertex, F3 d)
{
    I passes = (vertex.kind == MATERIAL_DIELECTRIC) | (vertex.kind == MATERIAL_ROUGH_DIELECTRIC)
        | (vertex.kind == MATERIAL_THIN_GLASS) | (vertex.kind == MATERIAL_TRANSLUCENT);
#if HAS_MEDIA
    passes |= phase_is(vertex.kind);
#endif
#if HAS_TRANSMISSION
    passes |= vertex.kind == MATERIAL_PRINCIPLED;
#endif
#if HAS_HAIR
    passes |= vertex.kind == MATERIAL_HAIR;
#endif
    Receiver receiver;
    receiver.n = keep3(NOT(passes), scale(vertex.n, with_sign(ONE, -dot3(vertex.ng, d))));
#if LIGHT_LOBES
    F cosine = dot3(vertex.n, d);
    receiver.mirrored = along(d, vertex.n, -2.0f * cosine);
    receiver.width = 4.0f * vertex.closure.alpha.x * vertex.closure.alpha.x;
    receiver.share = passes ? ZERO : share_of_facets(vertex, cosine);
#endif
    return receiver;
}
#endif

#if CAUSTICS
// Lanes whose light comes by photons: from a receiver by glass and mirrors alone, the last of them one where photons start.
static inline I lit_by_photons(const Path *path) { return path->since_receiver == SINCE_PHOTONS; }

// Lanes whose ray passes a surface straight, of those that light samples follow.
static inline I passes_straight(Vertex vertex, F3 d, F3 next, I role)
{
#if PANES_BY_SAMPLES
    return ((role & ROLE_STRAIGHT) != 0) & (dot3(vertex.ng, d) * dot3(vertex.ng, next) > 0.0f);
#else
    return FALSE;
#endif
}
#endif

#if HAS_DISPERSION
// Leaves a path one wavelength, which stands for all, where glass bends each by itself.
static inline void leave_one_wavelength(Path *path, Vertex vertex, I on, Scene scene)
{
    I splits = on & vertex.splits & (AS_I(path->wavelength_sample) >= 0);
    if (ANY(splits)) {
#if SPECTRAL_COLOURS
        F3 one = f3(3.0f * path->beta.x, ZERO, ZERO);
#else
        F3 one = mul(path->beta, share_of_wavelength(path->wavelength_sample, scene.colours));
#endif
        path->beta = select3(splits, one, path->beta);
        path->wavelength_sample = splits ? AS_F(AS_I(path->wavelength_sample) | SIGN_BIT) : path->wavelength_sample;
    }
}
#endif

#if HAS_MEDIA
#define FEW_LAMPS 16    // of which each is asked what it gives a place in a medium

// Lanes, which are all alike, that pick lamps for media so: for weights against paths that meet lamps, with certainty.
static inline I picks_by_air(Scene scene) { return (I)(scene.emitter_count <= FEW_LAMPS ? -1 : 0); }
#endif

#if HAS_LAMPS
// Emission of the primitive that was hit, weighted against light sampling.
static F3 emission(const Path *path, Vertex vertex, F3 radiance, I shines, F t, F cos_i, Scene scene)
{
    F weight = ONE;
#if HAS_EMITTERS
    Departure from = departure_of(path);
    from.pdf = rival_of_lamps(path);
    I rival = shines & (from.pdf > 0.0f) & (vertex.emitter >= 0);
    if (ANY(rival)) {
        I e = MAX(vertex.emitter, FALSE);
        F pick = emitter_pick(scene, e, from.o, receiver_behind(path));
#if HAS_MEDIA
        pick = (path->ray.origin == IN_MEDIUM) & picks_by_air(scene) ? ONE : pick;
#endif
        F other = emitter_pdf(scene.emitters, e, pick, path->ray.o, path->ray.d, t, absolute(cos_i));
#if LAMPS_BEHIND_GLASS
        other = path->pdf > 0.0f ? other : aim_pdf(scene.emitters, e, pick, from.o, from.d);
#endif
        weight = rival ? against_lights(from.pdf, other) : weight;
    }
#endif
#if CAUSTICS
    I sampled = shines & lit_by_photons(path) & (vertex.emitter >= 0);
    if (ANY(sampled)) {
        F other = emitter_pdf(scene.emitters, MAX(vertex.emitter, FALSE), ONE, path->ray.o, path->ray.d, t, absolute(cos_i));
        shines = shines & NOT(sampled & (other > 0.0f));
    }
#endif
    return keep3(shines, scale(mul(path->beta, radiance), weight));
}
#endif

#if HAS_EMITTERS
// For the lanes `on`; in those of `by_photons` photons bring what lamps and suns send by glass, but by straight panes alone.
static ShadowRay light_sample(Path path, Vertex vertex, Side side, I on, I by_photons, Hit hit, Scene scene, Rules rules)
{
    F4 u = random4(path.pixel, path.sample, 2u * path.depth + 1u, rules.seed);
#if LIGHT_TREE
    Receiver receiver = receiver_of(vertex, path.ray.d);
#else
    Receiver receiver = all_round();
#endif
    LightSample light = sample_emitter(scene, vertex.p, receiver, u.a, u.b, u.c);
    F pdf;
    F3 through = mul(path.beta, scatter_eval(vertex, path.ray.d, side, light.direction, &pdf));
    F rival = MIN(light.pdf, (F)(LARGEST_DENSITY));
    F rival2 = rival * rival;
#if LAMPS_BY_SAMPLES
    F mis = ONE;
#else
    F mis = rival > 0.0f ? rival2 / (rival2 + pdf * pdf) : ONE;
#endif
    ShadowRay shadow;
#if LIGHT_PASSES
    shadow.light = mul(through, light.radiance);
    shadow.mis = hidden_from_paths(light.primitive, scene) ? ONE : mis;
#else
    shadow.light = scale(mul(through, light.radiance), mis);
#endif
    shadow.ray.o = departure(vertex, light.direction);
    shadow.ray.d = light.direction;
    shadow.ray.origin = hit.primitive;
    shadow.ray.triangle = hit.triangle;
#if HAS_MOTION
    shadow.ray.time = path.ray.time;
#endif
#if HAS_MEDIA
    shadow.medium = stack_beyond(path.medium, hit.primitive, vertex.ng, path.ray.d, light.direction, scene);
#endif
    shadow.target = light.primitive;
    shadow.target_triangle = light.triangle;
#if LIGHT_GROUPS
    shadow.group = light.group;
#endif
    F brightest = max3(shadow.light);
#if LAMPS_BEHIND_GLASS
    by_photons = by_photons & (light.primitive != FROM_SKY);
    shadow.share = scale(through, light.weight * mis);
    shadow.chance = u.d;
#if PANES_BY_SAMPLES
    shadow.chance = by_photons ? AS_F(AS_I(u.d) | STRAIGHT_ALONE) : u.d;
#else
    shadow.share = keep3(NOT(by_photons), shadow.share);
#endif
    brightest = MAX(brightest, max3(shadow.share));     // the place aimed at may be dark, and that which is met not
#endif
    shadow.reach = (on & (brightest > 0.0f)) ? light.reach : ZERO;
    return shadow;
}
#endif

#if VIRTUAL_LIGHTS
// Adds the light that one virtual light sends by the vertices of the lanes `on`.
IN_PLACE static void connect(Path *path, Vertex vertex, Side side, I on, Hit hit, Scene scene, Rules rules)
{
    // Pick one: the host has made them alike in what they bring, and sorted them by place.
    F u = random4(path->pixel, path->sample, 2u * path->depth + 1u, rules.seed).d;
    int count = scene.virtual_grid->count;
    Eight place = load_eight(scene.virtual_lights, 8 * MIN(TO_I(u * (float)count), (I)(count - 1)));
    F3 p = f3(place.f[0], place.f[1], place.f[2]);
    F3 n = from_octahedral(AS_I(place.f[6]));
    F3 to = sub(p, vertex.p);
    F distance2 = MAX(dot3(to, to), (F)(SMALLEST));
    F distance = sqrt(distance2);
    F3 d = scale(to, ONE / distance);
    F cosine = -dot3(n, d);
    I edges = AS_I(path->depth) + 1 + (AS_I(place.f[7]) >> WAY_SHIFT);
    on = on & (cosine > 0.0f) & (edges <= (I)((int)rules.max_depth));
    // Weigh it against the path's own direction.
    F pdf;
    F3 through = mul(path->beta, scatter_eval(vertex, path->ray.d, side, d, &pdf));
    F share = share_of_connection(pdf, cosine, distance2, density_of_lights(p, n, scene));
    F3 light = scale(mul(through, f3(place.f[3], place.f[4], place.f[5])), share * cosine / distance2);
    on = on & (max3(light) > 0.0f);
    if (!ANY(on))
        return;
    // See whether anything is between.
    Ray ray = path->ray;
    ray.o = departure(vertex, d);
    ray.d = d;
    ray.origin = hit.primitive;
    ray.triangle = hit.triangle;
    I passed;
    F reach = on ? SHORT_OF * distance : ZERO;
    on = on & NOT(blocked_before(ray, reach, (I)(NO_PRIMITIVE), (I)(NO_TRIANGLE), 1, &passed, scene));
    gather_light(path, on, light, FALSE);
}

// Of what a path has met from a vertex that made a connection, the share that is left to it, where light leaves evenly.
static F left_by_connections(const Path *path, Vertex vertex, F t, I on, Scene scene)
{
    I shared = on & (path->depth > 1u) & (path->pdf > 0.0f) & scatters_evenly(vertex);
    if (!ANY(shared))
        return ONE;
    F3 d = path->ray.d;
    F density = density_of_lights(vertex.p, facing_side(vertex, d), scene);
    F share = share_of_connection(path->pdf, absolute(dot3(vertex.ng, d)), t * t, density);
    return shared ? 1.0f - share : ONE;
}
#endif

// What roulette multiplies the throughput of a path by, by the cell of the film that its pixel lies in: great where the picture
// is dark and what little light a path brings shows (rptcam_cl/rendering/film.py).
static inline F survival_scale_at(Lane lane, Limits limits, const __global float *survival_scale)
{
    I column = MIN(lane.x >> (int)(limits.cell_shift), (I)(limits.cells_across - 1));
    I row = MIN(lane.y >> (int)(limits.cell_shift), (I)(limits.cells_down - 1));
    I cell = row * limits.cells_across + column;
    return GATHER(F, survival_scale, cell, );
}

// Chance of a path to go on after Russian roulette: what light it may still bring, over what its pixel shows. What has gathered
// none before this vertex is all that its sample may get, and does not end more often where the picture is bright.
static inline F chance_to_go_on(Path path)
{
    F survival_scale = max3(path.radiance) > 0.0f ? path.survival_scale : MAX(path.survival_scale, (F)(LEAST_UNLIT));
    return MIN(MAX(survival_scale * max3(path.beta), (F)(LEAST_CHANCE)), ONE);
}

#if ENVIRONMENT || EMITTER_SUNS
// Adds the light of the environment and of suns on paths that leave the scene.
IN_PLACE static void leave_scene(Path *path, I escaped, Scene scene)
{
#if CAUSTICS && EMITTER_SUNS
    I sunless = lit_by_photons(path);
#else
    I sunless = FALSE;
#endif
    I kind = path->ray.origin == NO_PRIMITIVE ? (I)(HIDDEN_FROM_CAMERA) : (I)(HIDDEN_FROM_REFLECTION);
    Departure from = departure_of(path);
    F sun_rival = rival_of_lamps(path);
    Receiver receiver = receiver_behind(path);
    F3 light = light_from_infinity(from, sun_rival, receiver, path->ray.d, sunless, kind, EVERY_GROUP, scene);
    path->radiance = add(path->radiance, keep3(escaped, mul(path->beta, light)));
#if LIGHT_GROUPS
#if VW == 1
#pragma nounroll
#endif
    for (int g = 0; g < LIGHT_GROUPS; ++g) {
        light = light_from_infinity(from, sun_rival, receiver, path->ray.d, sunless, kind, g, scene);
        add_to_group(&path->groups, (I)(g), escaped, mul(path->beta, light));
    }
#endif
}
#endif

// Adds the emission of what was hit; returns those that did not hit a lamp, which ends a path.
IN_PLACE static I add_emission(Path *path, Vertex vertex, I on, Hit hit, Scene scene)
{
#if HAS_EMISSIVE
    I lamp = on & (vertex.kind == MATERIAL_EMISSIVE);
    if (ANY(lamp)) {
        F cos_i = -dot3(vertex.ng, path->ray.d);
        I shines = lamp & ((cos_i > 0.0f) | (vertex.parameter != 0.0f));
        gather_light(path, TRUE, emission(path, vertex, vertex.color, shines, hit.t, cos_i, scene),
                     group_of_primitive(scene, hit.primitive));
        on = on & NOT(lamp);
    }
#endif
#if HAS_GLOW
    F front = -dot3(vertex.ng, path->ray.d);
    I glows = on & GLOWS(vertex, front) & (max3(vertex.closure.glow) > 0.0f);
    if (ANY(glows))
        gather_light(path, TRUE, emission(path, vertex, vertex.closure.glow, glows, hit.t, front, scene),
                     group_of_primitive(scene, hit.primitive));
#endif
    return on;
}

#if CAUSTICS
// Adds the light of the photons around those that receive it.
IN_PLACE static void add_photons(Path *path, Vertex vertex, Side side, I receiver, Hit hit, Scene scene, Rules rules)
{
    I most = AS_I((U)(rules.max_depth) - path->depth);
    F3 light = caustic_radiance(vertex, path->ray.d, side, receiver, hit.primitive, most, path->sample, scene);
    path->radiance = add(path->radiance, keep3(receiver, mul(path->beta, light)));
}
#endif

// Sends the path on in the direction that was sampled, or ends it; receivers had their light from the photons around.
IN_PLACE static void depart(Path *path, Vertex vertex, Scattered next, Hit hit, I on, I receiver, I role, Scene scene)
{
#if LAMPS_BEHIND_GLASS
    I clear = is_clear(vertex);
#if LIGHT_TREE
    path->receiver = select_receiver(clear, path->receiver, receiver_of(vertex, path->ray.d));
#endif
    path->scattered.o = select3(clear, path->scattered.o, departure(vertex, next.direction));
    path->scattered.d = select3(clear, path->scattered.d, next.direction);
    path->scattered.pdf = clear ? path->scattered.pdf : next.pdf;
#elif LIGHT_TREE
    path->receiver = receiver_of(vertex, path->ray.d);
#endif
#if HAS_MEDIA
    I stack = stack_beyond(path->medium, hit.primitive, vertex.ng, path->ray.d, next.direction, scene);
#if HAS_ENTRIES
    I enters = (stack > path->medium) & (GATHER(I, scene.media, stack & MEDIUM_MASK, .by_entry) != 0);
    path->entry = select3(enters, albedos_for(vertex.closure.inside), path->entry);
#endif
    path->medium = stack;
#endif
#if CAUSTICS
    I onward = (role & ROLE_SURFACE) != 0 ? (I)(SINCE_PHOTONS) : (I)(SINCE_OTHERS);
    onward = passes_straight(vertex, path->ray.d, next.direction, role) ? path->since_receiver : onward;
    onward = ((path->since_receiver > 0) & ((role & ROLE_RECEIVER) == 0)) ? onward : FALSE;
    path->since_receiver = next.pdf == 0.0f ? onward : (receiver ? (I)(SINCE_DIRECT) : FALSE);
#endif
    path->ray.o = departure(vertex, next.direction);
    path->ray.d = next.direction;
    path->ray.triangle = hit.triangle;
    path->ray.origin = on ? hit.primitive : (I)(PATH_ENDED);
    path->pdf = next.pdf;
    path->depth += 1u;
}

// One vertex of every living path: gathers emission and environment, makes a light sample, and continues the path or ends
// it. `hit` says what its ray met.
static ShadowRay shade_vertex(Path *path, Hit hit, Scene scene, Rules rules)
{
    ShadowRay shadow;
    shadow.reach = ZERO;
    // Take the light of the environment on paths that leave the scene.
    I living = path->ray.origin != PATH_ENDED;
#if ENVIRONMENT || EMITTER_SUNS
    I escaped = living & (hit.primitive == NO_PRIMITIVE);
    if (ANY(escaped))
        leave_scene(path, escaped, scene);
#endif
    // Go on with those that hit something and may be continued or meet a lamp.
    I on = living & (hit.primitive >= 0);
#if HAS_MEDIA
    I afloat = living & (hit.primitive == IN_MEDIUM);
    on = on | afloat;
#endif
#if !HAS_LAMPS
    on = on & (path->depth < rules.max_depth);
#endif
    if (!ANY(on)) {
        path->ray.origin = (I)(PATH_ENDED);
        return shadow;
    }
    // Look up the vertex and its material.
#if HAS_MIX
    F choice = random4(path->pixel, path->sample, 2u * path->depth, rules.seed).c;
#else
    F choice = ZERO;
#endif
#if HAS_MEDIA
    Vertex vertex = vertex_of(path->ray, hit, on & NOT(afloat), choice, scene);
    if (ANY(afloat))
        take_phase(&vertex, afloat, path->medium, path->ray.d, scene);
#else
    Vertex vertex = vertex_of(path->ray, hit, on, choice, scene);
#endif
#if HAS_DISPERSION && !LENS_SPLITS
    leave_one_wavelength(path, vertex, on, scene);
#endif
    // Absorb light on the way inside a solid.
#if HAS_ABSORPTION
    path->beta = mul(path->beta, transmittance(vertex, path->ray.d, hit.t));
#endif
    // Add the emission of what was hit.
    on = add_emission(path, vertex, on, hit, scene);
    // End paths of full length.
#if HAS_LAMPS
    on = on & (path->depth < rules.max_depth);
    if (!ANY(on)) {
        path->ray.origin = (I)(PATH_ENDED);
        return shadow;
    }
#endif
    // Leave what connections bring to them, and seldom follow what is left of little.
#if VIRTUAL_LIGHTS
    F4 u = random4(path->pixel, path->sample, 2u * path->depth, rules.seed);
    F left = left_by_connections(path, vertex, hit.t, on, scene);
    F stays = MAX(left, (F)(LEAST_CHANCE));
    on = on & (left > 0.0f) & (u.d < stays);
    path->beta = scale(path->beta, left / stays);
    u.d = u.d / stays;
    if (!ANY(on)) {
        path->ray.origin = (I)(PATH_ENDED);
        return shadow;
    }
#endif
    Side side = side_seen(vertex, path->ray.d);
    // Add the photons around.
#if CAUSTICS
    I role = caustic_role(on, hit.primitive, scene);
    I receiver = on & receives(vertex, role);
    if (ANY(receiver))
        add_photons(path, vertex, side, receiver, hit, scene, rules);
#else
    I role = FALSE, receiver = FALSE;
#endif
    // Sample a light, for a shadow ray.
#if HAS_EMITTERS
#if HAS_MEDIA
    I lightable = on & NOT(afloat);         // the way through the medium has taken that of the others
#else
    I lightable = on;
#endif
    shadow = light_sample(*path, vertex, side, lightable, receiver, hit, scene, rules);
#endif
#if VIRTUAL_LIGHTS
    connect(path, vertex, side, on, hit, scene, rules);
#else
    F4 u = random4(path->pixel, path->sample, 2u * path->depth, rules.seed);
#endif
    // Sample the BSDF for the next direction.
    Scattered next = scatter_sample(vertex, path->ray.d, side, u.a, u.b, u.c);
    path->beta = mul(path->beta, next.weight);
    on = on & (max3(path->beta) > 0.0f);
    // Play Russian roulette.
    if (rules.roulette_depth > 0u) {
        I plays = path->depth >= rules.roulette_depth;
        F survive = plays ? chance_to_go_on(*path) : ONE;
        on = on & (u.d < survive);
        path->beta = scale(path->beta, ONE / survive);
    }
    // Continue the path, or end it.
    depart(path, vertex, next, hit, on, receiver, role, scene);
    return shadow;
}

#endif
