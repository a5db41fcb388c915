// Radiance that arrives from infinity along -d: constant, linear in the sine of the elevation, or from a picture of the
// whole sphere in longitude and latitude. The picture's middle column looks forward, its top row up.
#ifndef ENVIRONMENT_H
#define ENVIRONMENT_H
#include "common/scene.h"
#include "common/angles.h"
#include "common/curve.h"
#include "material/image.h"

// Light of the environment at the wavelengths of the path, where it has them; `number` is that of its spectrum.
static inline F3 environment_colour(F3 rgb, float number, Scene scene)
{
#if SPECTRAL_COLOURS
    return light_colour(scene.spectral, rgb, number, scene.colours);
#else
    return rgb;
#endif
}

#if ENVIRONMENT == ENVIRONMENT_GRADIENT
static inline F3 environment_radiance(F3 d, Scene scene)
{
    const __global Environment *e = scene.environment;
    F k = 0.5f + 0.5f * (d.x * e->up.x + d.y * e->up.y + d.z * e->up.z);
    F3 bottom = environment_colour(f3_of(e->bottom), e->bottom.w, scene);
    F3 top = environment_colour(f3_of(e->top), e->top.w, scene);
    return add(bottom, scale(sub(top, bottom), k));
}
#elif ENVIRONMENT == ENVIRONMENT_CONSTANT
static inline F3 environment_radiance(F3 d, Scene scene)
{
    return environment_colour(f3_of(scene.environment->bottom), scene.environment->bottom.w, scene);
}
#elif ENVIRONMENT == ENVIRONMENT_IMAGE
// Where on the picture a direction lies, 0 to 1 from the left and from the bottom; `aside` is the sine of its angle from the
// poles.
static inline void environment_place(F3 d, const __global Environment *e, F *u, F *v, F *aside)
{
    F right = dot3(d, f3_of(e->right));
    F forward = dot3(d, f3_of(e->forward));
    *aside = sqrt(right * right + forward * forward);
    *u = 0.5f + turns_of(forward, right);
    *v = share_upwards(dot3(d, f3_of(e->up)), *aside);
}

static inline F3 environment_texel(F u, F v, Scene scene)
{
    const __global Texture *t = scene.textures + scene.environment->texture;
    return mul(image_at(t, scene.texels, u, v), f3_of(t->a));
}

static inline F3 environment_radiance(F3 d, Scene scene)
{
    F u, v, aside;
    environment_place(d, scene.environment, &u, &v, &aside);
    return environment_colour(environment_texel(u, v, scene), 0.0f, scene);
}

// The tables of how light sampling picks directions, behind the curve of the emitters: the curve of the rows of cells, from
// the bottom, those of the cells of each row, and the density of each cell.
#define ENVIRONMENT_TABLES(scene)   ((scene).distribution + CURVE((scene).emitter_count))
#define DENSITIES(e)                (CURVE((e)->rows) + (e)->rows * CURVE((e)->columns))

// Solid-angle density with which environment_sample chooses a direction.
static inline F environment_density(I row, I column, F aside, Scene scene)
{
    const __global Environment *e = scene.environment;
    const __global float *densities = ENVIRONMENT_TABLES(scene) + DENSITIES(e);
    return GATHER(F, densities, row * e->columns + column, ) / MAX(aside, (F)(1e-20f));
}

static inline F environment_pdf(F3 d, Scene scene)
{
    const __global Environment *e = scene.environment;
    F u, v, aside;
    environment_place(d, e, &u, &v, &aside);
    return environment_density(within(TO_I(v * (float)e->rows), e->rows), within(TO_I(u * (float)e->columns), e->columns),
                               aside, scene);
}

// A direction, with density in proportion to the brightness of the picture, and the radiance from there.
static F3 environment_sample(F u, F v, Scene scene, F3 *radiance, F *pdf)
{
    const __global Environment *e = scene.environment;
    const __global float *tables = ENVIRONMENT_TABLES(scene);
    F x, y, sine, cosine, aside, depth, of_rows, of_columns;
    I row = cell_at(tables, FALSE, e->rows, u, &y, &of_rows);
    I column = cell_at(tables, CURVE(e->rows) + row * CURVE(e->columns), e->columns, v, &x, &of_columns);
    y = (TO_F(row) + y) * (1.0f / (float)e->rows);
    x = (TO_F(column) + x) * (1.0f / (float)e->columns);
    sincos_turns(0.5f * y, &aside, &depth);                 // from straight down
    sincos_turns(x, &sine, &cosine);                        // from backward, over the left
    *radiance = environment_texel(x, y, scene);
    *pdf = of_rows * of_columns * (float)(e->rows * e->columns) * (0.5f * INV_PI_F * INV_PI_F)
        / MAX(aside, (F)(1e-20f));
    F3 d = scale(f3_of(e->right), -aside * sine);
    d = add(d, scale(f3_of(e->forward), -aside * cosine));
    return add(d, scale(f3_of(e->up), -depth));
}
#endif

#endif
