// Records shared with the host; the typedefs (Primitive, Material, Camera …) and the indices of the path state
// (PATH_OX …) are derived from rptcam_cl/records.py and stand in front of this program.
#ifndef RECORDS_H
#define RECORDS_H
#include "common/math.h"

// What a path's last-touched primitive may be besides an index.
#define NO_PRIMITIVE   (-1)
#define PATH_ENDED     (-2)

// Where the slots of a wave lie on the film: 4 x 4 tiles in row order, so that 8 neighbouring lanes are 4 x 2 pixels.
// Slots run through the pixels [first_pixel, first_pixel + pixels) of that order, then through the samples of the wave.
typedef struct { I x, y; U pixel, sample; I inside; } Lane;

static Lane lane_of(uint slot, Wave wave)
{
    uint step = slot / wave.pixels;
    uint index = wave.first_pixel + (slot - step * wave.pixels);
    uint tile = index >> 4;
    uint row = tile / wave.tiles_across;
    I within = (I)((int)(index & 15u)) + LANES;
    Lane lane;
    lane.x = (I)((int)(4u * (tile - row * wave.tiles_across))) + (within & 3);
    lane.y = (I)((int)(4u * row)) + (within >> 2);
    lane.inside = (lane.x < wave.width) & (lane.y < wave.height);
    lane.x += wave.crop_x;
    lane.y += wave.crop_y;
    lane.pixel = AS_U(lane.y * wave.full_width + lane.x);
    lane.sample = (U)(wave.first_sample + step);
    return lane;
}

#endif
