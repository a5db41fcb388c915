// Radiance of a lamp with a texture at the point that light sampling chose. Lanes are taken emitter by emitter.
#ifndef EMITTER_TEXTURE_H
#define EMITTER_TEXTURE_H
#include "common/angles.h"
#include "geometry/surface_point.h"
#include "material/texture.h"

#if EMITTER_TEXTURES
// `x` and `y` are along the edges of flat emitters, `there` is the point.
static F3 textured_radiance(I e, I mine, F x, F y, F3 there, Scene scene)
{
    F3 radiance = f3(ZERO, ZERO, ZERO);
#if HAS_MAPPING
    scene.place = there;
#endif
    while (ANY(mine)) {
        int index = first_of(e, mine);
        I now = mine & (e == index);
        const __global Emitter *lamp = scene.emitters + index;
        F u = lamp->uv.x + x * lamp->uv_x.x + y * lamp->uv_y.x;
        F v = lamp->uv.y + x * lamp->uv_x.y + y * lamp->uv_y.y;
        if (lamp->kind == EMITTER_SPHERE) {         // u and v hold its x and z axes, uv.z its handedness
            F3 axis = f3_of(lamp->u);
            F3 pole = f3_of(lamp->v);
            F3 to = sub(there, f3_of(lamp->a));
            F east = dot3(axis, to);
            F north = dot3(cross3(pole, axis), to) * lamp->uv.z;
            u = turns_around(east, north);
            v = share_upwards(dot3(pole, to), sqrt(east * east + north * north));
        }
#if EMITTER_SOLIDS
        if (lamp->kind >= EMITTER_BOX) {
            SurfacePoint point = surface_point(lamp->primitive, there, 1, scene);
            u = point.u;
            v = point.v;
        }
#endif
        radiance = select3(now, texture_color(lamp->texture, u, v, scene), radiance);
        mine = mine & NOT(now);
    }
    return radiance;
}
#endif

#endif
