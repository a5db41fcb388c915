// What light sampling reads of an emitter, and what it makes of it.
#ifndef EMITTER_H
#define EMITTER_H
#include "common/scene.h"
#include "geometry/hit.h"
#include "light/receiver.h"

typedef struct {
    F3 direction;   // from the shading point, unit
    F  reach;       // distance to the emitter
    F3 radiance;    // emitted radiance / density, cosine and BSDF left out; zero where the sample is void
    F  pdf;         // solid-angle density incl. the pick; 0 for point and directional lights, which no BSDF sample can meet
    I  primitive;   // the emitter's primitive or NO_PRIMITIVE; with CAUSTICS FROM_SKY of a picture of the environment
    I  triangle;        // and its triangle
#if LIGHT_GROUPS
    I  group;       // light/groups.h
#endif
} LightSample;

#define FROM_SKY (-3)

// A member of emitter e of the list es.
#if ONE_EMITTER
#define OF_EMITTER(T, member) ((T)(es->member))
#else
#define OF_EMITTER(T, member) GATHER(T, es, e, .member)
#endif
#define THREE_OF_EMITTER(member) \
    f3(OF_EMITTER(F, member.x), OF_EMITTER(F, member.y), OF_EMITTER(F, member.z))

#endif
