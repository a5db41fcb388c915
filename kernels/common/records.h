// Records shared with the host; the typedefs (Primitive, Material, Camera …) and the indices of the path state
// (PATH_OX …) are derived from rptcam_cl/core/records.py and stand in front of this program.
#ifndef RECORDS_H
#define RECORDS_H
#include "common/math.h"

// What a path's last-touched primitive may be besides an index.
#define NO_PRIMITIVE   (-1)
#define PATH_ENDED     (-2)
#define IN_MEDIUM      (-3)     // scattered by a medium, away from surfaces

// Where the slots of a wave lie on the film, whose buffers hold tiles of 8 x 8 pixels in row order, each as four of 4 x 4,
// so that 8 neighbouring lanes are 4 x 2 pixels. `tiles` lists the tiles that are rendered. Slots run through the pixels
// [first_pixel, first_pixel + pixels) of that list, then through the samples of the wave.
typedef struct { I x, y; U pixel, sample; I inside; } Lane;

// The place in the film's buffers of a pixel of the wave.
static inline uint film_place(uint pixel, Wave wave, const __global uint *tiles)
{
    uint index = wave.first_pixel + pixel;
    return (tiles[index >> 6] << 6) | (index & 63u);
}

// Where a stream keeps the camera ray of a slot: those of neighbouring pixels together, one sample after the other.
#define RAYS_TOGETHER 16u

static inline uint record_of(uint slot, Wave wave)
{
    uint step = slot / wave.pixels;
    uint pixel = slot - step * wave.pixels;
    uint within = pixel % RAYS_TOGETHER;
    return (pixel - within) * wave.samples + step * RAYS_TOGETHER + within;
}

static Lane lane_of(uint slot, Wave wave, const __global uint *tiles)
{
    uint step = slot / wave.pixels;
    uint place = film_place(slot - step * wave.pixels, wave, tiles);
    uint tile = place >> 6;
    uint row = tile / wave.tiles_across;
    I within = (I)((int)(place & 15u)) + LANES;
    Lane lane;
    lane.x = (I)((int)(8u * (tile - row * wave.tiles_across) + ((place >> 2) & 4u))) + (within & 3);
    lane.y = (I)((int)(8u * row + ((place >> 3) & 4u))) + (within >> 2);
    lane.inside = (lane.x < wave.width) & (lane.y < wave.height);
    lane.x += wave.crop_x + 8 * wave.tiles_skipped * (int)(tile - row * wave.tiles_across);
    lane.y += wave.crop_y + 8 * wave.tiles_skipped * (int)(row);
    lane.pixel = AS_U(lane.y * wave.full_width + lane.x);
    lane.sample = (U)(wave.first_sample + step);
    return lane;
}

#endif
