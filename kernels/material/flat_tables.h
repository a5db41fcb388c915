// The primitives of a scene of few, held in tables: what a vertex takes from its primitive and material is permuted into the
// lanes, all at once instead of primitive by primitive. The steps are those of point_on_sphere, point_on_flat, point_on_box
// and take_material, so that no bit differs. Only where registers can be permuted; a texture is looked up for the lanes of
// one flat primitive after the other, and what else is textured stays out of the tables.
#ifndef FLAT_TABLES_H
#define FLAT_TABLES_H
#include "geometry/surface_point.h"
#include "material/closure.h"

#define HAS_FLAT (HAS_RECTANGLE || HAS_DISK || HAS_PLANE)
#if VW == 16 && defined(CLANG_AVX512)
#define PERMUTED (HAS_SPHERE || HAS_FLAT || HAS_BOX)
#elif VW == 8 && defined(CLANG_AVX2)
#define PERMUTED HAS_BOX    // two registers a row: without boxes that gains nothing
#else
#define PERMUTED 0
#endif
#if FEW_PRIMITIVES && PERMUTED \
    && !(HAS_MESH || HAS_MOTION || HAS_CLOSURE || HAS_MIX || HAS_NORMAL_MAP || HAS_TANGENT || HAS_MAPPING || HAS_DISPERSION \
         || SPECTRAL_COLOURS || HUGE_SPHERES)
#define FLAT_TABLES 1

// How a vertex takes its place, by primitive: not by the tables, or as what these say.
enum { BY_ITSELF, ON_FLAT, ON_SPHERE, ON_BOX };

// Rows of the tables, an entry per primitive. Of a sphere `up` is centre and radius. The rows of x and y are those of boxes.
enum {
    FLAT_WAY, FLAT_UP_X, FLAT_UP_Y, FLAT_UP_Z, FLAT_UP_W,
    FLAT_RED, FLAT_GREEN, FLAT_BLUE, FLAT_PARAMETER, FLAT_KIND, FLAT_EMITTER,
#if HAS_TEXTURE
    FLAT_TEXTURE,
#endif
#if HAS_BOX
    BOX_X_X, BOX_X_Y, BOX_X_Z, BOX_X_W, BOX_Y_X, BOX_Y_Y, BOX_Y_Z, BOX_Y_W, BOX_REACH_X, BOX_REACH_Y, BOX_REACH_Z,
#endif
    FLAT_ROWS
};

#define ENTRIES     16              // of a row, the primitives of a scene of few
#define REGISTERS   (ENTRIES / VW)  // that hold it
#if VW == 16
#define LOAD_ENTRIES(k, from)   vload16(k, from)
#else
#define LOAD_ENTRIES(k, from)   vload8(k, from)
#endif

typedef struct FlatTables { F row[FLAT_ROWS][REGISTERS]; } FlatTables;

// The entries of a row that the primitives `index` have.
static inline F of_row(const F *row, I index)
{
#if VW == 16
    return __builtin_ia32_permvarsf512(row[0], index);
#else
    return index >= VW ? __builtin_ia32_permvarsf256(row[1], index) : __builtin_ia32_permvarsf256(row[0], index);
#endif
}

static inline int way_of(int i, int texture, const __global int *kind_end)
{
    if (i >= kind_end[KIND_ELLIPSOID] && i < kind_end[KIND_PLANE])
        return ON_FLAT;
    if (texture >= 0)
        return BY_ITSELF;
    if (i < kind_end[KIND_SPHERE])
        return ON_SPHERE;
    return i >= kind_end[KIND_PLANE] && i < kind_end[KIND_BOX] ? ON_BOX : BY_ITSELF;
}

