// Media whose density lies on a grid of numbers, trilinear between the middles of its voxels and nothing outside of its box.
// Rays are walked from block to block of DENSITY_BLOCK voxels a side, of each of which the least, the greatest and the mean density are known:
// delta tracking finds where such a medium scatters (Woodcock et al. 1965), ratio tracking what it leaves of light (Novák et
// al. 2014), above the least density of each block, which is a closed form.
// Fact: HAS_DENSITY. Functions that need random numbers for it have one argument more.
#ifndef DENSITY_H
#define DENSITY_H
#include "common/rng.h"
#include "integrator/column.h"

#if HAS_DENSITY
#define WITH_CHANCE(argument) , argument
#define DULL        0.05f   // share of light below which what is left is gambled for
#define STAKE       0.25f   // by this chance

// The part of a scene that holds grids.
typedef struct {
    const __global Medium *media;
    const __global float  *densities;
} Grids;

static inline Grids grids_of(Scene scene) { return (Grids){scene.media, scene.densities}; }

// Random numbers without end, of which each follows from the last.
typedef U4 Chance;

static inline Chance chance_of(U pixel, U sample, U dimension, uint2 seed) { return hash4(pixel, sample, dimension, seed); }

static F4 next_of(Chance *chance, I on)
{
    Chance next = hash4(chance->a, chance->b, chance->c, (uint2)(0x243f6a88u, 0x85a308d3u));
    chance->a = on ? next.a : chance->a;
    chance->b = on ? next.b : chance->b;
    chance->c = on ? next.c : chance->c;
    return unit_floats(next);
}

// The column to the next of events that come once in 1 / rate of it, by a number in [0, 1).
static inline F column_to_next(F u, F rate) { return -logarithm(MAX(1.0f - u, (F)(1e-9f))) / MAX(rate, (F)(1e-20f)); }

// A ray through the grid of a medium, in voxels from where it starts, and the block that it is in.
typedef struct {
    F3 o, d;            // per metre
    I  grid;            // number of the medium
    I  x, y, z;
    F  t, leaves;       // where it is, and where it leaves the block or the way ends [m]
    F  end;
    F  least, most, mean;   // density in the block
    I  inside;
} Walk;

#define OF_GRID(T, member) GATHER(T, grids.media, grid, .member)
#define VOXEL(i) GATHER(F, grids.densities, i, )

static inline F3 in_voxels(F3 p, I grid, Grids grids, int is_point)
{
    F3 q = f3(OF_GRID(F, row_x.x) * p.x + OF_GRID(F, row_x.y) * p.y + OF_GRID(F, row_x.z) * p.z,
              OF_GRID(F, row_y.x) * p.x + OF_GRID(F, row_y.y) * p.y + OF_GRID(F, row_y.z) * p.z,
              OF_GRID(F, row_z.x) * p.x + OF_GRID(F, row_z.y) * p.y + OF_GRID(F, row_z.z) * p.z);
    return is_point ? add(q, f3(OF_GRID(F, row_x.w), OF_GRID(F, row_y.w), OF_GRID(F, row_z.w))) : q;
}

// Density at a place, in voxels.
static F density_in(F3 q, I grid, Grids grids)
{
    I nx = OF_GRID(I, size_x), ny = OF_GRID(I, size_y), nz = OF_GRID(I, size_z);
    F3 c = f3(MIN(MAX(q.x - 0.5f, ZERO), TO_F(nx - 1)), MIN(MAX(q.y - 0.5f, ZERO), TO_F(ny - 1)),
              MIN(MAX(q.z - 0.5f, ZERO), TO_F(nz - 1)));
    I x = TO_I(c.x), y = TO_I(c.y), z = TO_I(c.z);
    F3 f = f3(c.x - TO_F(x), c.y - TO_F(y), c.z - TO_F(z));
    I right = x + 1 < nx ? (I)(1) : (I)(0);
    I up = y + 1 < ny ? nx : (I)(0);
    I back = z + 1 < nz ? nx * ny : (I)(0);
    I i = OF_GRID(I, voxels) + x + nx * (y + ny * z);
    F sides[2];
    for (int side = 0; side < 2; ++side, i += back) {
        F low = VOXEL(i) + f.x * (VOXEL(i + right) - VOXEL(i));
        F high = VOXEL(i + up) + f.x * (VOXEL(i + up + right) - VOXEL(i + up));
        sides[side] = low + f.y * (high - low);
    }
    return sides[0] + f.z * (sides[1] - sides[0]);
}

