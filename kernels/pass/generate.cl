// Starts a wave of paths: one camera ray per slot, those that the lens stops are counted by reason. For a stream it writes
// records (o, weight, d, time), eight floats each; for the passes the fields O, D, WEIGHT, B, ORIGIN, TIME,
// WAVELENGTH_SAMPLE, and clears L, PDF and REACH.
// Facts: CAMERA_FILE, CAMERA_HAS_LENS, CAMERA_PACKETS (packets of lanes per work item), LENS_FLOAT64 (whether the passes
// aim_rays and trace_lens have taken the rays through the lens), STREAM, HAS_EMITTERS, FILTER, MOVES, SPECTRUM.
#include "camera/into_world.h"
#include "camera/packets.h"
#include "camera/stopped.h"
#include "integrator/ray_records.h"
#include "integrator/state.h"
#if LENS_FLOAT64
#include "lens/float64.h"
#endif

#if LENS_FLOAT64
#define TRACED_PARAMETER , const __global float *traced
#else
#define TRACED_PARAMETER
#endif

static void start_path(Draw draw, CameraRay ray, uint slot, Wave wave, const __global Camera *camera,
                       __global uint *counters, __global float *state, uint capacity TRAJECTORY_PARAMETER)
{
#if CAMERA_HAS_LENS
    Stopped stopped = none_stopped();
    count_stopped(&stopped, draw.lane, ray);
    add_stopped(stopped, counters);
#endif
    // Place the ray in the world, and write the record of the stream or the state of the path.
    WorldRay world = into_world(draw, ray, wave.seed, camera TRAJECTORY);
#if STREAM
    write_record(world, record_of(slot, wave), state);
#else
    WRITE_F3(O, slot, world.o);
    WRITE_F3(D, slot, world.d);
    WRITE_F(WEIGHT, slot, world.weight);
    WRITE_F3(B, slot, FIRST_BETA);
    WRITE_I(ORIGIN, slot, world.weight != 0.0f ? (I)(NO_PRIMITIVE) : (I)(PATH_ENDED));
    WRITE_TRIANGLE(TRIANGLE, slot, (I)(NO_TRIANGLE));
#if MOVES
    WRITE_F(TIME, slot, world.time);
#endif
    WRITE_F3(L, slot, f3(ZERO, ZERO, ZERO));
#if LIGHT_GROUPS
    for (int g = 0; g < LIGHT_GROUPS; ++g)
        write_group(state, capacity, slot, g, f3(ZERO, ZERO, ZERO));
#endif
#if SPECTRUM
    WRITE_F(WAVELENGTH_SAMPLE, slot, draw.wavelength_sample);
#endif
#if HAS_EMITTERS
    WRITE_F(REACH, slot, ZERO);
    WRITE_F(PDF, slot, ZERO);
#endif
#endif
}

__kernel void generate(const __global Camera  *camera,
                       const __global float   *tables,     // pupil circles of a lens camera
                       const __global Surface *surfaces,   // of a lens camera, film side first
                       const __global float   *stop,       // shape of its stop
                       __global uint          *counters,   // rays by status
                       __global float         *state,      // path state
                       uint                    capacity,   // slots in the state
                       Wave                    wave,
                       const __global uint    *tiles,      // that are rendered
                       const __global float   *filter,     // of the film
                       const __global float   *colours     // wavelengths, common/wavelength.h
                       TRAJECTORY_PARAMETER TRACED_PARAMETER)
{
    uint slot = get_global_id(0) * (VW * CAMERA_PACKETS);
#if LENS_FLOAT64
    Draw draw = draw_of(lane_of(slot, wave, tiles), wave.seed, camera, filter, colours);
    Underway entering = enter_camera(draw.lane, draw.u, draw.wavelength, camera, tables);
    CameraRay ray = leave_camera(entering, traced_ray(traced, capacity, slot), camera, tables);
    start_path(draw, ray, slot, wave, camera, counters, state, capacity TRAJECTORY);
#else
    Packet packets[CAMERA_PACKETS];
#pragma nounroll
    for (uint i = 0; i < CAMERA_PACKETS; ++i) {
        Draw draw = draw_of(lane_of(slot + i * VW, wave, tiles), wave.seed, camera, filter, colours);
        packets[i] = enter_packet(draw, camera, tables, surfaces, stop);
    }
    cross_lens(packets, camera, surfaces, stop);
#pragma nounroll
    for (uint i = 0; i < CAMERA_PACKETS; ++i)
        start_path(packets[i].draw, leave_packet(&packets[i], camera, tables), slot + i * VW, wave, camera, counters, state,
                   capacity TRAJECTORY);
#endif
}
