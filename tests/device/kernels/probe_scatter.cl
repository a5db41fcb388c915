// Scatters at a flat vertex of one material, x along the tangent: evaluates a given direction, and samples one.
#include "material/scatter.h"

__kernel void probe_scatter(const __global Material *materials,
                            int                      material,
                            const __global float    *facet_shares,
                            const __global uint     *texels,
                            const __global float    *in,         // [9][capacity]: d, wo, three random numbers
                            __global float          *out,        // [11][capacity]: value, pdf; direction, weight, pdf
                            uint                     capacity)
{
    uint i = get_global_id(0) * VW;
    Scene scene;
    scene.materials = materials;
    scene.texels = texels;
#if FACET_SHARES
    scene.facet_shares = facet_shares;
#endif
    SurfacePoint point;
    point.n = point.ng = f3(ZERO, ZERO, ONE);
    point.p = f3(ZERO, ZERO, ZERO);
    point.u = ZERO;
    point.v = (F)(0.75f);       // half way from the middle of a fibre to its side
    Vertex vertex;
    vertex.n = vertex.ng = point.n;
    vertex.color = f3(ZERO, ZERO, ZERO);
    vertex.parameter = ONE;
    vertex.kind = (I)(-1);
    vertex.tangent = f3(ONE, ZERO, ZERO);
    vertex.closure = empty_closure();
    vertex.scene = scene;
#define IN(k) LOAD_F(in + (k) * capacity, i)
    F3 d = f3(IN(0), IN(1), IN(2));
    take_material(&vertex, TRUE, materials + material, point, scene);
    F pdf;
    Side side = side_seen(vertex, d);
    F3 value = scatter_eval(vertex, d, side, f3(IN(3), IN(4), IN(5)), &pdf);
    Scattered next = scatter_sample(vertex, d, side, IN(6), IN(7), IN(8));
    F results[11] = {value.x, value.y, value.z, pdf, next.direction.x, next.direction.y, next.direction.z,
                     next.weight.x, next.weight.y, next.weight.z, next.pdf};
    for (int k = 0; k < 11; ++k)
        STORE_F(out + k * capacity, i, results[k]);
}
