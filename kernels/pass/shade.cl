// One vertex of every living path: emission and environment (weighted against light sampling), then a light sample for
// the shadow pass, then the next direction by sampling the BSDF, then Russian roulette.
// Reads ray, HIT, T, throughput B, radiance L, PDF; writes the next ray, B, L, PDF, SELF and the shadow ray.
// Facts: HAS_<material>, HAS_TEXTURE, HAS_EMITTERS, ENVIRONMENT.
#include "material/vertex.h"
#include "light/environment.h"
#if HAS_EMITTERS
#include "light/emitters.h"
#endif
#include "material/scatter.h"
#include "common/rng.h"

__kernel void shade(const __global Primitive   *primitives,     // sorted by kind
                    const __global int         *kind_end,       // end of each kind in `primitives`
                    const __global Material    *materials,
                    const __global Emitter     *emitters,
                    const __global Environment *environment,
                    __global float             *state,          // path state
                    uint                        capacity,       // slots in the state
                    Wave                        wave,
                    Depth                       depth)
{
    uint slot = get_global_id(0) * VW;
    I self = READ_I(SELF, slot);
    I living = self != PATH_ENDED;
    if (!ANY(living))
        return;
    I hit = living ? READ_I(HIT, slot) : (I)(PATH_ENDED);
    F t = READ_F(T, slot);
    Ray ray;
    ray.d = READ_F3(D, slot);
    F3 beta = READ_F3(B, slot);
    F3 radiance = READ_F3(L, slot);
    I gained = FALSE;
#if ENVIRONMENT
    I escaped = hit == NO_PRIMITIVE;
    if (ANY(escaped)) {
        radiance = add(radiance, keep3(escaped, mul(beta, environment_radiance(ray.d, environment))));
        gained |= escaped;
    }
#endif
    I on = hit >= 0;
    if (!ANY(on)) {
        if (ANY(gained))
            WRITE_F3(L, slot, radiance);
        WRITE_I(SELF, slot, (I)(PATH_ENDED));
        return;
    }
    ray.o = READ_F3(O, slot);
    Vertex vertex = vertex_of(primitives, kind_end, materials, hit, along(ray.o, ray.d, t));
    F cos_i = -dot3(vertex.n, ray.d);
#if HAS_EMISSIVE
    I lamp = on & (vertex.kind == MATERIAL_EMISSIVE);
    if (ANY(lamp)) {
        I shines = lamp & ((cos_i > 0.0f) | (vertex.parameter != 0.0f));
        F weight = ONE;
#if HAS_EMITTERS
        F pdf = READ_F(PDF, slot);
        I rival = shines & (pdf > 0.0f) & (vertex.emitter >= 0);        // light sampling could have met this point too
        if (ANY(rival)) {
            F other = emitter_pdf(emitters, MAX(vertex.emitter, FALSE), ray.o, t, absolute(cos_i));
            weight = rival ? pdf * pdf / (pdf * pdf + other * other) : weight;
        }
#endif
        radiance = add(radiance, keep3(shines, scale(mul(beta, vertex.color), weight)));
        gained |= shines;
        on = on & NOT(lamp);
    }
#endif
    if (ANY(gained))
        WRITE_F3(L, slot, radiance);
    if (depth.edge >= depth.max_edges || !ANY(on)) {
        WRITE_I(SELF, slot, (I)(PATH_ENDED));
        return;
    }
    Lane lane = lane_of(slot, wave);
    F4 u = random4(lane.pixel, lane.sample, 2u * depth.edge, wave.seed);
#if HAS_EMITTERS
    F4 w = random4(lane.pixel, lane.sample, 2u * depth.edge + 1u, wave.seed);
    LightSample light = sample_emitter(emitters, depth.emitters, vertex.p, w.a, w.b, w.c);
    F rival_pdf;
    F3 through = mul(beta, scatter_eval(vertex, ray.d, light.direction, &rival_pdf));
    F mis = light.pdf > 0.0f ? light.pdf * light.pdf / (light.pdf * light.pdf + rival_pdf * rival_pdf) : ONE;
    F3 direct = scale(mul(through, light.radiance), mis);
    I lit = on & (max3(direct) > 0.0f) & (light.reach > 0.0f);
    if (ANY(lit)) {
        WRITE_F3(O, slot, vertex.p);
        WRITE_I(FROM, slot, hit);
        WRITE_F3(W, slot, light.direction);
        WRITE_F3(C, slot, direct);
        WRITE_I(TARGET, slot, light.primitive);
        WRITE_F(REACH, slot, lit ? light.reach : ZERO);
    }
#endif
    Scattered next = scatter_sample(vertex, ray.d, u.a, u.b, u.c);
    beta = mul(beta, next.weight);
    on = on & (max3(beta) > 0.0f);
    if (depth.roulette_edge > 0 && depth.edge >= depth.roulette_edge) {
        F survive = MIN(max3(beta), ONE);
        on = on & (u.d < survive);
        beta = scale(beta, ONE / MAX(survive, (F)(1e-20f)));
    }
    WRITE_I(SELF, slot, on ? hit : (I)(PATH_ENDED));
    if (!ANY(on))
        return;
    WRITE_F3(O, slot, vertex.p);
    WRITE_F3(D, slot, next.direction);
    WRITE_F3(B, slot, beta);
#if HAS_EMITTERS
    WRITE_F(PDF, slot, next.pdf);
#endif
}
