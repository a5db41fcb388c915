// Paths of one pass that leave virtual lights: each starts at a place of a surface, with the light that arrives there, and leaves
// one wherever it meets a surface that scatters evenly. Or, to learn which of them matter, from the eye with an even share of
// what it sees: what these paths bring to a place is what a light there brings to the camera.
// Facts: those of the scene.
#include "caustics/surface.h"
#include "integrator/path.h"
#include "geometry/nearest.h"
#include "light/virtual_lights.h"

// Power that arrives where a path starts, along path->ray.d, by one of two ways that share it as on every path (Veach 1997): a
// light sample, or a direction by chance that meets what shines. Those with a chance of 0 have light samples alone, which then
// find all. `sizeless`: lanes whose lamp has no surface, so that camera paths never find it by mirrors and smooth glass alone. What
// shines through clear glass is left to the paths that start on the glass, whether light samples of the camera follow it or not.
static I take_light(Path *path, Vertex vertex, StartPoint start, F4 u, I *sizeless, LightPass pass, Scene scene)
{
    *sizeless = FALSE;
    I by_chance = u.d < pass.by_chance;
    F3 power = f3(ZERO, ZERO, ZERO);
    path->beta = f3(ONE, ONE, ONE);
    path->radiance = power;
    path->ray.origin = start.hit.primitive;
    path->ray.triangle = start.hit.triangle;
#if LIGHT_TREE
    path->receiver = all_round();
#endif
    F3 towards = vertex.ng;
    if (ANY(by_chance)) {
        F3 s, t;
        frame(vertex.ng, &s, &t);
        F3 way = cosine_direction(u.a, u.b);
        way.z = u.c < 0.5f ? -way.z : way.z;
        F3 d = from_frame(s, t, vertex.ng, way);
        path->ray.o = departure(vertex, d);
        path->ray.d = d;
        path->pdf = absolute(way.z) * (0.5f * INV_PI_F);
#if LAMPS_BEHIND_GLASS
        path->scattered = (Departure){path->ray.o, d, path->pdf};
#endif
        I origin = path->ray.origin;
        path->ray.origin = by_chance ? origin : (I)(PATH_ENDED);
        Hit hit = nearest_hit(path->ray, scene);
#if ENVIRONMENT || EMITTER_SUNS
        leave_scene(path, by_chance & (hit.primitive == NO_PRIMITIVE), scene);
#endif
#if HAS_LAMPS
        I meets = by_chance & (hit.primitive >= 0);
        if (ANY(meets))
            add_emission(path, vertex_of(path->ray, hit, meets, ZERO, scene), meets, hit, scene);
#endif
        towards = d;
        power = scale(path->radiance, (F)(2.0f * PI_F / MAX(pass.by_chance, 1e-6f)));
    }
#if HAS_EMITTERS
    I sampled = NOT(by_chance);
    if (ANY(sampled)) {
        LightSample light = sample_emitter(scene, vertex.p, all_round(), u.a, u.b, u.c);
        Ray ray = path->ray;
        ray.o = departure(vertex, light.direction);
        ray.d = light.direction;
        ray.origin = start.hit.primitive;
        F cosine = absolute(dot3(vertex.ng, light.direction));
        F rival = MIN(light.pdf, (F)(LARGEST_DENSITY)), pdf = cosine * (0.5f * INV_PI_F);
        F mis = ((rival > 0.0f) & (I)(pass.by_chance > 0.0f ? -1 : 0)) ? rival * rival / (rival * rival + pdf * pdf) : ONE;
#if LAMPS_BY_SAMPLES
        mis = ONE;
#endif
        F3 direct = scale(light.radiance, cosine * mis / (F)(1.0f - MIN(pass.by_chance, 0.99f)));
        I lit = sampled & (max3(direct) > 0.0f) & (light.reach > 0.0f);
        if (ANY(lit))
            lit = lit & NOT(any_hit(ray, lit ? light.reach : ZERO, light.primitive, light.triangle, scene));
        power = select3(sampled, keep3(lit, direct), power);
        towards = select3(sampled, light.direction, towards);
        *sizeless = sampled & (light.pdf == 0.0f);
    }
#endif
    path->beta = scale(power, start.area * pass.per_path);
    path->ray.d = scale(towards, -ONE);
    return max3(path->beta) > 0.0f;
}

