// Auxiliary layers: what the camera rays meet first, per pixel. Means are Kahan sums of ray weight times value over the rays
// that hit something, beside the sums of the weights; what cannot be averaged is taken from the pixel's first ray that
// passes the camera. Planes of the buffer, `pixels` long each: the sums, their compensations, the firsts.
// Facts: LAYER_<name>, the place of a layer among the sums or the firsts, or -1; LAYER_SUMS, how many sums there are;
// OWNER_SLOTS, how many objects or materials a pixel keeps apart.
#ifndef LAYERS_H
#define LAYERS_H
#include "camera/film_point.h"
#include "material/fresnel.h"
#include "material/vertex.h"

#define SUM_OF_PASSED 0      // weights of the rays that pass the camera
#define SUM_OF_HITS   1      // weights of those that hit something
#define NOT_A_NUMBER  0x7fc00000
#define SMALLEST_DISTANCE 1e-12f   // [m]; nearer points blur alike

// What a surface reflects of light; a metal, what it reflects head-on.
static inline F3 base_color(Vertex vertex)
{
    F3 color = keep3(vertex.kind != MATERIAL_EMISSIVE, vertex.color);
#if HAS_METAL
    F3 n = vertex.closure.n;
    F3 k = vertex.closure.k;
    F3 f = f3(metal_fresnel(ONE, n.x, k.x), metal_fresnel(ONE, n.y, k.y), metal_fresnel(ONE, n.z, k.z));
    color = select3(vertex.kind == MATERIAL_METAL, mul(color, f), color);
#endif
    return color;
}

typedef struct { F sum[LAYER_SUMS], rest[LAYER_SUMS]; } LayerSums;

static LayerSums read_sums(__global const float *planes, uint pixel, uint pixels)
{
    LayerSums s;
    for (int k = 0; k < LAYER_SUMS; ++k) {
        s.sum[k] = LOAD_F(planes + (size_t)k * pixels, pixel);
        s.rest[k] = LOAD_F(planes + (size_t)(LAYER_SUMS + k) * pixels, pixel);
    }
    return s;
}

static void write_sums(__global float *planes, uint pixel, uint pixels, LayerSums s)
{
    for (int k = 0; k < LAYER_SUMS; ++k) {
        STORE_F(planes + (size_t)k * pixels, pixel, s.sum[k]);
        STORE_F(planes + (size_t)(LAYER_SUMS + k) * pixels, pixel, s.rest[k]);
    }
}

static inline void add_weighted(LayerSums *s, int k, F weight, F value)
{
    F y = weight * value - s->rest[k];
    F t = s->sum[k] + y;
    s->rest[k] = (t - s->sum[k]) - y;
    s->sum[k] = t;
}

static inline void add_weighted3(LayerSums *s, int k, F weight, F3 value)
{
    add_weighted(s, k, weight, value.x);
    add_weighted(s, k + 1, weight, value.y);
    add_weighted(s, k + 2, weight, value.z);
}

static inline void write_first(__global float *planes, int k, uint pixel, uint pixels, I fresh, F value)
{
    __global float *plane = planes + (size_t)(2 * LAYER_SUMS + k) * pixels;
    STORE_F(plane, pixel, fresh ? value : LOAD_F(plane, pixel));
}

#if LAYER_OBJECT_ID >= 0 || LAYER_MATERIAL_ID >= 0 || LAYER_CRYPTO_OBJECT >= 0 || LAYER_CRYPTO_MATERIAL >= 0
// Object (which = 0) or material (which = 1) of what was hit; -1 for nothing.
static inline F owner_of(Hit hit, I on, const __global int *owners, int which)
{
    I index = on ? hit.primitive * 2 + which : FALSE;
    return AS_F(on ? GATHER(I, owners, index, ) : (I)(-1));
}
#endif

#if LAYER_CRYPTO_OBJECT >= 0 || LAYER_CRYPTO_MATERIAL >= 0
// Adds weights to those of their owners: each of a pixel's owners has a slot of three planes, for its identifier, its weight
// and that sum's compensation; a slot without weight is free, and what finds none is left out.
static void add_to_owner(__global float *planes, int k, uint pixel, uint pixels, F weight, F owner)
{
    I waiting = weight > 0.0f;
    for (int slot = 0; slot < OWNER_SLOTS && ANY(waiting); ++slot) {
        __global float *names = planes + (size_t)(2 * LAYER_SUMS + k + 3 * slot) * pixels;
        __global float *sums = names + pixels, *rests = sums + pixels;
        F name = LOAD_F(names, pixel);
        F sum = LOAD_F(sums, pixel);
        F rest = LOAD_F(rests, pixel);
        I mine = waiting & ((sum == 0.0f) | (AS_I(name) == AS_I(owner)));
        F y = weight - rest;
        F t = sum + y;
        STORE_F(names, pixel, mine ? owner : name);
        STORE_F(sums, pixel, mine ? t : sum);
        STORE_F(rests, pixel, mine ? (t - sum) - y : rest);
        waiting = waiting & NOT(mine);
    }
}
#endif

