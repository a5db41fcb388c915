// Radiance that arrives from infinity along -d: constant, linear in the sine of the elevation, or from a picture of the
// whole sphere in longitude and latitude. The picture's middle column looks forward, its top row up.
#ifndef ENVIRONMENT_H
#define ENVIRONMENT_H
#include "common/scene.h"
#include "common/angles.h"
#include "material/image.h"

#if ENVIRONMENT == ENVIRONMENT_GRADIENT
static F3 environment_radiance(F3 d, Scene scene)
{
    const __global Environment *e = scene.environment;
    F k = 0.5f + 0.5f * (d.x * e->up.x + d.y * e->up.y + d.z * e->up.z);
    return f3(e->bottom.x + k * (e->top.x - e->bottom.x), e->bottom.y + k * (e->top.y - e->bottom.y),
              e->bottom.z + k * (e->top.z - e->bottom.z));
}
#elif ENVIRONMENT == ENVIRONMENT_CONSTANT
static F3 environment_radiance(F3 d, Scene scene) { return f3_of(scene.environment->bottom); }
#elif ENVIRONMENT == ENVIRONMENT_IMAGE
// Where on the picture a direction lies, 0 to 1 from the left and from the bottom; `aside` is the sine of its angle from the
// poles.
static void environment_place(F3 d, const __global Environment *e, F *u, F *v, F *aside)
{
    F right = dot3(d, f3_of(e->right));
    F forward = dot3(d, f3_of(e->forward));
    *aside = sqrt(right * right + forward * forward);
    *u = 0.5f + turns_of(forward, right);
    *v = share_upwards(dot3(d, f3_of(e->up)), *aside);
}

static F3 environment_texel(F u, F v, Scene scene)
{
    const __global Texture *t = scene.textures + scene.environment->texture;
    return mul(image_at(t, scene.texels, u, v), f3_of(t->a));
}

static F3 environment_radiance(F3 d, Scene scene)
{
    F u, v, aside;
    environment_place(d, scene.environment, &u, &v, &aside);
    return environment_texel(u, v, scene);
}

#define CELL_PROBABILITY(e) (2 * (e)->rows + 2 * (e)->rows * (e)->columns)     // where in the table

// Solid-angle density with which environment_sample chooses a direction. The table holds, for rows of cells from the
// bottom, the alias table of the rows, those of the cells of each row, and the density of each cell.
static F environment_density(I row, I column, F aside, Scene scene)
{
    const __global Environment *e = scene.environment;
    const __global float *densities = scene.distribution + CELL_PROBABILITY(e);
    return GATHER(F, densities, row * e->columns + column, ) / MAX(aside, (F)(1e-20f));
}

static F environment_pdf(F3 d, Scene scene)
{
    const __global Environment *e = scene.environment;
    F u, v, aside;
    environment_place(d, e, &u, &v, &aside);
    return environment_density(within(TO_I(v * (float)e->rows), e->rows), within(TO_I(u * (float)e->columns), e->columns),
                               aside, scene);
}

// Picks one of `count` cells by the alias table that starts at `table`; *place is where in 0 … 1 of all cells.
static I alias_pick(const __global float *distribution, I table, int count, F u, F *place)
{
    F scaled = u * (float)count;
    I cell = within(TO_I(scaled), count);
    F rest = scaled - TO_F(cell);
    F keep = GATHER(F, distribution, table + 2 * cell, );
    I other = TO_I(GATHER(F, distribution, table + 2 * cell + 1, ));
    I kept = rest < keep;
    F inside = kept ? rest / keep : (rest - keep) / (1.0f - keep);
    cell = kept ? cell : within(other, count);
    *place = (TO_F(cell) + inside) * (1.0f / (float)count);
    return cell;
}

// A direction, with density in proportion to the brightness of the picture, and the radiance from there.
static F3 environment_sample(F u, F v, Scene scene, F3 *radiance, F *pdf)
{
    const __global Environment *e = scene.environment;
    F x, y, sine, cosine, aside, depth;
    I row = alias_pick(scene.distribution, FALSE, e->rows, u, &y);
    I column = alias_pick(scene.distribution, 2 * e->rows + 2 * row * e->columns, e->columns, v, &x);
    sincos_turns(0.5f * y, &aside, &depth);                 // from straight down
    sincos_turns(x, &sine, &cosine);                        // from backward, over the left
    *radiance = environment_texel(x, y, scene);
    *pdf = environment_density(row, column, aside, scene);
    F3 d = scale(f3_of(e->right), -aside * sine);
    d = add(d, scale(f3_of(e->forward), -aside * cosine));
    return add(d, scale(f3_of(e->up), -depth));
}
#endif

#endif
