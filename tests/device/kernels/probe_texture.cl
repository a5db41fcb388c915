// Writes the colour of the first texture of a scene at given coordinates.
#include "material/texture.h"

__kernel void probe_texture(SCENE_PARAMETERS
                            const __global float *places,   // [2][count]
                            __global float       *colours,  // [3][count]
                            uint                  count)
{
    uint i = get_global_id(0) * VW;
    F3 c = texture_color(0, LOAD_F(places, i), LOAD_F(places + count, i), SCENE);
    STORE_F(colours, i, c.x);
    STORE_F(colours + count, i, c.y);
    STORE_F(colours + 2 * count, i, c.z);
}
