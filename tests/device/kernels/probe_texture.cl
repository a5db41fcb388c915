// Writes the colour of a texture of a scene at given coordinates.
#include "material/texture.h"

__kernel void probe_texture(SCENE_PARAMETERS
                            const __global float *places,   // [2][count]
                            __global float       *colours,  // [3][count]
                            uint                  count,
                            int                   texture)
{
    uint i = get_global_id(0) * VW;
    F u = LOAD_F(places, i), v = LOAD_F(places + count, i);
    Scene scene = SCENE;
#if HAS_MAPPING
    scene.place = f3(u, v, u - 0.5f * v);
#endif
    F3 c = texture_color(texture, u, v, scene);
    STORE_F(colours, i, c.x);
    STORE_F(colours + count, i, c.y);
    STORE_F(colours + 2 * count, i, c.z);
}
