// Photons of one pass: each starts at a point of smooth glass or of a mirror, takes light there from a lamp that it sees, and
// goes on by smooth glass and mirrors until it meets a receiver, where it is written; else NO_PHOTON is.
// Facts: those of the scene, CAUSTICS among them.
#define SPECULAR_ALONE
#include "caustics/surface.h"
#include "integrator/path.h"
#include "geometry/nearest.h"

// Light that a photon takes from a lamp to where it starts, and the ray on to there: power, not yet visible.
static ShadowRay light_of_start(Vertex vertex, StartPoint start, F4 u, Scene scene)
{
    LightSample light = sample_emitter(scene, vertex.p, all_round(), u.a, u.b, u.c);
    ShadowRay shadow;
    shadow.ray.o = departure(vertex, light.direction);
    shadow.ray.d = light.direction;
    shadow.ray.origin = start.hit.primitive;
    shadow.ray.triangle = start.hit.triangle;
    shadow.light = scale(light.radiance, absolute(dot3(vertex.ng, light.direction)) * start.area);
    shadow.target = light.primitive;
    shadow.target_triangle = light.triangle;
    // What surrounds the scene stays with the paths.
    shadow.reach = ((max3(shadow.light) > 0.0f) & (light.primitive != FROM_SKY)) ? light.reach : ZERO;
    return shadow;
}

// Lanes that see the lamp that they take light from, alone or by straight panes, of which each is an edge and takes its share.
static I sees_lamp(ShadowRay *shadow, I on, F chance, I *panes, Scene scene)
{
#if PANES_BY_SAMPLES
    I sees = FALSE;
    for (;;) {
        shadow->ray.origin = on ? shadow->ray.origin : (I)(PATH_ENDED);
        I dark = on & any_hit(shadow->ray, on ? shadow->reach : ZERO, shadow->target, shadow->target_triangle, scene);
        sees = sees | (on & NOT(dark));
        on = dark;
        if (!ANY(on))
            return sees;
        Hit hit = nearest_hit(shadow->ray, scene);
        on = on & (hit.primitive >= 0) & (hit.t < shadow->reach);
        I role = caustic_role(on, hit.primitive, scene);
        on = on & ((role & ROLE_STRAIGHT) != 0);
        if (!ANY(on))
            return sees;
        F3 d = shadow->ray.d;
        Vertex vertex = vertex_of(shadow->ray, hit, on, ZERO, scene);
        Scattered next = clear_sample(vertex, d, chance);
        chance = next.left;
        on = on & passes_straight(vertex, d, next.direction, role) & (max3(next.weight) > 0.0f);
        shadow->light = select3(on, mul(shadow->light, next.weight), shadow->light);
        shadow->reach -= hit.t;
        shadow->ray.o = departure(vertex, d);
        shadow->ray.origin = hit.primitive;
        shadow->ray.triangle = hit.triangle;
        *panes += on ? (I)(1) : FALSE;
    }
#else
    *panes = FALSE;
    return on & NOT(any_hit(shadow->ray, shadow->reach, shadow->target, shadow->target_triangle, scene));
#endif
}

// The share of a photon's power that goes on: a smooth surface gives power, not radiance, its due (no squeeze by
// refraction), and of shading normals that of Veach 1997, ch. 5.3.
static inline F3 share_on(Vertex vertex, F3 d, Scattered next)
{
    F3 weight = next.weight;
    I glass = vertex.kind == MATERIAL_DIELECTRIC;
    weight = select3(glass, keep3(max3(weight) > 0.0f, f3(ONE, ONE, ONE)), weight);
#if HAS_SHADING_NORMAL
    F top = dot3(vertex.ng, next.direction) * dot3(vertex.n, d);
    F below = dot3(vertex.ng, d) * dot3(vertex.n, next.direction);
    weight = scale(weight, MIN(absolute(top) / MAX(absolute(below), (F)(SMALLEST)), (F)(10.0f)));
#endif
    return weight;
}

