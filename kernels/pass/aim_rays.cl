// Where the rays of a wave start on the film and aim, in float32, for trace_lens.cl to take them through the lens.
// Facts: CAMERA_FILE, FILTER, SPECTRUM.
#include CAMERA_FILE
#include "camera/draw.h"
#include "lens/float64.h"

__kernel void aim_rays(const __global Camera *camera,
                       const __global float  *tables,      // of the pupil
                       Wave                   wave,
                       const __global uint   *tiles,       // that are rendered
                       const __global float  *filter,      // of the film
                       const __global float  *colours,     // wavelengths, common/wavelength.h
                       __global float        *rays,        // see lens/float64.h
                       uint                   capacity)    // slots in it
{
    uint slot = get_global_id(0) * VW;
    Draw draw = draw_of(lane_of(slot, wave, tiles), wave.seed, camera, filter, colours);
    Underway ray = enter_camera(draw.lane, draw.u, draw.wavelength, camera, tables);
    store_aim(rays, capacity, slot, ray, draw.wavelength);
}