#if HAS_OPACITY
// Lanes whose start is no hole.
static I starts_on_something(StartPoint start, I on, F chance, Scene scene)
{
    for (I rest = on; ANY(rest);) {
        int index = first_of(start.hit.primitive, rest);
        I mine = start.hit.primitive == index;
        rest = rest & NOT(mine);
        const __global Material *material = scene.materials + scene.primitives[index].material;
        if (!has_holes(material))
            continue;
#if HAS_MESH
        SurfacePoint point = index >= scene.kind_end[KIND_MESH - 1] ? point_on_mesh(start.hit, mine, scene)
                                                                    : surface_point(index, start.p, material->textured, scene);
#else
        SurfacePoint point = surface_point(index, start.p, material->textured, scene);
#endif
        on = on & (NOT(mine) | is_there(material, point.u, point.v, chance, scene));
    }
    return on;
}
#endif

// The share of a path's power that goes on. Where directions have a density it is what a camera path that comes the other way finds
// (Veach 1997, ch. 3.7 and 5.3), so that shading normals and refraction are as on its way; smooth
// surfaces are the same both ways, but that glass squeezes radiance and not power.
static F3 power_on(Vertex vertex, F3 d, Scattered next)
{
    F3 weight = next.weight;
    F before = dot3(vertex.ng, d), after = dot3(vertex.ng, next.direction);
#if HAS_DIELECTRIC
    I passes = (vertex.kind == MATERIAL_DIELECTRIC) & ((before > 0.0f) == (after > 0.0f));
    F index = before > 0.0f ? ONE / vertex.parameter : vertex.parameter;
    weight = select3(passes, scale(weight, index * index), weight);
#endif
#if HAS_SHADING_NORMAL
    F top = after * dot3(vertex.n, d), below = before * dot3(vertex.n, next.direction);
    weight = scale(weight, absolute(top) / MAX(absolute(below), (F)(SMALLEST)));
#endif
    I spread = next.pdf > 0.0f;
    if (ANY(spread)) {
        F pdf;
        F3 back = scale(next.direction, -ONE);
        F3 seen = scatter_eval(vertex, back, side_seen(vertex, back), scale(d, -ONE), &pdf);
        F over = absolute(after) / MAX(absolute(before) * next.pdf, (F)(SMALLEST));
        weight = select3(spread & (max3(weight) > 0.0f), scale(seen, over), weight);
    }
    return weight;
}

