// A vertex of a path: where it is and what it is made of. Neighbouring lanes mostly hit the same primitive, so the lanes
// are taken primitive by primitive: its records are then the same for all, and read once instead of gathered per lane.
#ifndef VERTEX_H
#define VERTEX_H
#include "geometry/surface_point.h"
#include "material/closure.h"
#if HAS_TANGENT
#include "geometry/tangent.h"
#endif
#include "material/bump.h"

typedef struct {
    F3 p, n;        // position and outward unit normal for shading
    F3 ng;          // outward unit normal of the surface itself
#if HAS_COAT_NORMAL
    F3 coat_n;      // as `n`, of the clear coat
#endif
#if HAS_TANGENT
    F3 tangent;     // dp/du, of any length
#endif
#if HAS_MESH
    F  offset;      // see SurfacePoint
#endif
    F3 color;       // reflectance, or radiance of an emissive material
    F  parameter;   // index of refraction; of an emissive material whether it shines on both sides
    I  kind;        // MATERIAL_…
    I  emitter;     // index of the emitter that light sampling chooses for this primitive, or -1
#if HAS_DISPERSION
    I  splits;      // glass that refracts each wavelength separately
#endif
#if HAS_CLOSURE
    Closure closure;
#endif
#if HAS_MEASURED || HAS_THIN_FILM || HAS_BRUSHED_SHARE || HAS_AGAIN
    Scene scene;    // whose tables are read once the direction on is known
#endif
#if HAS_MIX
    F  lobe;        // what choosing among mixed materials leaves of the random number that chooses lobes
#endif
} Vertex;

#include "material/flat_tables.h"

#if HAS_ANISOTROPY_TURN || HAS_ANISOTROPY_MAP
// The direction along which a material is brushed, u and v of the texture coordinates, turned.
static F3 brushed_direction(const __global Material *material, SurfacePoint point, F u, F v)
{
    F3 x, y;
    tangent_frame(point, &x, &y);
    F sine, cosine;
    sincos_turns((F)(material->anisotropy_turn), &sine, &cosine);
    return along(scale(x, cosine * u - sine * v), y, sine * u + cosine * v);
}
#endif

#if HAS_ANISOTROPY_MAP
// Takes direction and strength of the brushing from a picture (glTF's KHR_materials_anisotropy): red along u, green along v,
// and blue the root of how far alpha along that direction is from alpha across to 1.
static void take_brushing(Vertex *vertex, I mine, const __global Material *material, SurfacePoint point, Scene scene)
{
    F3 texel = texture_color(material->anisotropy_texture, point.u, point.v, scene);
    F u = 2.0f * texel.x - 1.0f;
    F v = 2.0f * texel.y - 1.0f;
    u = u * u + v * v > SMALLEST ? u : ONE;
    vertex->tangent = select3(mine, brushed_direction(material, point, u, v), vertex->tangent);
    F strength = texel.z * material->anisotropy_strength;
    F across = vertex->closure.alpha.y;
    F stretched = across + (1.0f - across) * strength * strength;
    vertex->closure.alpha.x = mine ? stretched : vertex->closure.alpha.x;
}
#endif

#if HAS_NORMAL_MAP || HAS_COAT_NORMAL
// The shading normal that a picture of normals in the tangent frame gives.
static F3 mapped_normal(int texture, float times, SurfacePoint point, Scene scene)
{
    F3 texel = texture_color(texture, point.u, point.v, scene);
    F strength = (F)(2.0f * times);
    F3 x, y;
    tangent_frame(point, &x, &y);
    F3 m = f3(strength * (texel.x - 0.5f), strength * (texel.y - 0.5f), MAX(2.0f * texel.z - 1.0f, (F)(1e-3f)));
    return normalized(from_frame(x, y, point.n, m));
}
#endif

#if HAS_DISPERSION
// Index of refraction, a polynomial in the inverse wavelength.
static F index_at(const __global Material *material, F inverse)
{
    inverse = MIN(MAX(inverse, (F)(material->dispersion_low)), (F)(material->dispersion_high));
    F index = (F)(material->dispersion[material->dispersion_terms - 1]);
    for (int i = material->dispersion_terms - 2; i >= 0; --i)
        index = index * inverse + material->dispersion[i];
    return index;
}
#endif

// Fills the lanes `mine`, which share a material.
static void take_material(Vertex *vertex, I mine, const __global Material *material, SurfacePoint point, Scene scene)
{
    F3 color = reflectance_at(material, point.u, point.v, scene);
#if SPECTRAL_COLOURS
    color = material->kind == MATERIAL_EMISSIVE ? light_colour(scene.spectral, color, material->color.w, scene.colours)
                                                : surface_colour(scene.spectral, color, material->color.w, scene.colours);
#endif
    vertex->color = select3(mine, color, vertex->color);
    F parameter = (F)(material->parameter);
#if HAS_DISPERSION
    if (material->dispersion_terms > 0) {
        parameter = index_at(material, scene.inverse);
        vertex->splits |= mine;
    }
#endif
    vertex->parameter = mine ? parameter : vertex->parameter;
    vertex->kind = mine ? (I)(material->kind) : vertex->kind;
#if HAS_CLOSURE
    take_closure(&vertex->closure, mine, material, point.u, point.v, scene);
#endif
#if HAS_ANISOTROPY_TURN
    if (material->anisotropy_turn != 0.0f)
        vertex->tangent = select3(mine, brushed_direction(material, point, ONE, ZERO), vertex->tangent);
#endif
#if HAS_ANISOTROPY_MAP
    if (material->anisotropy_texture >= 0)
        take_brushing(vertex, mine, material, point, scene);
#endif
#if HAS_NORMAL_MAP
    if (material->normal_texture >= 0)
        vertex->n = select3(mine, mapped_normal(material->normal_texture, material->normal_strength, point, scene), vertex->n);
#endif
#if HAS_BUMP
    if (material->bump_texture >= 0)
        vertex->n = select3(mine, bumped_normal(material, point, point.n, scene), vertex->n);
#endif
#if HAS_HAIR
    vertex->closure.across = mine ? 2.0f * point.v - 1.0f : vertex->closure.across;
#endif
#if HAS_COAT_NORMAL
    F3 coat_n = material->coat_flat ? point.n : vertex->n;
    if (material->coat_normal_texture >= 0)
        coat_n = mapped_normal(material->coat_normal_texture, material->coat_normal_strength, point, scene);
    vertex->coat_n = select3(mine, coat_n, vertex->coat_n);
#endif
}