__kernel void photons(SCENE_PARAMETERS
                      const __global CausticSurface *surfaces,
                      const __global float *surface_curve,  // picks among them
                      __global float       *found,          // eight floats per photon, kernels/caustics/photon.h
                      PhotonPass            pass)
{
    uint first = get_global_id(0) * VW;
    Scene scene = SCENE;
    U sample = (U)(first) + AS_U((I)(LANES));
#if SAMPLER_LATTICE
    sample = reversed_bits(sample) >> pass.unused_digits;   // photons that start at the same piece, side by side
#endif
    U stream = (U)(pass.number);
    Path path;
#if SPECTRUM
    path.wavelength_sample = absolute(wavelength_sample_of(stream, sample, pass.seed));
#endif
#if SPECTRAL_COLOURS
    scene.spectral = spectral_colours_of(path.wavelength_sample, scene.colours);
#endif
#if HAS_DISPERSION
    scene.inverse = inverse_wavelength(path.wavelength_sample, scene.colours);
#endif
    // Start on glass or a mirror, and go on as long as nothing else is met.
    F4 u = random4(stream, sample, (U)(0u), pass.seed);
    StartPoint start = start_point(surfaces, surface_curve, pass.surfaces, u.a, u.b, u.c);
    Hit hit = start.hit;
    path.ray.o = start.p;
    path.ray.d = f3(ZERO, ZERO, ONE);
    path.ray.origin = (I)(NO_PRIMITIVE);
    path.ray.triangle = (I)(NO_TRIANGLE);
    path.beta = f3(ONE, ONE, ONE);
    I on = TRUE;
    F choice = u.d;
    I mark = (I)(NO_PHOTON);
    I panes = FALSE;
    F3 place = f3(ZERO, ZERO, ZERO), way = f3(ZERO, ZERO, ONE), power = f3(ZERO, ZERO, ZERO);
    for (uint edges = 1u;; ++edges) {
        Vertex vertex = vertex_of(path.ray, hit, on, choice, scene);
        if (edges == 1u) {
            // Take light from a lamp.
            F4 light = random4(stream, sample, (U)(3u), pass.seed);
            ShadowRay shadow = light_of_start(vertex, start, light, scene);
            on = shadow.reach > 0.0f;
            if (ANY(on))
                on = sees_lamp(&shadow, on, light.d, &panes, scene);
            path.beta = scale(shadow.light, (F)(pass.per_photon));
            path.ray.d = scale(shadow.ray.d, -ONE);
        } else {
            I ends = on & ((caustic_role(on, hit.primitive, scene) & ROLE_RECEIVER) != 0);
            mark = ends ? (pass.learns ? start.record : hit.primitive | (((I)((int)edges) + panes) << EDGES_SHIFT)) : mark;
            place = select3(ends, vertex.p, place);
            way = select3(ends, path.ray.d, way);
            power = select3(ends, path.beta, power);
            on = on & NOT(ends) & (vertex.kind != MATERIAL_EMISSIVE);
        }
        if (edges >= pass.max_edges || !ANY(on))
            break;
#if HAS_DISPERSION
        leave_one_wavelength(&path, vertex, on, scene);
#endif
        u = random4(stream, sample, (U)(2u * edges), pass.seed);
        Scattered next = scatter_sample(vertex, path.ray.d, side_seen(vertex, path.ray.d), u.a, u.b, u.c);
        path.beta = mul(path.beta, share_on(vertex, path.ray.d, next));
        on = on & (next.pdf == 0.0f) & (max3(path.beta) > 0.0f) & ((I)((int)edges) + panes < (I)((int)pass.max_edges));
        if (edges == 1u)    // what passes a pane straight, photons of what is behind it and light samples bring
            on = on & NOT(passes_straight(vertex, path.ray.d, next.direction, caustic_role(on, hit.primitive, scene)));
        path.ray.o = departure(vertex, next.direction);
        path.ray.d = next.direction;
        path.ray.triangle = hit.triangle;
        path.ray.origin = on ? hit.primitive : (I)(PATH_ENDED);
        if (!ANY(on))
            break;
        hit = nearest_hit(path.ray, scene);
        on = on & (hit.primitive >= 0);
        if (!ANY(on))
            break;
#if HAS_ABSORPTION
        // As on a path, which comes the other way and meets this vertex second.
        path.beta = mul(path.beta, transmittance(vertex, scale(path.ray.d, -ONE), hit.t));
#endif
#if HAS_MIX
        choice = random4(stream, sample, (U)(2u * edges + 2u), pass.seed).c;
#endif
    }
    // Write those that have met a receiver; their light is that of the film, as camera paths have wavelengths of their own.
#if SPECTRUM == SPECTRUM_SPECTRAL
    power = film_value(power, path.wavelength_sample, scene.colours);
#endif
    Eight photon;
    photon.f[0] = place.x; photon.f[1] = place.y; photon.f[2] = place.z;
    photon.f[3] = power.x; photon.f[4] = power.y; photon.f[5] = power.z;
    photon.f[6] = AS_F(octahedral(way));
    photon.f[7] = AS_F(mark);
    store_eight(found, first, photon);
}
