// Radiance that arrives from infinity along -d: constant, or linear in the sine of the elevation.
#ifndef ENVIRONMENT_H
#define ENVIRONMENT_H
#include "common/records.h"

#if ENVIRONMENT == ENVIRONMENT_GRADIENT
static F3 environment_radiance(F3 d, const __global Environment *e)
{
    F k = 0.5f + 0.5f * (d.x * e->up.x + d.y * e->up.y + d.z * e->up.z);
    return f3(e->bottom.x + k * (e->top.x - e->bottom.x), e->bottom.y + k * (e->top.y - e->bottom.y),
              e->bottom.z + k * (e->top.z - e->bottom.z));
}
#elif ENVIRONMENT == ENVIRONMENT_CONSTANT
static F3 environment_radiance(F3 d, const __global Environment *e) { return f3_of(e->bottom); }
#endif

#endif
