// Light of a lamp behind clear glass: the ray of a light sample that something blocks goes on by smooth glass as a path would,
// bent or mirrored by chance, and brings what it meets of the lamp that it was aimed at, or of the sun or sky where it leaves
// the scene. Paths that go the same way from where they were scattered last are weighted against it (emission of
// integrator/path.h, light/infinity.h), so that every way of light counts once.
#ifndef GLASS_H
#define GLASS_H
#include "integrator/path.h"
#include "geometry/nearest.h"

// What the lamp shows at a vertex met along d; 0 where that is none.
static inline F3 radiance_of_lamp(Vertex vertex, F3 d)
{
    F front = -dot3(vertex.ng, d);
    F3 light = f3(ZERO, ZERO, ZERO);
#if HAS_EMISSIVE
    light = keep3((vertex.kind == MATERIAL_EMISSIVE) & ((front > 0.0f) | (vertex.parameter != 0.0f)), vertex.color);
#endif
#if HAS_GLOW
    light = add(light, keep3(GLOWS(vertex, front), vertex.closure.glow));
#endif
    return light;
}

// What the sun or the sky that a sample was aimed at shows along d.
static F3 radiance_from_afar(I target, F3 d, Scene scene)
{
    F3 light = f3(ZERO, ZERO, ZERO);
#if ENVIRONMENT_SAMPLED
    light = keep3(target == FROM_SKY, environment_radiance(d, scene));
#endif
#if EMITTER_SUNS
    for (int i = scene.environment->first_sun; i < scene.environment->first_sun + scene.environment->suns; ++i) {
        const __global Emitter *sun = scene.emitters + i;
        light = select3((target == FROM_SUN - i) & meets_sun(sun, d), sun_radiance(sun, scene), light);
    }
#endif
    return light;
}

#if SPECTRUM
#define GLASS_WAVELENGTH(sample) (sample)
#else
#define GLASS_WAVELENGTH(sample) ZERO
#endif

// Of lanes `on`, whose ray left a path that may have `left` edges more.
static F3 light_through_glass(ShadowRay shadow, I on, I left, F wavelength_sample, Scene scene)
{
    Path way;
    way.ray = shadow.ray;
    way.beta = shadow.share;
#if SPECTRUM
    way.wavelength_sample = wavelength_sample;
#endif
    F3 light = f3(ZERO, ZERO, ZERO);
    on = on & (max3(way.beta) > 0.0f);
#if PANES_BY_SAMPLES
    I straight = AS_I(shadow.chance) < 0;
    shadow.chance = absolute(shadow.chance);
#endif
    for (int edges = 1; ANY(on); ++edges) {
        way.ray.origin = on ? way.ray.origin : (I)(PATH_ENDED);
        Hit hit = nearest_hit(way.ray, scene);
        on = on & (left >= edges);
#if ENVIRONMENT_SAMPLED || EMITTER_SUNS
        I escaped = on & (hit.primitive == NO_PRIMITIVE) & (shadow.target <= FROM_SKY);
        if (edges > 1 && ANY(escaped))
            light = select3(escaped, mul(way.beta, radiance_from_afar(shadow.target, way.ray.d, scene)), light);
#endif
        on = on & (hit.primitive >= 0);
        if (!ANY(on))
            break;
        Vertex vertex = vertex_of(way.ray, hit, on, ZERO, scene);
#if HAS_DISPERSION && !LENS_SPLITS
        leave_one_wavelength(&way, vertex, on, scene);
#endif
#if HAS_ABSORPTION
        way.beta = mul(way.beta, transmittance(vertex, way.ray.d, hit.t));
#endif
        I met = on & (hit.primitive == shadow.target);
#if EMITTER_TRIANGLES
        met = met & (hit.triangle == shadow.target_triangle);
#endif
        if (edges > 1 && ANY(met))      // the first edge is that of the shadow ray itself
            light = select3(met, mul(way.beta, radiance_of_lamp(vertex, way.ray.d)), light);
        Scattered next = clear_sample(vertex, way.ray.d, shadow.chance);
        shadow.chance = next.left;
        way.beta = mul(way.beta, next.weight);
        on = on & NOT(met) & (max3(way.beta) > 0.0f);
#if PANES_BY_SAMPLES
        I role = caustic_role(on, hit.primitive, scene);
        on = on & (NOT(straight) | passes_straight(vertex, way.ray.d, next.direction, role));
#endif
        way.ray.o = departure(vertex, next.direction);
        way.ray.d = next.direction;
        way.ray.triangle = hit.triangle;
        way.ray.origin = hit.primitive;
    }
    return light;
}

#endif
