// Sends light of sources through one way of a lens, whose surfaces stand in the order in which it meets them, and adds it
// to the film. Every work item traces VW rays of one source; a ray is a point of a lattice over that source's box on the
// plane of the first vertex, and its neighbours are traced beside it. Light is added as whole numbers of 64 bits, in two words with a
// carry: such sums do not depend on their order. With GHOST_SCOUT nothing is added, and each ray's place on the film and
// the share of its light that gets there are stored. With GHOST_GRATING the film is one of the surfaces, a grating.
#undef LENS_FRESNEL
#undef LENS_POLARISED
#define LENS_FRESNEL   1        // surfaces that reflect nothing make no ghosts
#define LENS_POLARISED 1
#include "lens/trace.h"
#include "common/rng.h"

#define GOLDEN      2654435769u         // 2^32 over the golden ratio
#define PLASTIC_1   3242174889u         // 2^32 over the plastic number, and over its square (Roberts 2018)
#define PLASTIC_2   2447445414u
#define JITTER      0.25f               // random part of a place on a patch: without it the lattice shows as fringes
#define ONE_LIGHT   68719476736.0f      // 2^36 units

typedef struct {
    F x, y, share;      // on the film [mm]; 0 of what does not arrive
} Landed;

#if GHOST_GRATING
// One of the orders of a grating [(order, share of it and of those before)], for random numbers.
static F order_of(const __global float4 *orders, int count, F random)
{
    F order = orders[0].x;
    for (int k = 1; k < count; ++k)
        order = random >= orders[k - 1].y ? (F)(orders[k].x) : order;
    return order;
}

// A ray that the film reflects in orders: sines along it change by wavelength over pitch (Born and Wolf, section 8.6).
static void leave_grating(LensPath *path, F x, F y, float4 grating)
{
    F3 d = path->d;
    d.x += x;
    d.y += y;
    F cosine2 = 1.0f - d.x * d.x - d.y * d.y;
    I within = (fabs(path->p.x) <= grating.z) & (fabs(path->p.y) <= grating.w) & (cosine2 > 0.0f);
    path->passed &= KEPT(within);
    d.z = root(cosine2);
    F3 across = along(path->light.across, d, -dot3(path->light.across, d));
    path->light.across = scale(across, ONE / sqrt(dot3(across, across)));
    path->d = d;
}
#endif

static Landed through_lens(F3 p, F3 d, const __global Surface *surfaces, int count, const __global real *stop,
#if GHOST_GRATING
                           const __global float4 *orders, int order_count, float4 grating, int film_at, U4 h,
#endif
                           float film_distance)
{
    LensPath path = enter_lens(p, d, ONE);
    for (int k = 0; k < count && ANY(MASK_OF(path.passed)); ++k) {
        cross_surface(&path, surfaces + k, stop);
#if GHOST_GRATING
        if (k == film_at) {
            F step = grating.x + grating.y * unit_float(h.c);
            leave_grating(&path, step * order_of(orders, order_count, unit_float(h.a)),
                          step * order_of(orders, order_count, unit_float(h.b)), grating);
        }
#endif
    }
    F t = (film_distance - path.p.z) / path.d.z;
    Landed landed;
    landed.x = path.p.x + t * path.d.x;
    landed.y = path.p.y + t * path.d.y;
    I arrives = MASK_OF(path.passed) & (path.d.z > 0.0f);
    F share = power_of(&path.light);
#if LENS_ABSORPTION
    share *= exponential(-path.depth);
#endif
    landed.share = arrives ? share : ZERO;
    return landed;
}

// A source is x, y, z towards it or where it is [mm], w: 1 for a place; then its box: corner and sides; then its weights; then
// where its lattice begins; then its first work item, its rays, and the step between neighbours of the lattice. With GHOST_PATCHES a patch of an emitter stands around that point, and rays come from all over
// it: base and map, two edges or radii with the bulge of a sun, a cell of the unit square, and the normal of a flat lamp over
// the cosine that the weights have. With GHOST_PENCILS w may be 2, of light whose direction is that of x, y, z at the first
// vertex; how it changes along x and y stands last.
#if GHOST_PATCHES
#define PATCH_ROWS 5
#else
#define PATCH_ROWS 0
#endif
#if GHOST_PENCILS
#define SOURCE_ROWS (7 + PATCH_ROWS)
#else
#define SOURCE_ROWS (5 + PATCH_ROWS)
#endif

static inline F step_of(U n, uint step, float first)
{
    return TO_F(AS_I((n * step + (uint)(first * 16777216.0f) * 256u) >> 8)) * 5.9604645e-8f;
}

#if GHOST_PATCHES
// A point of the patch of a source, one for each ray.
static F3 point_of_patch(const __global float4 *patch, F s, F t)
{
    float4 base = patch[0], first = patch[1], second = patch[2], cell = patch[3];
    F x = cell.x + s * cell.z, y = cell.y + t * cell.w, height = ONE;
    if (base.w == (float)PATCH_DISK) {
        F sine, cosine, radius = sqrt(x);
        sincos_turns(y, &sine, &cosine);
        height = sqrt(1.0f - x * first.w);
        x = radius * cosine;
        y = radius * sine;
    } else if (base.w == (float)PATCH_TRIANGLE) {
        I over = x + y > 1.0f;
        x = over ? 1.0f - x : x;
        y = over ? 1.0f - y : y;
    }
    return add(scale(f3_of(base), height), add(scale(f3_of(first), x), scale(f3_of(second), y)));
}
#endif

