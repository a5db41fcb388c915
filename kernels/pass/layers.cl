// Adds what a wave's camera rays meet first to the auxiliary layers: one work item owns VW pixels and takes their samples
// in order. Reads the camera rays that generate wrote, before the paths go on from them. Facts: STREAM, LAYER_….
#if HAS_MEDIA && LAYER_TRANSMITTANCE >= 0
#define MEETS_BOUNDARIES
#include "integrator/media.h"
#endif
#include "common/transpose.h"
#include "geometry/nearest.h"
#include "integrator/layers.h"
#include "integrator/state.h"
#if CAMERA_SEGMENTS
#include "camera/trajectory.h"
#endif

__kernel void layers(SCENE_PARAMETERS
                     const __global int    *owners,      // per primitive: object and material identifier
                     const __global Camera *camera,
                     const __global float4 *blur,        // table of the circle of confusion
                     const __global View   *view,
                     const __global float  *state,       // records of camera rays, or path state
                     Wave                   wave,
                     uint                   seen,        // samples that count, of the wave's first
                     __global float        *planes,      // sums, compensations, firsts: one plane each
                     uint                   capacity,    // slots in the state
                     uint                   pixels,      // pixels of a plane
                     const __global uint   *tiles        // that are rendered
#if CAMERA_SEGMENTS
                   , const __global float4 *trajectory       // of the camera
#endif
                     )
{
    uint first = get_global_id(0) * VW;
    uint pixel = film_place(first, wave, tiles);
    Scene scene = SCENE;
    LayerSums sums = read_sums(planes, pixel, pixels);
#if !CAMERA_SEGMENTS
    F3 right = f3_of(camera->right);
    F3 up = f3_of(camera->up);
    F3 back = f3_of(camera->back);
#endif
#if HAS_MIX || LAYER_COC >= 0 || LAYER_TRANSMITTANCE >= 0
    Lane lane = lane_of(first, wave, tiles);
#endif
#if LAYER_COC >= 0
    BlurHere here = blur_here(lane, camera, blur, view);
#endif
    for (uint k = 0; k < seen; ++k) {
        uint slot = first + k * wave.pixels;
        // Read the camera ray.
        Ray ray;
        ray.origin = (I)(NO_PRIMITIVE);
        ray.triangle = (I)(NO_TRIANGLE);
#if STREAM
        Eight record = load_eight(state, ((I)((int)record_of(slot, wave)) + LANES) * 8);
        F weight = absolute(record.f[3]);      // a filter may have negative lobes
        F time = record.f[7];
        ray.o = f3(record.f[0], record.f[1], record.f[2]);
        ray.d = f3(record.f[4], record.f[5], record.f[6]);
#else
        F weight = absolute(READ_F(WEIGHT, slot));
        ray.o = READ_F3(O, slot);
        ray.d = READ_F3(D, slot);
        F time = READ_TIME(slot);
#endif
#if HAS_MOTION
        ray.time = time;
#endif
#if CAMERA_SEGMENTS
        Pose pose = pose_at(time, trajectory);
        F3 right = pose.right, up = pose.up, back = pose.back;
#endif
        // Find what it meets.
        I passed = weight > 0.0f;
        if (!ANY(passed))
            continue;
        I fresh = passed & (sums.sum[SUM_OF_PASSED] == 0.0f);
#if HAS_MEDIA && LAYER_TRANSMITTANCE >= 0
        F3 left;
#if HAS_DENSITY
        Chance chance = chance_of(lane.pixel, (U)(wave.first_sample + k), (U)(FROM_A_SURFACE), wave.seed);
#endif
        Hit hit = hit_through_media(ray, &left, passed, scene WITH_CHANCE(chance));
#else
        Hit hit = nearest_hit(ray, scene);
#endif
        I on = passed & (hit.primitive >= 0);
        F met = on ? weight : ZERO;
        hit.t = on ? hit.t : ZERO;
#if HAS_MIX
        F choice = random4(lane.pixel, (U)(wave.first_sample + k), (U)(2u), wave.seed).c;   // that of the path
#else
        F choice = ZERO;
#endif
        Vertex vertex = vertex_of(ray, hit, on, choice, scene);
#if CAMERA_SEGMENTS
        F3 seen_at = sub(vertex.p, pose.eye);
        F3 from = sub(ray.o, pose.eye);
#else
        F3 seen_at = vertex.p;
        F3 from = ray.o;
#endif
        F depth = -dot3(seen_at, back);
        // Add what has a mean.
        add_weighted(&sums, SUM_OF_PASSED, passed ? weight : ZERO, ONE);
        add_weighted(&sums, SUM_OF_HITS, met, ONE);
#if LAYER_DEPTH >= 0
        add_weighted(&sums, LAYER_DEPTH, met, depth);
#endif
#if LAYER_DISTANCE >= 0
        add_weighted(&sums, LAYER_DISTANCE, met, view->from_eye ? hit.t + dot3(from, ray.d) : hit.t);
#endif
#if LAYER_POSITION >= 0
        add_weighted3(&sums, LAYER_POSITION, met, vertex.p);
#endif
        I behind = dot3(vertex.ng, ray.d) > 0.0f;
#if LAYER_NORMAL >= 0
        add_weighted3(&sums, LAYER_NORMAL, behind ? -met : met, vertex.n);
#endif
#if LAYER_GEOMETRIC_NORMAL >= 0
        add_weighted3(&sums, LAYER_GEOMETRIC_NORMAL, behind ? -met : met, vertex.ng);
#endif
#if LAYER_ALBEDO >= 0
        add_weighted3(&sums, LAYER_ALBEDO, met, base_color(vertex));
#endif
#if LAYER_TRANSMITTANCE >= 0
#if !HAS_MEDIA
        F3 left = f3(ONE, ONE, ONE);
#endif
        add_weighted3(&sums, LAYER_TRANSMITTANCE, passed ? weight : ZERO, left);
#endif
#if LAYER_COC >= 0
        F away = view->by_depth ? depth + view->blur_origin_z
                                : dot3(sub(seen_at, scale(back, (F)(view->blur_origin_z))), ray.d);
        F vergence = on ? ONE / MAX(away, (F)(SMALLEST_DISTANCE)) : ZERO;
        add_weighted(&sums, LAYER_COC, passed ? weight : ZERO, circle_of_confusion(here, vergence, view));
#endif
#if LAYER_CRYPTO_OBJECT >= 0
        add_to_owner(planes, LAYER_CRYPTO_OBJECT, pixel, pixels, met, owner_of(hit, on, owners, 0));
#endif
#if LAYER_CRYPTO_MATERIAL >= 0
        add_to_owner(planes, LAYER_CRYPTO_MATERIAL, pixel, pixels, met, owner_of(hit, on, owners, 1));
#endif
        // Keep what has none of the first ray.
        if (!ANY(fresh))
            continue;
#if LAYER_OBJECT_ID >= 0
        write_first(planes, LAYER_OBJECT_ID, pixel, pixels, fresh, owner_of(hit, on, owners, 0));
#endif
#if LAYER_MATERIAL_ID >= 0
        write_first(planes, LAYER_MATERIAL_ID, pixel, pixels, fresh, owner_of(hit, on, owners, 1));
#endif
#if LAYER_UV >= 0
        Uv uv = texture_coordinates(ray, hit, fresh & on, vertex.p, scene);
        write_first(planes, LAYER_UV, pixel, pixels, fresh, on ? uv.u : AS_F((I)(NOT_A_NUMBER)));
        write_first(planes, LAYER_UV + 1, pixel, pixels, fresh, on ? uv.v : AS_F((I)(NOT_A_NUMBER)));
#endif
#if LAYER_PUPIL >= 0
        F step = (view->pupil_z - dot3(from, back)) / dot3(ray.d, back);
        F3 there = along(from, ray.d, step);
        write_first(planes, LAYER_PUPIL, pixel, pixels, fresh, dot3(there, right) * view->per_pupil_radius);
        write_first(planes, LAYER_PUPIL + 1, pixel, pixels, fresh, dot3(there, up) * view->per_pupil_radius);
#endif
    }
    write_sums(planes, pixel, pixels, sums);
}
