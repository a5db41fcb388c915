// What light sampling reads of an emitter, and what it makes of it.
#ifndef EMITTER_H
#define EMITTER_H
#include "common/scene.h"
#include "geometry/hit.h"

// What is known of a surface that light arrives at: its normal, 0 for all directions, and the lobe of its facets.
typedef struct {
    F3 n;
#if LIGHT_LOBES
    F3 mirrored;    // where a mirror would send what comes along the path
    F  width;       // of the lobe about that, in radians, squared
    F  share;       // of what is scattered, that the lobe has
#endif
} Receiver;

static inline Receiver all_round(void)
{
    Receiver receiver;
    receiver.n = f3(ZERO, ZERO, ZERO);
#if LIGHT_LOBES
    receiver.mirrored = receiver.n;
    receiver.width = ONE;
    receiver.share = ZERO;
#endif
    return receiver;
}

#if LAMPS_BEHIND_GLASS
static inline Receiver select_receiver(I on, Receiver a, Receiver b)
{
    Receiver receiver;
    receiver.n = select3(on, a.n, b.n);
#if LIGHT_LOBES
    receiver.mirrored = select3(on, a.mirrored, b.mirrored);
    receiver.width = on ? a.width : b.width;
    receiver.share = on ? a.share : b.share;
#endif
    return receiver;
}
#endif

typedef struct {
    F3 direction;   // from the shading point, unit
    F  reach;       // distance to the emitter
    F3 radiance;    // emitted radiance / density, cosine and BSDF left out; zero where the sample is void
    F  pdf;         // solid-angle density incl. the pick; 0 for point and directional lights, which no BSDF sample can meet
    I  primitive;   // the emitter's primitive or NO_PRIMITIVE; FROM_SKY of the environment and FROM_SUN - e of sun e, where
                    // CAUSTICS or LAMPS_BEHIND_GLASS ask
    I  triangle;        // and its triangle
#if LAMPS_BEHIND_GLASS
    F  weight;      // 1 / density where the sample follows glass to the lamp, else 0
#endif
#if LIGHT_GROUPS
    I  group;       // light/groups.h
#endif
} LightSample;

#define FROM_SKY (-3)
#define FROM_SUN (-4)

// A member of emitter e of the list es.
#if ONE_EMITTER
#define OF_EMITTER(T, member) ((T)(es->member))
#else
#define OF_EMITTER(T, member) GATHER(T, es, e, .member)
#endif
#define THREE_OF_EMITTER(member) \
    f3(OF_EMITTER(F, member.x), OF_EMITTER(F, member.y), OF_EMITTER(F, member.z))

#endif
