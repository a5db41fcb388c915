// Groups of lamps whose light is kept apart, one film each. A group is a number from 0 on.
// Fact: LIGHT_GROUPS, how many there are; 0 where light is not kept apart. Passes that define GROUPS_IN_STATE add to what is in
// memory: as part of a path sixteen groups would fill 48 registers.
#ifndef GROUPS_H
#define GROUPS_H
#include "common/scene.h"
#ifdef GROUPS_IN_STATE
#include "integrator/state.h"
#endif

#if LIGHT_GROUPS
#ifdef GROUPS_IN_STATE
typedef struct { __global float *state; uint capacity, slot; } GroupLight;

static void add_to_group(const GroupLight *at, I group, I on, F3 light)
{
#if VW == 1
    if (on)
        write_group(at->state, at->capacity, at->slot, group, add(read_group(at->state, at->capacity, at->slot, group), light));
#else
    for (int g = 0; g < LIGHT_GROUPS; ++g) {
        F3 before = read_group(at->state, at->capacity, at->slot, g);
        write_group(at->state, at->capacity, at->slot, g, add(before, keep3(on & (group == g), light)));
    }
#endif
}
#else
typedef struct { F3 of[LIGHT_GROUPS]; } GroupLight;

static inline GroupLight no_group_light(void)
{
    GroupLight groups;
    for (int g = 0; g < LIGHT_GROUPS; ++g)
        groups.of[g] = f3(ZERO, ZERO, ZERO);
    return groups;
}

static inline void add_to_group(GroupLight *groups, I group, I on, F3 light)
{
    for (int g = 0; g < LIGHT_GROUPS; ++g)
        groups->of[g] = add(groups->of[g], keep3(on & (group == g), light));
}
#endif
#endif

// The group of what shines at a primitive that was hit.
static inline I group_of_primitive(Scene scene, I primitive)
{
#if LIGHT_GROUPS
    return GATHER(I, scene.primitive_groups, MAX(primitive, FALSE), );
#else
    return FALSE;
#endif
}

static inline I group_of_emitter(Scene scene, I e)
{
#if LIGHT_GROUPS
    return GATHER(I, scene.emitter_groups, e, );
#else
    return FALSE;
#endif
}

#endif