#if HAS_MIX
// Whether lanes take the second of the two materials of a mix, by the random number in vertex->lobe.
static I second_of_mix(Vertex *vertex, I mine, const __global Material *mix, SurfacePoint point, Scene scene)
{
    F factor = (F)(mix->factor);
#if HAS_TEXTURE
    if (mix->factor_texture >= 0)
        factor = texture_scalar(mix->factor_texture, point.u, point.v, scene);
#endif
    F choice = vertex->lobe;
    I second = choice < factor;
    F rest = second ? choice / factor : (choice - factor) / (1.0f - factor);
    vertex->lobe = mine ? rest : choice;
    return second;
}
#endif

// Of a primitive that is no mesh.
static inline SurfacePoint other_point(int index, Ray ray, Hit hit, F3 p, int textured, Scene scene)
{
#if HAS_CURVE
    if (index >= scene.kind_end[KIND_CURVE - 1])
        return point_on_curve(scene.primitives + index, RAY_AT_REST(ray, index), hit.t, hit.b1);
#endif
    SurfacePoint point = surface_point(index, p, textured, scene);
#if HAS_TANGENT
    Tangents tangents = tangents_of(index, point.p, point.n, scene);
    point.tangent = tangents.along_u;
#endif
#if HAS_BITANGENT
    point.bitangent = tangents.along_v;
#endif
    return point;
}

// Of the lanes `on`. `choice` is the random number that chooses among mixed materials and lobes.
static Vertex vertex_of(Ray ray, Hit hit, I on, F choice, Scene scene)
{
    // Begin with what lanes without a hit keep.
    Vertex vertex;
    F3 p = along(ray.o, ray.d, hit.t);
    vertex.p = p;
#if HAS_MEASURED || HAS_THIN_FILM || HAS_BRUSHED_SHARE || HAS_AGAIN
    vertex.scene = scene;
#endif
    vertex.n = f3(ZERO, ZERO, ONE);
    vertex.ng = vertex.n;
#if HAS_COAT_NORMAL
    vertex.coat_n = vertex.n;
#endif
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
#if HAS_DISPERSION
    vertex.splits = FALSE;
#endif
#if HAS_CLOSURE
    vertex.closure = empty_closure();
#endif
#if HAS_MIX
    vertex.lobe = choice;
#endif
    // Take the lanes primitive by primitive.
    I rest = on;
#if FLAT_TABLES
    if (scene.flats)
        rest = rest & NOT(take_flats(&vertex, hit, on, p, scene.flats, scene));
#endif
    while (ANY(rest)) {
        int index = first_of(hit.primitive, rest);
        I mine = hit.primitive == index;
        const __global Primitive *primitive = scene.primitives + index;
        const __global Material *material = scene.materials + primitive->material;
        // Find the point on the primitive at rest, and bring it back to the world.
        F3 there = p;
#if HAS_MOTION
        Placing placing;
        if (moves(index, scene)) {
            placing = placing_of(index, ray.time, scene);
            there = point_at_rest(placing, p);
        }
#endif
#if HAS_MESH
        SurfacePoint point;
        if (index >= first_mesh)
            point = on_mesh;
        else
            point = other_point(index, ray, hit, there, material->textured, scene);
#else
        SurfacePoint point = other_point(index, ray, hit, there, material->textured, scene);
#endif
#if HAS_MOTION
        if (moves(index, scene))
            point = surface_in_world(placing, point);
#endif
#if HAS_MAPPING
        scene.place = point.p;
#endif
        // Keep position and normals.
#if HAS_MESH
        vertex.offset = mine ? point.offset : vertex.offset;
#endif
        vertex.p = select3(mine, point.p, vertex.p);
        vertex.n = select3(mine, point.n, vertex.n);
        vertex.ng = select3(mine, point.ng, vertex.ng);
#if HAS_TANGENT
        vertex.tangent = select3(mine, point.tangent, vertex.tangent);
#endif
        // Take the material, and the emitter that light sampling knows the primitive by.
#if HAS_MIX
        int is_mix = material->kind == MATERIAL_MIX;
        I second = is_mix ? second_of_mix(&vertex, mine, material, point, scene) : FALSE;
#pragma nounroll    // programs have the code of materials once
        for (int which = 0; which <= is_mix; ++which) {
            I own = mine & (which ? second : NOT(second));
            if (ANY(own))
                take_material(&vertex, own, is_mix ? scene.materials + (which ? material->second : material->first) : material,
                              point, scene);
        }
#else
        take_material(&vertex, mine, material, point, scene);
#endif
#if HAS_EMITTERS
#if EMITTER_TRIANGLES
        vertex.emitter = mine ? (index >= first_mesh ? hit.triangle - primitive->first_triangle : FALSE)
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
