// A vertex of a path: where it is and what it is made of. Neighbouring lanes mostly hit the same primitive, so the lanes
// are taken primitive by primitive: its records are then the same for all, and read once instead of gathered per lane.
#ifndef VERTEX_H
#define VERTEX_H
#include "geometry/surface_point.h"
#include "material/texture.h"

typedef struct {
    F3 p, n;        // position and outward unit normal for shading
    F3 ng;          // outward unit normal of the surface itself
#if HAS_TANGENT
    F3 tangent;     // dp/du, of any length
#endif
#if HAS_MESH
    F  offset;      // see SurfacePoint
#endif
    F3 color;       // reflectance, or radiance of an emissive material
    F  parameter;   // GGX alpha; index of refraction; of an emissive material whether it shines on both sides
    I  kind;        // MATERIAL_…
    I  emitter;     // index of the emitter that light sampling chooses for this primitive, or -1
} Vertex;

// Of the lanes `on`.
static Vertex vertex_of(Ray ray, Hit hit, I on, Scene scene)
{
    Vertex vertex;
    F3 p = along(ray.o, ray.d, hit.t);
    vertex.p = p;
    vertex.n = f3(ZERO, ZERO, ONE);
    vertex.ng = vertex.n;
#if HAS_TANGENT
    vertex.tangent = f3(ONE, ZERO, ZERO);
#endif
#if HAS_MESH
    vertex.offset = ZERO;
    SurfacePoint on_mesh;
    int first_mesh = scene.kind_end[KIND_MESH - 1];
    I meshes = on & (hit.primitive >= first_mesh);
    if (ANY(meshes))
        on_mesh = point_on_mesh(hit, meshes, scene);
#endif
    vertex.color = f3(ZERO, ZERO, ZERO);
    vertex.parameter = ONE;
    vertex.kind = (I)(-1);
    vertex.emitter = (I)(-1);
    I rest = on;
    while (ANY(rest)) {
        int index = first_of(hit.primitive, rest);
        I mine = hit.primitive == index;
        const __global Primitive *primitive = scene.primitives + index;
        const __global Material *material = scene.materials + primitive->material;
#if HAS_MESH
        SurfacePoint point;
        if (index >= first_mesh)
            point = on_mesh;
        else
            point = surface_point(index, p, material->texture >= 0, scene);
        vertex.offset = mine ? point.offset : vertex.offset;
#else
        SurfacePoint point = surface_point(index, p, material->texture >= 0, scene);
#endif
        vertex.p = select3(mine, point.p, vertex.p);
        vertex.n = select3(mine, point.n, vertex.n);
        vertex.ng = select3(mine, point.ng, vertex.ng);
#if HAS_TANGENT
        vertex.tangent = select3(mine, point.tangent, vertex.tangent);
#endif
        vertex.color = select3(mine, reflectance_at(material, point.u, point.v, scene), vertex.color);
        vertex.parameter = mine ? (F)(material->parameter) : vertex.parameter;
        vertex.kind = mine ? (I)(material->kind) : vertex.kind;
#if HAS_EMITTERS
#if EMITTER_TRIANGLES
        vertex.emitter = mine ? (index >= first_mesh ? hit.part - primitive->first_triangle : FALSE)
                                    + primitive->emitter : vertex.emitter;
#else
        vertex.emitter = mine ? (I)(primitive->emitter) : vertex.emitter;
#endif
#endif
        rest = rest & NOT(mine);
    }
    return vertex;
}

#endif
