// A perfectly smooth reflector.
#ifndef MIRROR_H
#define MIRROR_H
#include "material/bsdf.h"

#if HAS_MIRROR
static inline I mirror_is(I kind) { return kind == MATERIAL_MIRROR; }

static inline Scattered mirror_sample(Vertex vertex, F3 d, Side side, F u, F v, F lobe)
{
    Scattered out;
    out.direction = mirrored_direction(d, side);
    out.weight = vertex.color;
    out.pdf = ZERO;
    return out;
}
#endif

#endif
