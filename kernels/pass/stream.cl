// Carries VW pixels through all their samples of a wave: every lane takes its path from vertex to vertex and, when it ends,
// adds it to the film and starts the next camera ray of its pixel, so that lanes are hardly ever idle. The same steps as
// intersect, shade, shadow and film, without state in memory between them.
// RAYS_FILE says where camera rays come from: integrator/made_rays.h makes them one by one, integrator/kept_rays.h those of
// the wave before the first is taken, integrator/read_rays.h reads those that generate wrote.
#include "integrator/film.h"
#include "integrator/path.h"
#if HAS_MEDIA
#define MEETS_BOUNDARIES
#include "integrator/media.h"
#endif
#include "geometry/nearest.h"
#if LAMPS_BEHIND_GLASS
#include "integrator/glass.h"
#endif
#include RAYS_FILE

#define MOST_IDLE  (VW / 4u)      // lanes that wait for others before all of them take camera rays together

__kernel void stream(SCENE_PARAMETERS
                     RAYS_PARAMETERS
                     Wave                  wave,
                     Limits                limits,
                     __global float       *sums,        // [6][pixels]: r, g, b and their compensations
                     __global uint        *counters,
                     uint                  pixels,      // pixels of the film incl. tile padding
                     const __global uint  *tiles,       // that are rendered
                     const __global float *survival_scale)    // of roulette, by cell of the film
{
    uint first = get_global_id(0) * VW;
    Scene scene = SCENE;
#if FLAT_TABLES
    FlatTables flats = flat_tables(scene);
    scene.flats = &flats;
#endif
    Rules rules = rules_of(wave, limits);
    uint place = film_place(first, wave, tiles);
    PixelSum film = read_pixels(sums, place, pixels);
    CameraRays camera_rays = RAYS_START;
    I running = FALSE;
    Path path;
    path.ray.o = f3(ZERO, ZERO, ZERO);
    path.ray.d = f3(ZERO, ZERO, ONE);
    path.ray.origin = (I)(PATH_ENDED);
    path.ray.triangle = (I)(NO_TRIANGLE);
#if HAS_MOTION
    path.ray.time = ZERO;
#endif
    path.weight = ZERO;
    path.survival_scale = survival_scale_at(camera_rays.lane, limits, survival_scale);
#if SPECTRUM
    path.wavelength_sample = ZERO;
#endif
    path.beta = f3(ZERO, ZERO, ZERO);
    path.radiance = f3(ZERO, ZERO, ZERO);
#if LIGHT_GROUPS
    path.groups = no_group_light();
#endif
    path.pdf = ZERO;
#if LAMPS_BEHIND_GLASS
    path.scattered.o = path.scattered.d = path.ray.d;
    path.scattered.pdf = ZERO;
#endif
#if LIGHT_TREE
    path.receiver = all_round();
#endif
#if CAUSTICS
    path.since_receiver = FALSE;
#endif
#if HAS_MEDIA
    path.medium = (I)(scene.media_at_camera);
#if HAS_ENTRIES
    path.entry = f3(ZERO, ZERO, ZERO);
#endif
#endif
    path.depth = (U)(1u);
    path.pixel = camera_rays.lane.pixel;
    path.sample = camera_rays.lane.sample;
    for (;;) {
        // Start camera rays in lanes whose path has ended, once enough of them are idle or all are.
        I start = NOT(running) & rays_left(camera_rays);
        if (COUNT(start) > MOST_IDLE || (ANY(start) && !ANY(running))) {
            WorldRay ray = take_rays(&camera_rays, start);
            I started = start & (ray.weight != 0.0f);       // a ray that the lens blocks weighs zero
            path.sample = camera_rays.lane.sample;
            path.ray.o = select3(started, ray.o, path.ray.o);
            path.ray.d = select3(started, ray.d, path.ray.d);
#if HAS_MOTION
            path.ray.time = started ? ray.time : path.ray.time;
#endif
            path.weight = started ? ray.weight : path.weight;
#if SPECTRUM
            path.wavelength_sample = started ? wavelength_sample_of(path.pixel, path.sample, wave.seed)
                                             : path.wavelength_sample;
#endif
#if SPECTRAL_COLOURS
            scene.spectral = spectral_colours_of(path.wavelength_sample, scene.colours);
#endif
#if HAS_DISPERSION
            scene.inverse = inverse_wavelength(path.wavelength_sample, scene.colours);
#endif
            path.beta = select3(started, FIRST_BETA, path.beta);
            path.radiance = keep3(NOT(started), path.radiance);
#if LIGHT_GROUPS
            for (int g = 0; g < LIGHT_GROUPS; ++g)
                path.groups.of[g] = keep3(NOT(started), path.groups.of[g]);
#endif
            path.ray.origin = started ? (I)(NO_PRIMITIVE) : path.ray.origin;
            path.ray.triangle = started ? (I)(NO_TRIANGLE) : path.ray.triangle;
            path.pdf = started ? ZERO : path.pdf;
#if LAMPS_BEHIND_GLASS
            path.scattered.pdf = started ? ZERO : path.scattered.pdf;
#endif
#if CAUSTICS
            path.since_receiver = started ? FALSE : path.since_receiver;
#endif
#if HAS_MEDIA
            path.medium = started ? (I)(scene.media_at_camera) : path.medium;
#endif
            path.depth = started ? (U)(1u) : path.depth;
            running |= started;
        }
        if (!ANY(running)) {
            if (!ANY(rays_left(camera_rays)))
                break;
            continue;
        }
        // Intersect and shade one vertex of every path.
#if HAS_MEDIA
        Hit hit = travel_on(&path, scene, rules);
        ShadowRay shadow = shade_vertex(&path, hit, scene, rules);
#else
        ShadowRay shadow = shade_vertex(&path, nearest_hit(path.ray, scene), scene, rules);
#endif
        // Add the light samples that nothing blocks.
#if HAS_EMITTERS
        I wanted = shadow.reach > 0.0f;
        if (ANY(wanted)) {
            I passed;
            I dark = blocked_before(shadow.ray, shadow.reach, shadow.target, shadow.target_triangle, 1, &passed, scene);
#if LIGHT_PASSES
            shadow.light = scale(shadow.light, passed ? ONE : shadow.mis);
#endif
#if HAS_DENSITY
            Chance chance = chance_of(path.pixel, path.sample, FROM_A_SURFACE + path.depth - 1u, rules.seed);
#endif
#if HAS_MEDIA
            shadow.light = mul(shadow.light, shadow_transmittance(shadow.ray, shadow.medium, shadow.reach,
                                                                  wanted & NOT(dark), scene WITH_CHANCE(chance)));
#endif
#if LIGHT_GROUPS
            I group = shadow.group;
#else
            I group = FALSE;
#endif
            gather_light(&path, wanted & NOT(dark), shadow.light, group);
#if LAMPS_BEHIND_GLASS
            I bent = wanted & dark & (max3(shadow.share) > 0.0f);
            if (ANY(bent)) {
                I left = AS_I((U)(rules.max_depth + 1u) - path.depth);
                gather_light(&path, bent, light_through_glass(shadow, bent, left, GLASS_WAVELENGTH(path.wavelength_sample),
                                                              scene), group);
            }
#endif
        }
#endif
        // Add paths that ended to the film.
        I ended = running & (path.ray.origin == PATH_ENDED);
        if (ANY(ended)) {
#if SPECTRUM
#define ON_FILM(light) film_value(light, path.wavelength_sample, scene.colours)
#else
#define ON_FILM(light) (light)
#endif
            F3 value = ON_FILM(path.radiance);
#if LIGHT_GROUPS
            for (int g = 0; g < LIGHT_GROUPS; ++g) {
                __global float *planes = planes_of_group(sums, pixels, g);
                PixelSum of = add_of_group(read_sums(planes, place, pixels), ended, scale(value, path.weight),
                                           scale(ON_FILM(path.groups.of[g]), path.weight));
                write_sums(planes, place, pixels, of);
            }
#endif
            film = add_sample(film, ended, scale(value, path.weight), counters);
            running = running & NOT(ended);
        }
    }
    write_pixels(sums, place, pixels, film);
}