static void enter_front(const __global float4 *source, uint item, F3 *p, F3 *d, F *weight, U *ray)
{
    float4 at = source[0], box = source[1];
    uint rays = as_uint(source[4].y), stride = as_uint(source[4].z);
    uint number = (item - as_uint(source[4].x)) * VW;
    U n = AS_U((I)((int)(number * stride)) + LANES * (int)stride) & (rays - 1u);      // rays are a power of two
    *ray = n;
    float4 first = source[3];
    F u = (TO_F(AS_I(n)) + first.x) / (float)rays;
    F v = step_of(n, GOLDEN, first.y);
    *p = f3(box.x + u * box.z, box.y + v * box.w, ZERO);
    F3 from = f3_of(at);
#if GHOST_PATCHES
    const __global float4 *patch = source + 5;
    U4 h = hash4(n, (U)(0u), (U)(0u), (uint2)(as_uint(first.z), as_uint(first.w)));
    F s = step_of(n, PLASTIC_1, first.z) + JITTER * unit_float(h.a);
    F t = step_of(n, PLASTIC_2, first.w) + JITTER * unit_float(h.b);
    from = point_of_patch(patch, s - floor(s), t - floor(t));
#endif
    F3 away = at.w > 0.0f ? sub(*p, from) : from;
    F length2 = dot3(away, away);
    *d = scale(away, ONE / sqrt(length2));
    float vertex2 = at.x * at.x + at.y * at.y + at.z * at.z;
    *weight = at.w > 0.0f ? d->z * vertex2 / length2 : d->z;            // a lamp's light over that at the first vertex
#if GHOST_PATCHES
    if (patch[4].w > 0.0f)
        *weight *= MAX(dot3(f3_of(patch[4]), away), ZERO) / sqrt(length2);
#endif
#if GHOST_PENCILS
    if (at.w > 1.0f) {
        float4 by_x = source[5 + PATCH_ROWS], by_y = source[6 + PATCH_ROWS];
        away = f3(at.x + by_x.x * p->x + by_y.x * p->y, at.y + by_x.y * p->x + by_y.y * p->y,
                  at.z + by_x.z * p->x + by_y.z * p->y);
        length2 = dot3(away, away);
        *d = scale(away, ONE / sqrt(length2));
        *weight = d->z / length2;
    }
#endif
}

static inline void add_light(__global uint *sum, float light)
{
    ulong units = (ulong)(long)(light * ONE_LIGHT);          // below 0 as two's complement, whose carry is the same
    uint low = (uint)units, high = (uint)(units >> 32);
    uint before = atomic_add((volatile __global uint *)sum, low);
    high += before + low < before ? 1u : 0u;
    if (high != 0u)
        atomic_add((volatile __global uint *)sum + 1, high);
}

__kernel void ghosts(const __global Surface *surfaces,       // in order of travel
                     int                     count,          // surfaces
                     const __global real    *stop,           // shape of the stop
                     const __global float4  *sources,        // [sources][SOURCE_ROWS]
                     uint                    source_count,
                     uint                    items,          // of all of them
                     float                   film_distance,  // behind the last vertex [mm]
                     float4                  pixels,         // column = x + y * film x, row = z + w * film y
                     uint2                   size,           // columns and rows of the film
#if GHOST_GRATING
                     const __global float4  *orders,         // of the film's grating: order, and share up to it
                     int                     order_count,
                     float4                  grating,        // sine of the first order at the shortest wavelength, what it
                                                             // gains to the longest; half the film's width and height [mm]
                     int                     film_at,        // which surface is the film
#endif
                     __global uint          *film)           // [rows][columns][3] low and high words; or with GHOST_SCOUT
                                                             // float [3][items * VW]: x, y, share
{
    uint item = get_global_id(0);
    if (item >= items)
        return;
    uint source = 0, beyond = source_count;
    while (beyond - source > 1) {
        uint middle = (source + beyond) / 2;
        if (as_uint(sources[SOURCE_ROWS * middle + 4].x) <= item)
            source = middle;
        else
            beyond = middle;
    }
    const __global float4 *lamp = sources + SOURCE_ROWS * source;
    F3 p, d;
    F weight;
    U ray;
    enter_front(lamp, item, &p, &d, &weight, &ray);
#if GHOST_GRATING
    U4 h = hash4(ray, (U)(1u), (U)(0u), (uint2)(as_uint(lamp[3].z), as_uint(lamp[3].w)));
    Landed landed = through_lens(p, d, surfaces, count, stop, orders, order_count, grating, film_at, h, film_distance);
#else
    Landed landed = through_lens(p, d, surfaces, count, stop, film_distance);
#endif
#if GHOST_SCOUT
    uint all = items * VW, first = item * VW;
    __global float *out = (__global float *)film;
    STORE_F(out, first, landed.x);
    STORE_F(out + all, first, landed.y);
    STORE_F(out + 2 * all, first, landed.share * weight);
#else
    F column = pixels.x + pixels.y * landed.x, row = pixels.z + pixels.w * landed.y;
    I inside = (landed.share > 0.0f) & (column >= 0.0f) & (row >= 0.0f) & (column < (float)size.x) & (row < (float)size.y);
    if (!ANY(inside))
        return;
    F light = inside ? landed.share * weight : ZERO;
    I place = inside ? TO_I(row) * (int)size.x + TO_I(column) : FALSE;
    float4 colour = lamp[2];
    for (int k = 0; k < VW; ++k) {
        float one = ((const float *)&light)[k];
        if (one > 0.0f) {
            __global uint *pixel = film + 6u * (uint)((const int *)&place)[k];
            add_light(pixel, one * colour.x);
            add_light(pixel + 2, one * colour.y);
            add_light(pixel + 4, one * colour.z);
        }
    }
#endif
}