#if LAYER_UV >= 0
typedef struct { F u, v; } Uv;

// Texture coordinates of what the lanes `on` hit, whether it has a texture or not.
static Uv texture_coordinates(Ray ray, Hit hit, I on, F3 p, Scene scene)
{
    Uv uv;
    uv.u = ZERO;
    uv.v = ZERO;
#if HAS_MESH
    I meshes = on & (hit.primitive >= scene.kind_end[KIND_MESH - 1]);
    if (ANY(meshes)) {
        SurfacePoint point = point_on_mesh(hit, meshes, scene);
        uv.u = meshes ? point.u : uv.u;
        uv.v = meshes ? point.v : uv.v;
        on = on & NOT(meshes);
    }
#endif
    while (ANY(on)) {
        int index = first_of(hit.primitive, on);
        I mine = on & (hit.primitive == index);
        F3 there = p;
#if HAS_MOTION
        if (moves(index, scene))
            there = point_at_rest(placing_of(index, ray.time, scene), p);
#endif
#if HAS_CURVE
        SurfacePoint point = index >= scene.kind_end[KIND_CURVE - 1]
            ? point_on_curve(scene.primitives + index, RAY_AT_REST(ray, index), hit.t, hit.b1) : surface_point(index, there, 1, scene);
#else
        SurfacePoint point = surface_point(index, there, 1, scene);
#endif
        uv.u = mine ? point.u : uv.u;
        uv.v = mine ? point.v : uv.v;
        on = on & NOT(mine);
    }
    return uv;
}
#endif

#if LAYER_COC >= 0
typedef struct { F a, b, c; } BlurHere;

// The blur as seen from the middle of a pixel, between four nodes of the film.
static BlurHere blur_here(Lane lane, const __global Camera *camera, const __global float4 *blur, const __global View *view)
{
    F x = (0.5f - 0.5f * film_x(lane, (F)(0.5f), camera)) * (float)(view->columns - 1);  // a lens inverts
    F y = (0.5f - 0.5f * film_y(lane, (F)(0.5f), camera)) * (float)(view->rows - 1);
    I column = TO_I(MAX(MIN(x, (F)((float)(view->columns - 2))), ZERO));
    I row = TO_I(MAX(MIN(y, (F)((float)(view->rows - 2))), ZERO));
    I n = row * view->columns + column;
    I e = n + (view->columns > 1 ? 1 : 0);
    int below = view->rows > 1 ? view->columns : 0;
    F right = x - TO_F(column);
    F down = y - TO_F(row);
    F wn = (1.0f - down) * (1.0f - right);
    F we = (1.0f - down) * right;
    F wsn = down * (1.0f - right);
    F wse = down * right;
    BlurHere here;
    here.a = wn * GATHER(F, blur, n, .x) + we * GATHER(F, blur, e, .x)
           + wsn * GATHER(F, blur, n + below, .x) + wse * GATHER(F, blur, e + below, .x);
    here.b = wn * GATHER(F, blur, n, .y) + we * GATHER(F, blur, e, .y)
           + wsn * GATHER(F, blur, n + below, .y) + wse * GATHER(F, blur, e + below, .y);
    here.c = wn * GATHER(F, blur, n, .z) + we * GATHER(F, blur, e, .z)
           + wsn * GATHER(F, blur, n + below, .z) + wse * GATHER(F, blur, e + below, .z);
    return here;
}

// Diameter of the circle of confusion [pixels] of a point with a vergence [1/m]; rptcam_cl/rendering/cameras/model.py has the formula.
static inline F circle_of_confusion(BlurHere here, F vergence, const __global View *view)
{
    F away = vergence - view->blur_focus;
    return root(here.a + away * (here.b + away * here.c)) / absolute(view->blur_scale + view->blur_shift * vergence);
}
#endif

#endif
