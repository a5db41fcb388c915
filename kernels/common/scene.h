// The scene as the kernels read it: one list of buffers, in the order in which the host binds them
// (rptcam_cl/rendering/scene_buffers.py). SCENE_PARAMETERS stands first among the parameters of every kernel that meets the
// scene, others following it without a comma; SCENE makes the struct of them.
#ifndef SCENE_H
#define SCENE_H
#include "common/records.h"
#include "common/wavelength.h"

// The parts of the scene, each as EACH(type, name).
#if SPECTRUM
#define COLOUR_PARTS(EACH) \
    EACH(const __global float *, colours)               /* wavelengths, common/wavelength.h */
#else
#define COLOUR_PARTS(EACH)
#endif

#if HAS_MOTION
#define MOTION_PARTS(EACH) \
    EACH(const __global Segment *, segments)                /* of what moves, kernels/geometry/movement.h */ \
    EACH(const __global int2 *, movement_of)
#else
#define MOTION_PARTS(EACH)
#endif

#if HAS_HIDDEN
#define HIDDEN_PARTS(EACH) \
    EACH(const __global int *, hidden)                  /* of primitives, kernels/geometry/hidden.h */
#else
#define HIDDEN_PARTS(EACH)
#endif

#if ALIGNED_FLATS || ALIGNED_BOXES
#define ALIGNED_PARTS(EACH) \
    EACH(const __global Aligned *, aligned)             /* of primitives, kernels/geometry/aligned.h */
#else
#define ALIGNED_PARTS(EACH)
#endif

#if HAS_PRIMITIVE_TREE
#define TREE_PARTS(EACH) \
    EACH(const __global float4 *, primitive_nodes)      /* kernels/geometry/primitive_tree.h */ \
    EACH(const __global int *, primitive_leaves)
#else
#define TREE_PARTS(EACH)
#endif

#if HAS_MESH
#define MESH_PARTS(EACH) \
    EACH(const __global float *, nodes)                 /* of all trees, kernels/geometry/bvh.h */ \
    EACH(const __global float *, blocks) \
    EACH(const __global int4 *, triangles)              /* corners, and which primitive of its instance it is of */ \
    EACH(const __global float *, vertices)              /* position, normal, texture coordinates */ \
    EACH(const __global Instance *, instances) \
    EACH(int, mesh_root) \
    EACH(float4, mesh_low)                              /* bounds of all meshes */ \
    EACH(float4, mesh_high)
#else
#define MESH_PARTS(EACH)
#endif

#if LIGHT_TREE
#define LIGHT_TREE_PARTS(EACH) \
    EACH(const __global float *, light_nodes)           /* kernels/light/light_tree.h */
#else
#define LIGHT_TREE_PARTS(EACH)
#endif

#if CAUSTICS
#define CAUSTIC_PARTS(EACH) \
    EACH(const __global int *, caustic_roles)           /* of primitives, kernels/caustics/photon.h */ \
    EACH(const __global float *, photons) \
    EACH(const __global int *, photon_cells)            /* where each cell starts among them, kernels/caustics/gather.h */ \
    EACH(const __global PhotonGrid *, photon_grid)
#else
#define CAUSTIC_PARTS(EACH)
#endif

#if VIRTUAL_LIGHTS
#define VIRTUAL_PARTS(EACH) \
    EACH(const __global float *, virtual_lights)        /* kernels/light/virtual_lights.h */ \
    EACH(const __global float *, virtual_density) \
    EACH(const __global VirtualGrid *, virtual_grid)
#else
#define VIRTUAL_PARTS(EACH)
#endif

#if HAS_MEDIA
#define MEDIA_PARTS(EACH) \
    EACH(const __global Medium *, media)                /* by number; the first is empty space */ \
    EACH(int, media_at_camera)                          /* the stack of kernels/material/medium.h there */
#else
#define MEDIA_PARTS(EACH)
#endif

#if HAS_DENSITY
#define DENSITY_PARTS(EACH) \
    EACH(const __global float *, densities)             /* of voxels and blocks of them, kernels/integrator/density.h */
#else
#define DENSITY_PARTS(EACH)
#endif

#if FACET_SHARES
#define FACET_PARTS(EACH) \
    EACH(const __global float *, facet_shares)          /* of light that facets scatter once, kernels/material/facet_shares.h */
#else
#define FACET_PARTS(EACH)
#endif

#if LIGHT_GROUPS
#define GROUP_PARTS(EACH) \
    EACH(const __global int *, primitive_groups)        /* kernels/light/groups.h */ \
    EACH(const __global int *, emitter_groups) \
    EACH(int, sky_group)
#else
#define GROUP_PARTS(EACH)
#endif

#define SCENE_PARTS(EACH) \
    EACH(const __global Primitive *, primitives)        /* sorted by kind */ \
    EACH(const __global int *, kind_end)                /* end of each kind in `primitives` */ \
    EACH(const __global Material *, materials) \
    EACH(const __global Texture *, textures) \
    EACH(const __global uint *, texels) \
    EACH(const __global Emitter *, emitters) \
    EACH(const __global Environment *, environment) \
    EACH(const __global float *, distribution)          /* curves of how light sampling picks, common/curve.h */ \
    EACH(int, emitter_count) \
    LIGHT_TREE_PARTS(EACH) CAUSTIC_PARTS(EACH) VIRTUAL_PARTS(EACH) COLOUR_PARTS(EACH) MOTION_PARTS(EACH) HIDDEN_PARTS(EACH) \
    ALIGNED_PARTS(EACH) TREE_PARTS(EACH) MESH_PARTS(EACH) MEDIA_PARTS(EACH) DENSITY_PARTS(EACH) FACET_PARTS(EACH) GROUP_PARTS(EACH)

#define AS_MEMBER(type, name) type name;
#define AS_PARAMETER(type, name) type name,
#define AS_INITIALIZER(type, name) .name = name,

#if FEW_PRIMITIVES
struct FlatTables;
#endif

typedef struct {
    SCENE_PARTS(AS_MEMBER)
#if FEW_PRIMITIVES
    const struct FlatTables *flats;     // kernels/material/flat_tables.h, or none
#endif
#if SPECTRAL_COLOURS
    SpectralColours spectral;   // colours at the wavelengths of the lanes at hand
#endif
#if HAS_MAPPING
    F3 place;       // of the lanes at hand, for textures that lie in space
#endif
#if HAS_DISPERSION
    F inverse;      // wavelength of the lanes at hand, as inverse_wavelength has it
#endif
} Scene;

#define SCENE_PARAMETERS SCENE_PARTS(AS_PARAMETER)
#define SCENE ((Scene){SCENE_PARTS(AS_INITIALIZER)})

#endif