__kernel void light_paths(SCENE_PARAMETERS
                          const __global CausticSurface *surfaces,
                          const __global float *surface_curve,  // picks among them
                          __global float       *found,          // [8][edge][path], light/virtual_lights.h
                          LightPass             pass)
{
    uint first = get_global_id(0) * VW;
    Scene scene = SCENE;
    U sample = (U)(first) + AS_U((I)(LANES));
    U stream = (U)(pass.number);
    Path path;
#if SPECTRUM
    path.wavelength_sample = ZERO;
#endif
    path.pdf = ZERO;
#if LAMPS_BEHIND_GLASS
    path.scattered = (Departure){f3(ZERO, ZERO, ZERO), f3(ZERO, ZERO, ONE), ZERO};
#endif
#if CAUSTICS
    path.since_receiver = FALSE;
#endif
    F4 u = random4(stream, sample, (U)(0u), pass.seed);
    StartPoint start = start_point(surfaces, surface_curve, pass.surfaces, u.a, u.b, u.c);
    Hit hit = start.hit;
    path.ray.o = start.p;
    path.ray.d = f3(ZERO, ZERO, ONE);
    path.ray.origin = (I)(NO_PRIMITIVE);
    path.ray.triangle = (I)(NO_TRIANGLE);
    path.beta = f3((F)(pass.per_path), (F)(pass.per_path), (F)(pass.per_path));
    path.radiance = f3(ZERO, ZERO, ZERO);
    I on = TRUE, sizeless = FALSE;
    F choice = u.d;
#if HAS_OPACITY
    on = starts_on_something(start, on, random4(stream, sample, (U)(1u), pass.seed).a, scene);
#endif
    if (pass.from_eye) {
        F sn, cs;
        sincos_turns(u.a, &sn, &cs);
        F z = 2.0f * u.b - 1.0f;
        F aside = root(1.0f - z * z);
        path.ray.o = f3(ZERO, ZERO, ZERO);
        path.ray.d = f3(aside * cs, aside * sn, z);
        hit = nearest_hit(path.ray, scene);
        on = hit.primitive >= 0;
    }
    for (uint bounce = 1u; bounce <= pass.max_edges; ++bounce) {
        Vertex vertex = vertex_of(path.ray, hit, on, choice, scene);
        on = on & (vertex.kind != MATERIAL_EMISSIVE);
        if (bounce == 1u && !pass.from_eye)
            on = on & take_light(&path, vertex, start, random4(stream, sample, (U)(3u), pass.seed), &sizeless, pass, scene);
        // Of lamps without a size, which camera paths never meet, smooth surfaces alone send on what photons bring to receivers.
#if CAUSTICS
        I role = caustic_role(on, hit.primitive, scene);
        I by_spread = bounce == 1u ? TRUE : receives(vertex, role);
        I by_smooth = bounce == 1u ? (role & ROLE_SURFACE) != 0 : (role & ROLE_RECEIVER) == 0;
#else
        I by_spread = TRUE, by_smooth = FALSE;
#endif
        // Leave a virtual light.
        F3 n = facing_side(vertex, path.ray.d);
        F3 light = scale(mul(path.beta, vertex.color), (F)(INV_PI_F));
        I leaves = on & scatters_evenly(vertex) & (NOT(sizeless) | by_spread);
        I way = leaves ? start.record | ((I)((int)bounce) << WAY_SHIFT) : (I)(NO_LIGHT);
        F floats[8] = {vertex.p.x, vertex.p.y, vertex.p.z, light.x, light.y, light.z, AS_F(octahedral(n)), AS_F(way)};
        for (uint k = 0u; k < 8u; ++k)
            STORE_F(found, ((size_t)(k * pass.max_edges) + bounce - 1u) * pass.paths + first, floats[k]);
        // Go on, or end.
        u = random4(stream, sample, (U)(2u * bounce), pass.seed);
        Scattered next = scatter_sample(vertex, path.ray.d, side_seen(vertex, path.ray.d), u.a, u.b, u.c);
        F3 weight = power_on(vertex, path.ray.d, next);
        F survive = MIN(MAX(max3(weight), (F)(LEAST_CHANCE)), ONE);
        I smooth = next.pdf == 0.0f;
        on = on & (max3(weight) > 0.0f) & (u.d < survive) & (NOT(sizeless) | (smooth ? by_smooth : by_spread));
        sizeless = sizeless & smooth;
        if (!ANY(on)) {
            for (uint rest = bounce; rest < pass.max_edges; ++rest)
                STORE_F(found, ((size_t)(7u * pass.max_edges) + rest) * pass.paths + first, AS_F((I)(NO_LIGHT)));
            break;
        }
        path.beta = scale(mul(path.beta, weight), ONE / survive);
        path.ray.o = departure(vertex, next.direction);
        path.ray.d = next.direction;
        path.ray.triangle = hit.triangle;
        path.ray.origin = on ? hit.primitive : (I)(PATH_ENDED);
        hit = nearest_hit(path.ray, scene);
        on = on & (hit.primitive >= 0);
#if HAS_ABSORPTION
        // As on a camera path, which meets this vertex second.
        path.beta = mul(path.beta, transmittance(vertex, scale(path.ray.d, -ONE), hit.t));
#endif
#if HAS_MIX
        choice = random4(stream, sample, (U)(2u * bounce + 2u), pass.seed).c;
#endif
    }
}
