// Light that receivers get by smooth glass and mirrors: the photons around a point, each weighted by the distance
// (Epanechnikov's kernel over the disk of the grid's radius: Silverman 1986, ch. 4). Photons are sorted by the cell that they
// lie in, twice the radius wide. Cells have numbers modulo a power of two, that of a lattice: those along x follow one another,
// those along y and z are a step and its square apart, so that cells of one number lie far from each other on any plane, and
// the eight about a point have different ones. Which of those hold photons says a byte, from numbers with a longer period:
// most places have none near, and would look through photons of elsewhere.
#ifndef GATHER_H
#define GATHER_H
#include "caustics/photon.h"
#include "material/scatter.h"

#define TANGENTIAL 0.25f     // a photon may stand off the plane of the surface by this share of the radius
#define LEAST_COSINE 1e-3f   // of a photon's direction: below, power per area of the surface has no digits

// Whether a vertex takes its caustics from photons.
static inline I receives(Vertex vertex, I role)
{
    I kind = vertex.kind;
    I taking = (kind == MATERIAL_MATTE) | (kind == MATERIAL_PLASTIC) | (kind == MATERIAL_ROUGH_PLASTIC)
        | (kind == MATERIAL_PRINCIPLED) | (kind == MATERIAL_TRANSLUCENT);
    return taking & ((role & ROLE_RECEIVER) != 0);
}

// What one photon adds to the radiance against d.
static inline F3 light_of_photon(Eight photon, Vertex vertex, F3 d, Side side, F weight, Scene scene)
{
    F3 way = from_octahedral(AS_I(photon.f[6]));
    F pdf;
    F3 bsdf = scatter_eval(vertex, d, side, scale(way, -ONE), &pdf);
    F3 power = f3(photon.f[3], photon.f[4], photon.f[5]);
#if SPECTRAL_COLOURS
    power = light_in(scene.spectral, power);
#endif
    return scale(mul(bsdf, power), weight / MAX(absolute(dot3(vertex.ng, way)), (F)(LEAST_COSINE)));
}

// Of a cell, the photons that the lanes `on` count. `most` is the number of edges that a photon may have.
static F3 light_of_cell(I cell, I on, Vertex vertex, F3 d, Side side, I primitive, I most, float radius2, Scene scene)
{
    F3 sum = f3(ZERO, ZERO, ZERO);
    I k = on ? GATHER(I, scene.photon_cells, cell, ) : FALSE;
    I end = on ? GATHER(I, scene.photon_cells, cell + 1, ) : FALSE;
    I more = k < end;
    while (ANY(more)) {
        Eight photon = load_eight(scene.photons, (more ? k : FALSE) * 8);
        F3 off = sub(f3(photon.f[0], photon.f[1], photon.f[2]), vertex.p);
        F height = dot3(off, vertex.ng);
        F aside2 = dot3(off, off) - height * height;
        I mark = AS_I(photon.f[7]);
        I near = more & (aside2 < radius2) & (height * height < TANGENTIAL * TANGENTIAL * radius2)
            & ((mark & ((1 << EDGES_SHIFT) - 1)) == primitive) & ((mark >> EDGES_SHIFT) <= most);
        if (ANY(near)) {
            F weight = 1.0f - aside2 / radius2;
            sum = add(sum, keep3(near, light_of_photon(photon, vertex, d, side, weight, scene)));
        }
        k += more ? (I)(1) : FALSE;
        more = k < end;
    }
    return sum;
}

static inline U cell_number(I x, I y, I z, const __global PhotonGrid *grid)
{
    return AS_U(x) + (U)(grid->step) * (AS_U(y) + (U)(grid->step) * AS_U(z));
}

// Which of the eight cells about a place have photons, of any share: bytes behind the cells.
static inline I cells_with_photons(I on, I x, I y, I z, Scene scene)
{
    const __global PhotonGrid *grid = scene.photon_grid;
    I place = AS_I(cell_number(x, y, z, grid) & (U)(grid->mask_byte));
    int behind = (int)((grid->mask_sample + 1) * (grid->mask_cell + 1) + 1);
    I four = on ? GATHER(I, scene.photon_cells, behind + (place >> 2), ) : FALSE;
    return (four >> (8 * (place & 3))) & 0xff;
}

// Radiance against d from the vertices of the lanes `on`, by photons of at most so many edges.
static F3 caustic_radiance(Vertex vertex, F3 d, Side side, I on, I primitive, I most, U sample, Scene scene)
{
    F3 sum = f3(ZERO, ZERO, ZERO);
    const __global PhotonGrid *grid = scene.photon_grid;
    F3 p = vertex.p;
    on = on & (p.x >= grid->low.x) & (p.y >= grid->low.y) & (p.z >= grid->low.z)
        & (p.x <= grid->high.x) & (p.y <= grid->high.y) & (p.z <= grid->high.z);
    if (!ANY(on))
        return sum;
    float per_cell = grid->low.w;
    float radius2 = grid->high.w * grid->high.w;
    p = select3(on, p, f3_of(grid->low));
    I x = TO_I(FLOOR(p.x * per_cell - 0.5f));
    I y = TO_I(FLOOR(p.y * per_cell - 0.5f));
    I z = TO_I(FLOOR(p.z * per_cell - 0.5f));
    I held = cells_with_photons(on, x, y, z, scene);
    U seen = (sample & (U)(grid->mask_sample)) * (U)(grid->mask_cell + 1);
    for (int i = 0; i < 8; ++i) {
        I has = (held & (1 << i)) != 0;
        if (!ANY(has))
            continue;
        U number = cell_number(x + (i & 1), y + ((i >> 1) & 1), z + (i >> 2), grid);
        I cell = AS_I(seen + (number & (U)(grid->mask_cell)));
        sum = add(sum, light_of_cell(cell, has, vertex, d, side, primitive, most, radius2, scene));
    }
    return scale(sum, (F)(2.0f * INV_PI_F / radius2));
}

#endif
