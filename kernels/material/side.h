// The side of a surface from which a path sees it, and the shading normal there.
#ifndef SIDE_H
#define SIDE_H
#include "material/vertex.h"

typedef struct {
    F3 n;           // shading normal on the side of the path
    F  cosine;      // of the path to it, >= 0
    I  behind;      // the path comes from the back
} Side;

#if HAS_SHADING_NORMAL
#define GRAZING 1e-3f       // least cosine of a path to the shading normal, and of its mirror image to the true one

static Side side_of(Vertex vertex, F3 d)
{
    Side side;
    F front = -dot3(vertex.ng, d);
    side.behind = front < 0.0f;
    side.n = scale(vertex.n, with_sign(ONE, front));
    side.cosine = -dot3(side.n, d);
    // A shading normal that turns its back on the path is bent until it just faces it: no black fringes.
    I away = side.cosine < GRAZING;
    if (ANY(away)) {
        F3 bent = normalized(along(side.n, d, side.cosine - GRAZING));
        side.n = select3(away, bent, side.n);
        side.cosine = away ? MAX(-dot3(side.n, d), ZERO) : side.cosine;
    }
    // One whose mirror direction is below the surface is bent until that just leaves it: no black rims of shiny meshes.
    F3 out = scale(vertex.ng, with_sign(ONE, front));
    F3 mirrored = along(d, side.n, 2.0f * side.cosine);
    F rise = dot3(mirrored, out);
    I sunk = (rise < GRAZING) & (vertex.kind != MATERIAL_MATTE);
    if (ANY(sunk)) {
        F3 bent = normalized(sub(normalized(along(mirrored, out, GRAZING - rise)), d));
        side.n = select3(sunk, bent, side.n);
        side.cosine = sunk ? MAX(-dot3(side.n, d), ZERO) : side.cosine;
    }
    return side;
}

// Whether `wo` leaves on the same side of the surface itself as of its shading normal: light that would have to pass
// through the surface to agree with both is left out, when evaluating as when sampling.
static inline I consistent(Vertex vertex, Side side, F3 wo)
{
    F true_side = dot3(vertex.ng, wo);
    true_side = side.behind ? -true_side : true_side;
    return (true_side > 0.0f) == (dot3(side.n, wo) > 0.0f);
}
#else
static inline Side side_of(Vertex vertex, F3 d)
{
    Side side;
    F front = -dot3(vertex.n, d);
    side.behind = front < 0.0f;
    side.n = scale(vertex.n, with_sign(ONE, front));
    side.cosine = absolute(front);
    return side;
}
#endif

#endif
