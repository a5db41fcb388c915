// What a light tree knows of the surface that it picks a lamp for. Facts: LIGHT_LOBES.
#ifndef RECEIVER_H
#define RECEIVER_H
#include "common/math.h"

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

#endif
