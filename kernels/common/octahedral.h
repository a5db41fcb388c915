// A direction in two numbers of 16 bits: the octahedron unfolded onto a square (Cigolle et al., JCGT 2014).
#ifndef OCTAHEDRAL_H
#define OCTAHEDRAL_H
#include "common/math.h"

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

#endif
