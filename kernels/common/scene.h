// The scene as the kernels read it: one list of buffers, in the order in which the host binds them
// (rptcam_cl/wavefront/buffers.py). SCENE_PARAMETERS stands first among the parameters of every kernel that meets the
// scene, SCENE makes the struct of them.
#ifndef SCENE_H
#define SCENE_H
#include "common/records.h"
#include "common/wavelength.h"

typedef struct {
    const __global Primitive   *primitives;    // sorted by kind
    const __global int         *kind_end;      // end of each kind in `primitives`
    const __global Material    *materials;
    const __global Texture     *textures;
    const __global uint        *texels;
    const __global Emitter     *emitters;
    const __global Environment *environment;
    const __global float       *distribution;  // curves of how light sampling picks, common/curve.h
    int                         emitter_count;
#if SPECTRUM
    const __global float       *colours;       // wavelengths, common/wavelength.h
#endif
#if HUES
    Hues                        hues;          // of the lanes at hand
#endif
#if HAS_DISPERSION
    F                           inverse;       // wavelength of the lanes at hand, as inverse_wavelength has it
#endif
#if HAS_MOTION
    const __global Leg         *legs;          // of what moves, kernels/geometry/movement.h
    const __global int2        *movement_of;
#endif
#if HAS_PRIMITIVE_TREE
    const __global float4      *primitive_nodes;    // kernels/geometry/primitive_tree.h
    const __global int         *primitive_leaves;
#endif
#if HAS_MESH
    const __global float       *nodes;         // of all trees, kernels/geometry/bvh.h
    const __global float       *blocks;
    const __global int4        *triangles;     // corners, and which primitive of its instance it belongs to
    const __global float       *vertices;      // position, normal, texture coordinates
    const __global Instance    *instances;
    int                         mesh_root;
    float4                      mesh_low, mesh_high;   // bounds of all meshes
#endif
} Scene;

#if HAS_MESH
#define MESH_PARAMETERS ,                       \
    const __global float       *nodes,          \
    const __global float       *blocks,         \
    const __global int4        *triangles,      \
    const __global float       *vertices,       \
    const __global Instance    *instances,      \
    int                         mesh_root,      \
    float4                      mesh_low,       \
    float4                      mesh_high
#define MESHES , nodes, blocks, triangles, vertices, instances, mesh_root, mesh_low, mesh_high
#else
#define MESH_PARAMETERS
#define MESHES
#endif

#if HAS_PRIMITIVE_TREE
#define TREE_PARAMETERS ,                       \
    const __global float4      *primitive_nodes, \
    const __global int         *primitive_leaves
#define PRIMITIVE_TREE , primitive_nodes, primitive_leaves
#else
#define TREE_PARAMETERS
#define PRIMITIVE_TREE
#endif

#if SPECTRUM
#define COLOUR_PARAMETERS ,                     \
    const __global float       *colours
#define COLOURS_HERE , colours
#else
#define COLOUR_PARAMETERS
#define COLOURS_HERE
#endif
#if HAS_MOTION
#define MOTION_PARAMETERS ,                     \
    const __global Leg         *legs,           \
    const __global int2        *movement_of
#define MOVEMENTS , legs, movement_of
#else
#define MOTION_PARAMETERS
#define MOVEMENTS
#endif

#define SCENE_PARAMETERS                        \
    const __global Primitive   *primitives,     \
    const __global int         *kind_end,       \
    const __global Material    *materials,      \
    const __global Texture     *textures,       \
    const __global uint        *texels,         \
    const __global Emitter     *emitters,       \
    const __global Environment *environment,    \
    const __global float       *distribution,   \
    int                         emitter_count   \
    COLOUR_PARAMETERS MOTION_PARAMETERS TREE_PARAMETERS MESH_PARAMETERS

#define SCENE scene_of(primitives, kind_end, materials, textures, texels, emitters, environment, distribution, \
                       emitter_count COLOURS_HERE MOVEMENTS PRIMITIVE_TREE MESHES)

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
    s.distribution = distribution;
    s.emitter_count = emitter_count;
#if SPECTRUM
    s.colours = colours;
#endif
#if HAS_MOTION
    s.legs = legs;
    s.movement_of = movement_of;
#endif
#if HAS_PRIMITIVE_TREE
    s.primitive_nodes = primitive_nodes;
    s.primitive_leaves = primitive_leaves;
#endif
#if HAS_MESH
    s.nodes = nodes;
    s.blocks = blocks;
    s.triangles = triangles;
    s.vertices = vertices;
    s.instances = instances;
    s.mesh_root = mesh_root;
    s.mesh_low = mesh_low;
    s.mesh_high = mesh_high;
#endif
    return s;
}

#endif
