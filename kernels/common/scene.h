// The scene as the kernels read it: one list of buffers, in the order in which the host binds them
// (rptcam_cl/wavefront/buffers.py). SCENE_PARAMETERS stands first among the parameters of every kernel that meets the
// scene, SCENE makes the struct of them.
#ifndef SCENE_H
#define SCENE_H
#include "common/records.h"

typedef struct {
    const __global Primitive   *primitives;    // sorted by kind
    const __global int         *kind_end;      // end of each kind in `primitives`
    const __global Material    *materials;
    const __global Texture     *textures;
    const __global uint        *texels;
    const __global Emitter     *emitters;
    const __global Environment *environment;
    int                         emitter_count;
} Scene;

#define SCENE_PARAMETERS                        \
    const __global Primitive   *primitives,     \
    const __global int         *kind_end,       \
    const __global Material    *materials,      \
    const __global Texture     *textures,       \
    const __global uint        *texels,         \
    const __global Emitter     *emitters,       \
    const __global Environment *environment,    \
    int                         emitter_count

#define SCENE scene_of(primitives, kind_end, materials, textures, texels, emitters, environment, emitter_count)

static Scene scene_of(SCENE_PARAMETERS)
{
    Scene s;
    s.primitives = primitives;
    s.kind_end = kind_end;
    s.materials = materials;
    s.textures = textures;
    s.texels = texels;
    s.emitters = emitters;
    s.environment = environment;
    s.emitter_count = emitter_count;
    return s;
}

#endif
