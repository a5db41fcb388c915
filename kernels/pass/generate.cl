// Starts a wave of paths: one camera ray per slot. Writes the ray, throughput B, SELF, and, unless a stream
// follows, clears L, PDF and REACH; counts
// the rays by what became of them in the lens. Facts: CAMERA_FILE, CAMERA_HAS_LENS, STREAM, HAS_EMITTERS.
#include CAMERA_FILE
#include "integrator/state.h"

__kernel void generate(const __global Camera  *camera,
                       const __global float   *tables,     // pupil circles of a lens camera
                       const __global Surface *surfaces,   // of a lens camera, film side first
                       __global uint          *outcomes,   // rays by status
                       __global float         *state,      // path state
                       uint                    capacity,   // slots in the state
                       Wave                    wave)
{
    uint slot = get_global_id(0) * VW;
    Lane lane = lane_of(slot, wave);
    F4 u = random4(lane.pixel, lane.sample, (U)(0u), wave.seed);
    CameraRay ray = camera_ray(lane, u, camera, tables, surfaces);
    I alive = lane.inside & (ray.weight > 0.0f);
#if CAMERA_HAS_LENS
    for (int status = 0; status < RAY_STATUS_COUNT; ++status) {
        uint n = COUNT(lane.inside & (ray.status == status));
        if (n != 0u)
            atomic_add(outcomes + status, n);
    }
#endif
    WRITE_I(SELF, slot, alive ? (I)(NO_PRIMITIVE) : (I)(PATH_ENDED));
#if !STREAM
    WRITE_F3(L, slot, f3(ZERO, ZERO, ZERO));
#if HAS_EMITTERS
    WRITE_F(REACH, slot, ZERO);
    WRITE_F(PDF, slot, ZERO);
#endif
#endif
    if (!ANY(alive))
        return;
    F3 o = f3(camera->right.x * ray.o.x + camera->up.x * ray.o.y + camera->back.x * ray.o.z,
              camera->right.y * ray.o.x + camera->up.y * ray.o.y + camera->back.y * ray.o.z,
              camera->right.z * ray.o.x + camera->up.z * ray.o.y + camera->back.z * ray.o.z);
    F3 d = f3(camera->right.x * ray.d.x + camera->up.x * ray.d.y + camera->back.x * ray.d.z,
              camera->right.y * ray.d.x + camera->up.y * ray.d.y + camera->back.y * ray.d.z,
              camera->right.z * ray.d.x + camera->up.z * ray.d.y + camera->back.z * ray.d.z);
    WRITE_F3(O, slot, o);
    WRITE_F3(D, slot, d);
    WRITE_F3(B, slot, f3(ray.weight, ray.weight, ray.weight));
}
