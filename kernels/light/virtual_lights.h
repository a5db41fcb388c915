// Virtual lights: places of matte surfaces, with the light that they scatter, to which vertices of camera paths connect (Keller
// 1997). Such a place can also be met by the path's own direction. Both share each pair of a vertex and a place: the
// connection gets the part of its strength that stays below a bound, the path's direction the rest (Kollig and Keller 2004).
// The bound follows how densely virtual lights are picked where the place is, by cells of a grid and the side that a surface
// faces. Eight floats in memory: position, light in red, green and blue [W/sr], normal (octahedral), and the edges of its way with
// the record of the surface where it began.
#ifndef VIRTUAL_LIGHTS_H
#define VIRTUAL_LIGHTS_H
#include "common/octahedral.h"
#include "common/transpose.h"
#include "material/side.h"

#define WAY_SHIFT     24        // records below, the number of edges above
#define NO_LIGHT      (-1)      // in place of both
#define FLAT_ENOUGH   0.999999f // cosine between the normals for shading and of the surface: matte light leaves evenly
#define SHORT_OF      0.9999f   // of the way to a place: how far a connection looks for what is between

// Whether light leaves a surface evenly, whatever the direction that it is seen from.
static inline I scatters_evenly(Vertex vertex)
{
#if HAS_MATTE
    I even = (vertex.kind == MATERIAL_MATTE) & (dot3(vertex.n, vertex.ng) > FLAT_ENOUGH);
#if HAS_OREN_NAYAR
    even = even & (vertex.parameter == 0.0f);
#endif
    return even;
#else
    return FALSE;
#endif
}

// The unit normal on the side from which a path comes along d.
static inline F3 facing_side(Vertex vertex, F3 d) { return scale(vertex.ng, with_sign(ONE, -dot3(vertex.ng, d))); }

#if VIRTUAL_LIGHTS
// How densely virtual lights are picked about a place that faces n, times the bound of connections [1/m2].
static F density_of_lights(F3 p, F3 n, Scene scene)
{
    const __global VirtualGrid *grid = scene.virtual_grid;
    I last = (I)(grid->side - 1);
    float per_cell = grid->low.w;
#if HAS_PLANE
    // Beyond the grid, where planes go on, there are none.
    F side = (F)((float)grid->side);
    F3 in = f3((p.x - grid->low.x) * per_cell, (p.y - grid->low.y) * per_cell, (p.z - grid->low.z) * per_cell);
    I inside = (MIN(MIN(in.x, in.y), in.z) >= 0.0f) & (MAX(MAX(in.x, in.y), in.z) < side);
    p = select3(inside, p, f3((F)(grid->low.x), (F)(grid->low.y), (F)(grid->low.z)));
#endif
    I x = MIN(MAX(TO_I((p.x - grid->low.x) * per_cell), FALSE), last);
    I y = MIN(MAX(TO_I((p.y - grid->low.y) * per_cell), FALSE), last);
    I z = MIN(MAX(TO_I((p.z - grid->low.z) * per_cell), FALSE), last);
    F ax = absolute(n.x), ay = absolute(n.y), az = absolute(n.z);
    I upright = (az > ax) & (az > ay), deep = ay > ax;
    F most = upright ? n.z : (deep ? n.y : n.x);
    I facing = (upright ? (I)(4) : (deep ? (I)(2) : FALSE)) + (most < 0.0f ? (I)(1) : FALSE);
    F density = GATHER(F, scene.virtual_density, ((facing * grid->side + z) * grid->side + y) * grid->side + x, );
#if HAS_PLANE
    density = inside ? density : ZERO;
#endif
    return density;
}

// Of a pair, the share of the connection: of a direction of density `pdf` at the vertex, that meets the place at a cosine.
static inline F share_of_connection(F pdf, F cosine, F distance2, F density)
{
    return MIN(density * distance2 / MAX(pdf * cosine, (F)(SMALLEST)), ONE);
}
#endif

#endif
