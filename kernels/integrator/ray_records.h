// The camera rays of a stream as records (o, weight, d, time) in memory, which the pass generate or the stream itself wrote.
#ifndef RAY_RECORDS_H
#define RAY_RECORDS_H
#include "camera/film_point.h"
#include "common/transpose.h"

static inline void write_record(WorldRay ray, uint place, __global float *records)
{
    Eight record;
    record.f[0] = ray.o.x; record.f[1] = ray.o.y; record.f[2] = ray.o.z; record.f[3] = ray.weight;
    record.f[4] = ray.d.x; record.f[5] = ray.d.y; record.f[6] = ray.d.z; record.f[7] = ZERO;
#if MOVES
    record.f[7] = ray.time;
#endif
    store_eight(records, place, record);
}

typedef struct {
    const __global float *records;
    Lane lane;          // its sample is that of the last ray
    I    next, end;     // records
    int  home;          // of which there is one in any case
} CameraRays;

static inline CameraRays start_rays(uint first, Wave wave, const __global uint *tiles, const __global float *records)
{
    CameraRays rays;
    rays.records = records;
    rays.lane = lane_of(first, wave, tiles);
    rays.lane.sample = (U)(wave.first_sample - 1u);
    rays.home = (int)record_of(first, wave);
    rays.next = (I)(rays.home) + LANES;
    rays.end = rays.next + (int)(wave.samples * RAYS_TOGETHER);
    return rays;
}

static inline I rays_left(CameraRays rays) { return rays.next < rays.end; }

// The next rays of the lanes `start`. Those whose ray the lens has blocked take another one at once where it blocks many, and
// wait for the next time where it blocks few. Fact: BLOCKS_MANY.
static WorldRay take_rays(CameraRays *rays, I start)
{
    I source = start ? rays->next : (I)(rays->home);
    Eight record = load_eight(rays->records, source * 8);
    rays->lane.sample = start ? rays->lane.sample + 1u : rays->lane.sample;
    rays->next = start ? rays->next + (int)RAYS_TOGETHER : rays->next;
#if BLOCKS_MANY
    I blocked = start & (record.f[3] == 0.0f) & rays_left(*rays);
    if (ANY(blocked)) {
        while (ANY(blocked)) {
            source = blocked ? rays->next : source;
            rays->lane.sample = blocked ? rays->lane.sample + 1u : rays->lane.sample;
            rays->next = blocked ? rays->next + (int)RAYS_TOGETHER : rays->next;
            blocked = blocked & (GATHER(F, rays->records + 3, source * 8, ) == 0.0f) & rays_left(*rays);
        }
        record = load_eight(rays->records, source * 8);
    }
#endif
    WorldRay r;
    r.o = f3(record.f[0], record.f[1], record.f[2]);
    r.weight = record.f[3];
    r.d = f3(record.f[4], record.f[5], record.f[6]);
#if MOVES
    r.time = record.f[7];
#endif
    return r;
}

#endif
