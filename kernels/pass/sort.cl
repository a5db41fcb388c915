// Puts the living paths of each block of slots in order by the kind of material that they have met: work items side by side then
// do the same in the passes that follow, and those behind the last path leave. A group takes a block, an item 32 places of it.
// Reads ORIGIN, HIT and QUEUE; writes QUEUE. The order of paths of a kind stays. Facts: ENVIRONMENT, EMITTER_SUNS.
#include "integrator/state.h"

#define ITEMS  64u
#define EACH   (QUEUE_BLOCK / ITEMS)    // at most the bits of a number
#define IN_AIR (MATERIAL_KINDS)         // scattered by a medium
#define BEYOND (MATERIAL_KINDS + 1)     // met nothing: these end together
#define KINDS  (MATERIAL_KINDS + 2)     // no path that goes on is of this one

static int kind_met(int origin, int hit, const __global Primitive *primitives, const __global Material *materials)
{
    if (origin == PATH_ENDED)
        return KINDS;
    if (hit >= 0)
        return materials[primitives[hit].material].kind;
#if ENVIRONMENT || EMITTER_SUNS
    return hit == NO_PRIMITIVE ? BEYOND : IN_AIR;
#else
    return hit == NO_PRIMITIVE ? KINDS : IN_AIR;
#endif
}

__attribute__((reqd_work_group_size(ITEMS, 1, 1)))
__kernel void sort(const __global Primitive *primitives,
                   const __global Material  *materials,
                   __global float           *state,     // path state
                   uint                      capacity,  // slots in the state
                   Wave                      wave,
                   uint                      depth)     // of the vertex that follows, from 1
{
    __local ushort slots[EACH][ITEMS];      // as they were in the queue
    __local uint of_kind[KINDS][ITEMS];     // which of an item's places have paths of a kind, a bit each
    __local ushort before[KINDS][ITEMS];    // paths of the kind that items before have
    __local ushort count[KINDS];
    uint item = get_global_id(0) % ITEMS, block = get_global_id(0) / ITEMS;
    uint first = block * QUEUE_BLOCK;
    uint places = depth == 1u ? min(QUEUE_BLOCK, wave.pixels * wave.samples - first) : QUEUED(block);
    if (places == 0u)
        return;
    // See what each path has met.
    for (int kind = 0; kind < KINDS; ++kind)
        of_kind[kind][item] = 0u;
    for (uint i = 0; i < EACH; ++i) {
        uint place = item * EACH + i;
        if (place >= places)
            break;
        uint slot = QUEUE[first + place];
        slots[i][item] = (ushort)slot;
        int origin = as_int(FIELD(ORIGIN)[first + slot]), hit = as_int(FIELD(HIT)[first + slot]);
        int kind = kind_met(origin, hit, primitives, materials);
        if (kind < KINDS)
            of_kind[kind][item] |= 1u << i;
    }
    barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);  // the queue is read before any item writes it
    // Count each kind.
    if (item < KINDS) {
        uint sum = 0u;
        for (uint i = 0; i < ITEMS; ++i) {
            before[item][i] = (ushort)sum;
            sum += popcount(of_kind[item][i]);
        }
        count[item] = (ushort)sum;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    // Write the queue, kind after kind.
    uint start = 0u;
    for (int kind = 0; kind < KINDS; ++kind) {
        uint place = start + before[kind][item];
        for (uint rest = of_kind[kind][item]; rest != 0u; rest &= rest - 1u)
            QUEUE[first + place++] = slots[LOWEST_BIT(rest)][item];
        start += count[kind];
    }
    if (item == 0u)
        QUEUED(block) = (ushort)start;
}
