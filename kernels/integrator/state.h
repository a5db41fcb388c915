// Path state in memory: one array per field, each `capacity` slots long; a slot is one path in flight.
#ifndef STATE_H
#define STATE_H
#include "common/records.h"
#include "geometry/hit.h"

#define FIELD(name)             (state + (size_t)PATH_##name * capacity)
#define READ_F(name, slot)      LOAD_F(FIELD(name), slot)
#define READ_I(name, slot)      AS_I(LOAD_F(FIELD(name), slot))
#define READ_F3(name, slot)     f3(READ_F(name##X, slot), READ_F(name##Y, slot), READ_F(name##Z, slot))
#define WRITE_F(name, slot, v)  STORE_F(FIELD(name), slot, v)
#define WRITE_I(name, slot, v)  STORE_F(FIELD(name), slot, AS_F(v))
// Triangles are part of the state where there are meshes.
#if HAS_MESH
#define READ_TRIANGLE(name, slot)      READ_I(name, slot)
#define WRITE_TRIANGLE(name, slot, v)  WRITE_I(name, slot, v)
#else
#define READ_TRIANGLE(name, slot)      ((I)(NO_TRIANGLE))
#define WRITE_TRIANGLE(name, slot, v)
#endif
// And the time where something moves.
#if MOVES
#define READ_TIME(slot)            READ_F(TIME, slot)
#else
#define READ_TIME(slot)            ZERO
#endif
#define WRITE_F3(name, slot, v) \
    do { WRITE_F(name##X, slot, (v).x); WRITE_F(name##Y, slot, (v).y); WRITE_F(name##Z, slot, (v).z); } while (0)

// The order in which work items of one lane take the paths of a block of slots, and how many these are: pass/sort.cl.
#define QUEUE_BLOCK    2048u
#define QUEUE          ((__global ushort *)FIELD(QUEUE))    // slots, each within its block
#define QUEUED(block)  (QUEUE[capacity + (block)])
#define NO_SLOT        0xffffffffu

// The (first) slot of a work item, NO_SLOT behind the last path. Before paths are sorted they are taken as they lie.
static inline uint slot_of_item(__global float *state, uint capacity, int are_sorted)
{
    uint item = get_global_id(0);
#if VW == 1
    if (are_sorted)
        return item % QUEUE_BLOCK < QUEUED(item / QUEUE_BLOCK) ? item / QUEUE_BLOCK * QUEUE_BLOCK + QUEUE[item] : NO_SLOT;
    QUEUE[item] = (ushort)(item % QUEUE_BLOCK);
#endif
    return item * VW;
}

// The same once more, for a read in place of a register that is held all along: compilers for GPUs keep what they do not see.
static inline uint slot_again(__global float *state, uint capacity)
{
    uint item = get_global_id(0);
#if VW == 1
    return item / QUEUE_BLOCK * QUEUE_BLOCK + *(volatile __global ushort *)(QUEUE + item);
#endif
    return item * VW;
}

// The ray that a path is on.
static Ray read_ray(const __global float *state, uint capacity, uint slot)
{
    Ray ray;
    ray.origin = READ_I(ORIGIN, slot);
    ray.triangle = READ_TRIANGLE(TRIANGLE, slot);
    ray.o = READ_F3(O, slot);
    ray.d = READ_F3(D, slot);
#if HAS_MOTION
    ray.time = READ_TIME(slot);
#endif
    return ray;
}

#if LIGHT_GROUPS
// The light of one group of lamps, and of all: three fields each behind those of every path.
#define GROUP_FIELD(group)  (state + (size_t)(PATH_GROUPS + 3 * (group)) * capacity)

static F3 read_group(const __global float *state, uint capacity, uint slot, int group)
{
    const __global float *field = GROUP_FIELD(group);
    return f3(LOAD_F(field, slot), LOAD_F(field + capacity, slot), LOAD_F(field + 2 * (size_t)capacity, slot));
}

static void write_group(__global float *state, uint capacity, uint slot, int group, F3 light)
{
    __global float *field = GROUP_FIELD(group);
    STORE_F(field, slot, light.x);
    STORE_F(field + capacity, slot, light.y);
    STORE_F(field + 2 * (size_t)capacity, slot, light.z);
}
#endif

// What it meets.
static void write_hit(__global float *state, uint capacity, uint slot, Hit hit)
{
    WRITE_I(HIT, slot, hit.primitive);
    WRITE_F(T, slot, hit.t);
    WRITE_TRIANGLE(HIT_TRIANGLE, slot, hit.triangle);
#if HAS_MESH || HAS_CURVE
    WRITE_F(B1, slot, hit.b1);
#endif
#if HAS_MESH
    WRITE_F(B2, slot, hit.b2);
#endif
}

#endif