static inline F density_at_point(F3 p, I grid, Grids grids) { return density_in(in_voxels(p, grid, grids, 1), grid, grids); }

// Where a coordinate enters and leaves 0 ... size.
static inline void clip_axis(F o, F d, F size, F *enters, F *leaves)
{
    F slope = absolute(d) < 1e-20f ? with_sign((F)(1e-20f), d) : d;
    F first = -o / slope, second = (size - o) / slope;
    *enters = MAX(*enters, MIN(first, second));
    *leaves = MIN(*leaves, MAX(first, second));
}

// Moves the start of rays of a length to where they enter the box of the grid; returns how far that is, and what is left of the
// length within the box, 0 or less where they miss it.
static F enter_grid(Ray *ray, F *length, I grid, I on, Grids grids)
{
    F3 o = in_voxels(ray->o, grid, grids, 1), d = in_voxels(ray->d, grid, grids, 0);
    F enters = ZERO, leaves = *length;
    clip_axis(o.x, d.x, TO_F(OF_GRID(I, size_x)), &enters, &leaves);
    clip_axis(o.y, d.y, TO_F(OF_GRID(I, size_y)), &enters, &leaves);
    clip_axis(o.z, d.z, TO_F(OF_GRID(I, size_z)), &enters, &leaves);
    enters = (on & (leaves > enters)) ? enters : ZERO;
    *length = on ? leaves - enters : *length;
    ray->o = along(ray->o, ray->d, enters);
    return enters;
}

static inline F end_of_block(F o, F d, I block)
{
    F side = TO_F((block + (d > 0.0f ? (I)(1) : (I)(0))) * DENSITY_BLOCK);
    return absolute(d) < 1e-20f ? (F)(NEVER) : (side - o) / d;
}

// Reads what the block has that the walk is in.
static void enter_block(Walk *w, Grids grids)
{
    I grid = w->grid;
    I nx = OF_GRID(I, blocks_x), ny = OF_GRID(I, blocks_y), nz = OF_GRID(I, blocks_z);
    w->inside = w->inside & (w->x >= 0) & (w->y >= 0) & (w->z >= 0) & (w->x < nx) & (w->y < ny) & (w->z < nz);
    I block = OF_GRID(I, blocks) + (w->inside ? 3 * (w->x + nx * (w->y + ny * w->z)) : FALSE);
    w->least = VOXEL(block);
    w->most = VOXEL(block + 1);
    w->mean = VOXEL(block + 2);
    F ends = MIN(end_of_block(w->o.x, w->d.x, w->x), end_of_block(w->o.y, w->d.y, w->y));
    w->leaves = MIN(MAX(MIN(ends, end_of_block(w->o.z, w->d.z, w->z)), w->t), w->end);
}

// A walk along rays that start in the box of the grid.
static Walk start_walk(Ray ray, F length, I grid, I on, Grids grids)
{
    Walk w;
    w.grid = grid;
    w.o = in_voxels(ray.o, grid, grids, 1);
    w.d = in_voxels(ray.d, grid, grids, 0);
    F size = 1.0f / DENSITY_BLOCK;
    w.x = MIN(MAX(TO_I(w.o.x * size), FALSE), OF_GRID(I, blocks_x) - 1);
    w.y = MIN(MAX(TO_I(w.o.y * size), FALSE), OF_GRID(I, blocks_y) - 1);
    w.z = MIN(MAX(TO_I(w.o.z * size), FALSE), OF_GRID(I, blocks_z) - 1);
    w.t = ZERO;
    w.end = length;
    w.inside = on & (length > 0.0f);
    enter_block(&w, grids);
    return w;
}

