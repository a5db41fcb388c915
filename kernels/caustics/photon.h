// A photon: light that came from a lamp by smooth glass and mirrors alone and has met a receiver. Eight floats in memory:
// position, power in red, green and blue, direction (octahedral, 2 x 16 bits), and the primitive with the edges of its way.
#ifndef PHOTON_H
#define PHOTON_H
#include "common/transpose.h"
#include "geometry/hit.h"

#define EDGES_SHIFT  24      // primitives below, the number of edges above
#define NO_PHOTON    (-1)    // in place of both

// What a primitive is to caustics: bits of Scene.caustic_roles.
#define ROLE_SURFACE   1     // smooth glass or a mirror, where photons start
#define ROLE_RECEIVER  2     // where they end

static inline I octahedral(F3 d)
{
    F s = 1.0f / (absolute(d.x) + absolute(d.y) + absolute(d.z));
    F x = d.x * s, y = d.y * s;
    I below = d.z < 0.0f;
    F folded = with_sign(1.0f - absolute(y), x);
    y = below ? with_sign(1.0f - absolute(x), y) : y;
    x = below ? folded : x;
    return TO_I(x * 32767.0f + 32768.0f) | (TO_I(y * 32767.0f + 32768.0f) << 16);
}

static inline F3 from_octahedral(I packed)
{
    F x = (TO_F(packed & 0xffff) - 32767.5f) * (1.0f / 32767.0f);
    F y = (TO_F((packed >> 16) & 0xffff) - 32767.5f) * (1.0f / 32767.0f);
    F z = 1.0f - absolute(x) - absolute(y);
    I below = z < 0.0f;
    F folded = with_sign(1.0f - absolute(y), x);
    y = below ? with_sign(1.0f - absolute(x), y) : y;
    x = below ? folded : x;
    return normalized(f3(x, y, z));
}

// What a primitive is to caustics, of the lanes `on`.
static inline I caustic_role(I on, I primitive, Scene scene)
{
    I known = (on & (primitive >= 0)) ? primitive : FALSE;
    return on ? GATHER(I, scene.caustic_roles, known, ) : FALSE;
}

#endif
