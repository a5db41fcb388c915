// Flat primitives and boxes of a scene of few primitives, held in tables: what a vertex takes from its primitive and
// material is permuted into the lanes, all at once instead of primitive by primitive. The steps are those of point_on_flat,
// point_on_box and take_material, so that no bit differs. Only where registers can be permuted, and nothing varies over a
// surface.
#ifndef FLAT_TABLES_H
#define FLAT_TABLES_H
#include "geometry/surface_point.h"
#include "material/closure.h"

#if FEW_PRIMITIVES && VW == 16 && defined CLANG_AVX512 && (HAS_RECTANGLE || HAS_DISK || HAS_PLANE || HAS_BOX) \
    && !(HAS_TEXTURE || HAS_MESH || HAS_MOTION || HAS_CLOSURE || HAS_MIX || HAS_NORMAL_MAP || HAS_TANGENT \
         || HAS_DISPERSION || SPECTRAL_COLOURS)
#define FLAT_TABLES 1

// Rows of the tables, an entry per primitive. The rows of x and y are those of boxes alone.
enum {
    FLAT_UP_X, FLAT_UP_Y, FLAT_UP_Z, FLAT_UP_W, FLAT_STEP, FLAT_N_X, FLAT_N_Y, FLAT_N_Z,
    FLAT_RED, FLAT_GREEN, FLAT_BLUE, FLAT_PARAMETER, FLAT_KIND, FLAT_EMITTER,
#if HAS_BOX
    BOX_X_X, BOX_X_Y, BOX_X_Z, BOX_X_W, BOX_Y_X, BOX_Y_Y, BOX_Y_Z, BOX_Y_W, BOX_REACH_X, BOX_REACH_Y, BOX_REACH_Z,
#endif
    FLAT_ROWS
};

typedef struct FlatTables { F row[FLAT_ROWS]; } FlatTables;

static FlatTables flat_tables(Scene scene)
{
    float entries[FLAT_ROWS][16];
    for (int row = 0; row < FLAT_ROWS; ++row)
        for (int i = 0; i < 16; ++i)
            entries[row][i] = 0.0f;
    for (int i = scene.kind_end[KIND_ELLIPSOID]; i < scene.kind_end[KIND_BOX]; ++i) {
        const __global Primitive *primitive = scene.primitives + i;
        const __global Material *material = scene.materials + primitive->material;
        float4 up = primitive->row_z;
        float inverse = 1.0f / (up.x * up.x + up.y * up.y + up.z * up.z);
        float unit = sqrt(inverse);
        entries[FLAT_UP_X][i] = up.x;
        entries[FLAT_UP_Y][i] = up.y;
        entries[FLAT_UP_Z][i] = up.z;
        entries[FLAT_UP_W][i] = up.w;
        entries[FLAT_STEP][i] = -inverse;
        entries[FLAT_N_X][i] = up.x * unit;
        entries[FLAT_N_Y][i] = up.y * unit;
        entries[FLAT_N_Z][i] = up.z * unit;
        entries[FLAT_RED][i] = material->color.x;
        entries[FLAT_GREEN][i] = material->color.y;
        entries[FLAT_BLUE][i] = material->color.z;
        entries[FLAT_PARAMETER][i] = material->parameter;
        entries[FLAT_KIND][i] = as_float(material->kind);
        entries[FLAT_EMITTER][i] = as_float(primitive->emitter);
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
        tables.row[row] = vload16(0, entries[row]);
    return tables;
}

#define OF_FLAT(row_name) __builtin_ia32_permvarsf512(tables->row[row_name], index)
#define THREE_OF_FLAT(row_name) f3(OF_FLAT(row_name##_X), OF_FLAT(row_name##_Y), OF_FLAT(row_name##_Z))
#define TAKE_FLAT(member, value) member = mine ? (value) : member

// Normal and position of the lanes that hit a flat primitive or a box.
static void take_place(Vertex *vertex, I index, I flat, I box, F3 p, const FlatTables *tables)
{
    F3 up = THREE_OF_FLAT(FLAT_UP);
    F shift = OF_FLAT(FLAT_UP_W);
    F height = dot3(up, p) + shift;
    vertex->p = select3(flat, along(p, up, height * OF_FLAT(FLAT_STEP)), vertex->p);
    vertex->n = select3(flat, THREE_OF_FLAT(FLAT_N), vertex->n);
#if HAS_BOX
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

// Fills the lanes whose primitive is flat or a box, and returns them.
static I take_flats(Vertex *vertex, Hit hit, I on, F3 p, const FlatTables *tables, Scene scene)
{
    I index = hit.primitive;
    I mine = on & (index >= scene.kind_end[KIND_ELLIPSOID]) & (index < scene.kind_end[KIND_BOX]);
    I flat = mine & (index < scene.kind_end[KIND_PLANE]);
    take_place(vertex, index, flat, mine & NOT(flat), p, tables);
    vertex->color = select3(mine, f3(OF_FLAT(FLAT_RED), OF_FLAT(FLAT_GREEN), OF_FLAT(FLAT_BLUE)), vertex->color);
    TAKE_FLAT(vertex->parameter, OF_FLAT(FLAT_PARAMETER));
    TAKE_FLAT(vertex->kind, AS_I(OF_FLAT(FLAT_KIND)));
    TAKE_FLAT(vertex->emitter, AS_I(OF_FLAT(FLAT_EMITTER)));
    return mine;
}
#endif

#endif
