// Writes the camera ray of every slot, in the camera's frame, and where on the film it starts.
#include CAMERA_FILE

__kernel void probe_camera(const __global Camera  *camera,
                           const __global float   *tables,
                           const __global Surface *surfaces,
                           const __global float   *stop,
                           __global float         *out,        // [12][capacity]
                           uint                    capacity,   // slots
                           Wave                    wave,
                           const __global uint    *tiles)
{
    uint slot = get_global_id(0) * VW;
    Lane lane = lane_of(slot, wave, tiles);
    F4 u = random4(lane.pixel, lane.sample, (U)(0u), wave.seed);
    CameraRay ray = camera_ray(lane, u, (F)(camera->wavelength), camera, tables, surfaces, stop);
    STORE_F(out, slot, ray.o.x);
    STORE_F(out + capacity, slot, ray.o.y);
    STORE_F(out + 2 * capacity, slot, ray.o.z);
    STORE_F(out + 3 * capacity, slot, ray.d.x);
    STORE_F(out + 4 * capacity, slot, ray.d.y);
    STORE_F(out + 5 * capacity, slot, ray.d.z);
    STORE_F(out + 6 * capacity, slot, ray.weight);
    STORE_F(out + 7 * capacity, slot, TO_F(ray.status));
    STORE_F(out + 8 * capacity, slot, TO_F(lane.x));
    STORE_F(out + 9 * capacity, slot, TO_F(lane.y));
    STORE_F(out + 10 * capacity, slot, TO_F(AS_I(lane.sample)));
    STORE_F(out + 11 * capacity, slot, lane.inside ? ONE : ZERO);
}
