// A photon: light that came from a lamp by smooth glass and mirrors alone and has met a receiver. Eight floats in memory:
// position, power in red, green and blue, direction (octahedral, 2 x 16 bits), and the primitive with the edges of its way.
#ifndef PHOTON_H
#define PHOTON_H
#include "common/octahedral.h"
#include "common/transpose.h"
#include "geometry/hit.h"

#define EDGES_SHIFT  24      // primitives below, the number of edges above
#define NO_PHOTON    (-1)    // in place of both

// What a primitive is to caustics: bits of Scene.caustic_roles.
#define ROLE_SURFACE   1     // smooth glass or a mirror, where photons start
#define ROLE_RECEIVER  2     // where they end
#define ROLE_STRAIGHT  4     // thin glass that light samples follow to lamps where light passes it straight

// What a primitive is to caustics, of the lanes `on`.
static inline I caustic_role(I on, I primitive, Scene scene)
{
    I known = (on & (primitive >= 0)) ? primitive : FALSE;
    return on ? GATHER(I, scene.caustic_roles, known, ) : FALSE;
}

#endif
