// A thin sheet that scatters light evenly to both sides, as leaves, paper and lampshades do.
#ifndef TRANSLUCENT_H
#define TRANSLUCENT_H
#include "material/bsdf.h"

#if HAS_TRANSLUCENT
static inline I translucent_is(I kind) { return kind == MATERIAL_TRANSLUCENT; }

// Probability of staying on the side of the path.
static inline F staying_share(Vertex vertex)
{
    F back = max3(vertex.color);
    F on = max3(vertex.closure.passed);
    return back > 0.0f ? back / (back + on) : ZERO;
}

static inline F3 translucent_eval(Vertex vertex, F3 d, Side side, F3 wo, F *pdf)
{
    F cos_o = dot3(side.n, wo);
    I stays = cos_o > 0.0f;
    F share = staying_share(vertex);
    F even = absolute(cos_o) * INV_PI_F;
    *pdf = even * (stays ? share : 1.0f - share);
    return scale(select3(stays, vertex.color, vertex.closure.passed), even);
}

static Scattered translucent_sample(Vertex vertex, F3 d, Side side, F u, F v, F lobe)
{
    F3 s, t;
    surface_frame(vertex, side.n, &s, &t);
    F3 wo = cosine_direction(u, v);
    F share = staying_share(vertex);
    I stays = lobe < share;
    F chance = stays ? share : 1.0f - share;
    Scattered out;
    out.pdf = wo.z * INV_PI_F * chance;
    wo.z = stays ? wo.z : -wo.z;
    out.direction = from_frame(s, t, side.n, wo);
    F3 weight = scale(select3(stays, vertex.color, vertex.closure.passed), 1.0f / MAX(chance, (F)(SMALLEST)));
    out.weight = keep3(wo.z != 0.0f, weight);
    return out;
}
#endif

#endif