static FlatTables flat_tables(Scene scene)
{
    float entries[FLAT_ROWS][ENTRIES];
    for (int row = 0; row < FLAT_ROWS; ++row)
        for (int i = 0; i < ENTRIES; ++i)
            entries[row][i] = 0.0f;
    for (int i = 0; i < scene.kind_end[KIND_BOX]; ++i) {
        const __global Primitive *primitive = scene.primitives + i;
        const __global Material *material = scene.materials + primitive->material;
        int way = way_of(i, material->texture, scene.kind_end);
        float4 up = way == ON_SPHERE ? primitive->row_x : primitive->row_z;
        entries[FLAT_WAY][i] = as_float(way);
        entries[FLAT_UP_X][i] = up.x;
        entries[FLAT_UP_Y][i] = up.y;
        entries[FLAT_UP_Z][i] = up.z;
        entries[FLAT_UP_W][i] = up.w;
        entries[FLAT_RED][i] = material->color.x;
        entries[FLAT_GREEN][i] = material->color.y;
        entries[FLAT_BLUE][i] = material->color.z;
        entries[FLAT_PARAMETER][i] = material->parameter;
        entries[FLAT_KIND][i] = as_float(material->kind);
        entries[FLAT_EMITTER][i] = as_float(primitive->emitter);
#if HAS_TEXTURE
        entries[FLAT_TEXTURE][i] = as_float(material->texture);
#endif
#if HAS_BOX
        float4 x = primitive->row_x, y = primitive->row_y;
        entries[BOX_X_X][i] = x.x; entries[BOX_X_Y][i] = x.y; entries[BOX_X_Z][i] = x.z; entries[BOX_X_W][i] = x.w;
        entries[BOX_Y_X][i] = y.x; entries[BOX_Y_Y][i] = y.y; entries[BOX_Y_Z][i] = y.z; entries[BOX_Y_W][i] = y.w;
        entries[BOX_REACH_X][i] = reach_of(x);
        entries[BOX_REACH_Y][i] = reach_of(y);
        entries[BOX_REACH_Z][i] = reach_of(up);
#endif
    }
    FlatTables tables;
    for (int row = 0; row < FLAT_ROWS; ++row)
        for (int k = 0; k < REGISTERS; ++k)
            tables.row[row][k] = LOAD_ENTRIES(k, entries[row]);
    return tables;
}

#define OF_FLAT(row_name) of_row(tables->row[row_name], index)
#define THREE_OF_FLAT(row_name) f3(OF_FLAT(row_name##_X), OF_FLAT(row_name##_Y), OF_FLAT(row_name##_Z))
#define TAKE_FLAT(member, value) member = mine ? (value) : member

// Normal and position of the lanes that the tables know.
static void take_place(Vertex *vertex, I index, I way, F3 p, const FlatTables *tables)
{
    F3 up = THREE_OF_FLAT(FLAT_UP);
    F shift = OF_FLAT(FLAT_UP_W);
#if HAS_FLAT
    I flat = way == ON_FLAT;
    F height = dot3(up, p) + shift;
    vertex->p = select3(flat, along(p, up, -height), vertex->p);
    vertex->n = select3(flat, up, vertex->n);
#endif
#if HAS_SPHERE
    I sphere = way == ON_SPHERE;
    if (ANY(sphere)) {
        F3 n = normalized(sub(p, up));
        vertex->p = select3(sphere, along(up, n, shift), vertex->p);
        vertex->n = select3(sphere, n, vertex->n);
    }
#endif
#if HAS_BOX
    I box = way == ON_BOX;
    if (ANY(box)) {
        BoxRows rows;
        rows.x = THREE_OF_FLAT(BOX_X);
        rows.y = THREE_OF_FLAT(BOX_Y);
        rows.z = up;
        rows.w = f3(OF_FLAT(BOX_X_W), OF_FLAT(BOX_Y_W), shift);
        rows.reach = THREE_OF_FLAT(BOX_REACH);
        vertex->n = select3(box, normal_of_face(rows, face_of(rows, p)), vertex->n);
    }
#endif
    vertex->ng = vertex->n;
}

#if HAS_TEXTURE
// Colours of the lanes `textured`, on flat primitives.
static void take_textures(Vertex *vertex, I index, I textured, F3 p, Scene scene)
{
    while (ANY(textured)) {
        int i = first_of(index, textured);
        I mine = textured & (index == i);
        const __global Primitive *primitive = scene.primitives + i;
        F u = row_point(primitive->row_x, p);
        F v = row_point(primitive->row_y, p);
        F3 color = reflectance_at(scene.materials + primitive->material, u, v, scene);
        vertex->color = select3(mine, color, vertex->color);
        textured = textured & NOT(mine);
    }
}
#endif

// Fills the lanes whose primitive the tables know, and returns them.
static I take_flats(Vertex *vertex, Hit hit, I on, F3 p, const FlatTables *tables, Scene scene)
{
    I index = hit.primitive;
    I way = on ? AS_I(OF_FLAT(FLAT_WAY)) : (I)(BY_ITSELF);
    I mine = way != BY_ITSELF;
    take_place(vertex, index, way, p, tables);
    vertex->color = select3(mine, f3(OF_FLAT(FLAT_RED), OF_FLAT(FLAT_GREEN), OF_FLAT(FLAT_BLUE)), vertex->color);
    TAKE_FLAT(vertex->parameter, OF_FLAT(FLAT_PARAMETER));
    TAKE_FLAT(vertex->kind, AS_I(OF_FLAT(FLAT_KIND)));
    TAKE_FLAT(vertex->emitter, AS_I(OF_FLAT(FLAT_EMITTER)));
#if HAS_TEXTURE
    take_textures(vertex, index, mine & (AS_I(OF_FLAT(FLAT_TEXTURE)) >= 0), p, scene);
#endif
    return mine;
}
#endif

#endif
