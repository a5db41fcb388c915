// What a way inside a solid leaves of the light (Beer and Lambert): the way ends at this vertex on the back of its surface.
#ifndef ABSORPTION_H
#define ABSORPTION_H
#include "common/exponential.h"
#include "material/vertex.h"

static inline F3 transmittance(Vertex vertex, F3 d, F length)
{
    I inside = dot3(vertex.ng, d) > 0.0f;
    F3 a = vertex.closure.absorption;
    if (!ANY(inside & (max3(a) > 0.0f)))
        return f3(ONE, ONE, ONE);
    F way = inside ? -length : ZERO;
    return f3(exponential(a.x * way), exponential(a.y * way), exponential(a.z * way));
}

#endif