// Takes the walks of the lanes `on` into the next block, or out of the box.
static void next_block(Walk *w, I on, Grids grids)
{
    F ex = end_of_block(w->o.x, w->d.x, w->x), ey = end_of_block(w->o.y, w->d.y, w->y);
    F ez = end_of_block(w->o.z, w->d.z, w->z);
    I by_x = (ex <= ey) & (ex <= ez);
    I by_y = NOT(by_x) & (ey <= ez);
    I one = (I)(1);
    w->x += (on & by_x) ? (w->d.x > 0.0f ? one : -one) : FALSE;
    w->y += (on & by_y) ? (w->d.y > 0.0f ? one : -one) : FALSE;
    w->z += (on & NOT(by_x | by_y)) ? (w->d.z > 0.0f ? one : -one) : FALSE;
    w->inside = on ? w->inside & (w->leaves < w->end) : w->inside;
    enter_block(w, grids);
}

// Where delta tracking with a rate per column ends: whether at a scattering, and what its probability follows from.
typedef struct {
    F t;                // [m]
    F bound, tries;     // column of the greatest densities, and how many events there were on it
    F guess;            // column with the mean density of each block
    I scatters;
} Collision;

static Collision collide(Ray ray, F length, I grid, F rate, Chance chance, I on, Grids grids)
{
    Walk w = start_walk(ray, length, grid, on, grids);
    Collision c;
    c.bound = c.tries = c.guess = ZERO;
    c.scatters = FALSE;
    F4 u = next_of(&chance, on);
    F rest = column_to_next(u.a, rate);
    while (ANY(w.inside)) {
        F way = w.leaves - w.t;
        I tries = w.inside & (rest < w.most * way);
        F step = w.inside ? (tries ? rest / MAX(w.most, (F)(SMALLEST)) : way) : ZERO;
        w.t += step;
        c.bound += w.most * step;
        c.guess += w.mean * step;
        rest -= w.most * step;
        if (ANY(tries)) {
            F density = density_in(along(w.o, w.d, w.t), grid, grids);
            u = next_of(&chance, tries);
            c.tries += tries ? ONE : ZERO;
            I real = tries & (u.a * w.most < density);
            c.scatters = c.scatters | real;
            w.inside = w.inside & NOT(real);
            rest = tries ? column_to_next(u.b, rate) : rest;
        }
        next_block(&w, w.inside & NOT(tries), grids);
    }
    c.t = w.t;
    return c;
}

// What a medium leaves of light along a way, in the mean: ratio tracking with a rate per column above the least density of each
// block; of all density where `glow` is wanted, the mean of density times what is left, added up. Adds to *guess as above.
static F3 track_ratio(Ray ray, F length, I grid, F3 extinction, F rate, Chance *chance, I on, F *guess, F3 *glow, Grids grids)
{
    Walk w = start_walk(ray, length, grid, on, grids);
    F3 left = f3(ONE, ONE, ONE);
    F3 share = scale(extinction, ONE / MAX(rate, (F)(SMALLEST)));
    F certain = ZERO;
    F4 u = next_of(chance, on);
    F rest = column_to_next(u.a, rate);
    while (ANY(w.inside)) {
        F way = w.leaves - w.t;
        F least = glow ? ZERO : w.least;
        F span = w.most - least;
        I tries = w.inside & (rest < span * way);
        F step = w.inside ? (tries ? rest / MAX(span, (F)(SMALLEST)) : way) : ZERO;
        w.t += step;
        certain += least * step;
        *guess += w.mean * step;
        rest -= span * step;
        if (ANY(tries)) {
            F density = density_in(along(w.o, w.d, w.t), grid, grids);
            F met = tries ? MIN(MAX((density - least) / MAX(span, (F)(SMALLEST)), ZERO), ONE) : ZERO;
            if (glow)
                *glow = add(*glow, scale(left, met));
            left = sub(left, scale(mul(left, share), met));
            u = next_of(chance, tries);
            rest = tries ? column_to_next(u.b, rate) : rest;
            I dull = tries & (max3(left) < DULL);
            F stake = u.c < STAKE ? (F)(1.0f / STAKE) : ZERO;
            left = scale(left, dull ? stake : ONE);
            w.inside = w.inside & (max3(left) > 0.0f);
        }
        next_block(&w, w.inside & NOT(tries), grids);
    }
    return mul(left, transmittance_of(extinction, certain));
}

#else
#define WITH_CHANCE(argument)
#endif

#endif
