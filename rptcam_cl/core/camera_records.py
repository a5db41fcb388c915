"""The records of cameras and their lenses; see `rptcam_cl.core.record`."""

from __future__ import annotations

from rptcam_cl.core.record import Record

DISPERSION_TERMS = 12
DISPERSION_NM = (380.0, 780.0)  # wavelengths that the polynomials in x = scale / wavelength - shift, -1 to 1, are for
DISPERSION_SCALE = 2.0 / (1.0 / DISPERSION_NM[0] - 1.0 / DISPERSION_NM[1])
DISPERSION_SHIFT = (DISPERSION_NM[1] + DISPERSION_NM[0]) / (DISPERSION_NM[1] - DISPERSION_NM[0])

EVEN_TERMS = 12
ODD_TERMS = 12
LOSS_TABLE_NM, LOSS_TABLE_LENGTH = 380, 401  # one number per nm
MOST_LAYERS = 12  # of a stack on a surface

SURFACE = Record(
    "Surface",
    (
        # All in the frame of travel: millimetres, z along the direction of travel.
        ("real", "curvature"),  # positive when the centre lies ahead
        ("real", "gap"),  # from the previous vertex
        ("real", "semi_diameter2"),
        ("real", "eta"),  # index before over index after
        ("real", "conic"),
        ("real", "weight_x"),  # 1, or 0 where a cylinder is straight
        ("real", "weight_y"),
        ("real", "half_width"),  # region
        ("real", "half_height"),
        ("real", "edge"),
        ("real", "edge_x"),
        ("real", "edge_y"),
        ("real", "stop_radius"),  # half the side of a mask
        ("real", "refracts"),  # 0 where the media before and after are the same, -1 where a mirror turns z round
        ("real", f"even[{EVEN_TERMS}]"),  # coefficients of r^2, r^4, ...
        ("real", f"odd[{ODD_TERMS}]"),  # coefficients of r, r^3, ...
        ("real", "offset[4]"),  # pose
        ("real", "rotation[12]"),  # rows of a 3x3 matrix
        ("real", f"dispersion[{DISPERSION_TERMS}]"),  # eta over the inverse wavelength, constant first
        ("real", "layer"),  # index of a quarter-wave layer, 0 without one; these are for kernels/lens/coating.h
        ("real", "layer_turns"),  # turns of its phase at a right angle; with tables times the wavelength [nm]
        ("real", f"stack[{2 * MOST_LAYERS}]"),  # of layers from behind: index, turns of the phase as above, halved
        ("real", f"extinction[{MOST_LAYERS}]"),  # of the same layers
        ("real", "index"),  # before the surface
        ("real", "gain"),  # of the transmittance over that of the bare surface
        ("real", "attenuation"),  # before the surface [1/mm], 0 before the first one
        ("real", "inner_semi_diameter2"),
        ("real", "own[4]"),  # what a kind with numbers of its own writes in its `fill`
        ("int", "kind"),
        ("int", "even_terms"),
        ("int", "odd_terms"),
        ("int", "posed"),
        ("int", "region"),
        ("int", "inverted"),
        ("int", "stop_count"),  # edges of the outline, or cells along a side of the mask, that shape the stop
        ("int", "stop_shape"),
        ("int", "index_table"),  # where tables over the wavelength stand behind the shape of the stop, -1 without one
        ("int", "gain_table"),
        ("int", "attenuation_table"),
        ("int", "stacked"),  # layers of the stack
    ),
)

PINHOLE_CAMERA = Record(
    "PinholeCamera",
    (
        ("float", "half_width"),  # tangents of half the field of view
        ("float", "half_height"),
        ("float", "near_distance"),  # [m]
    ),
)

THIN_LENS_CAMERA = Record(
    "ThinLensCamera",
    (
        ("float", "half_width"),  # tangents of half the field of view
        ("float", "half_height"),
        ("float", "focus_distance"),  # of the plane of focus [m]
        ("float", "aperture_radius"),  # [m]
    ),
)

THICK_LENS_CAMERA = Record(
    "ThickLensCamera",
    (
        ("float", "film_half_width"),  # [mm]
        ("float", "film_half_height"),
        ("float", "weight"),  # of a ray along the axis
        ("float", "metres_per_mm"),
        ("float", "first_vertex_z"),  # in the camera's frame [m]
        ("float", "film_slope_per_film"),  # slope at the film per mm of the film point
        ("float", "film_slope_per_pupil"),  # and per radius of the pupil
        ("float", "height_per_film"),  # height in the plane of the first vertex [mm], likewise
        ("float", "height_per_pupil"),
        ("float", "slope_per_film"),  # slope in the scene, likewise
        ("float", "slope_per_pupil"),
    ),
)

PUPIL_CIRCLE = Record(
    "PupilCircle",
    (
        ("float", "shift"),  # of its centre per mm of the film point
        ("float", "radius"),  # [mm]
    ),
)

PUPIL_GRID = Record(
    "PupilGrid",  # cells of boxes, or outlines along a film radius, whole numbers of them
    (
        ("float", "per_mm_across"),
        ("float", "per_mm_down"),
        ("float", "across"),
        ("float", "down"),
    ),
)

PUPIL_LINES = Record(
    "PupilLines",  # outlines along lines from the axis outwards, whole numbers of them
    (
        ("float", "per_quarter"),  # lines in a quarter of a turn
        ("float", "nodes"),  # of a line
        ("float", "lines"),
    ),
)

PUPIL = Record(
    "Pupil",  # see kernels/lens/pupil.h
    ((PUPIL_CIRCLE, "circle"), (PUPIL_GRID, "grid"), (PUPIL_LINES, "lines")),
    is_union=True,
)

REALISTIC_CAMERA = Record(
    "RealisticCamera",
    (
        ("float", "film_half_width"),  # [mm]
        ("float", "film_half_height"),
        ("float", "film_distance"),  # from the film to the last vertex [mm]
        ("float", "gain"),  # of every ray's weight
        ("float", "metres_per_mm"),
        ("float", "first_vertex_z"),  # in the camera's frame [m]
        ("int", "surfaces"),
        ("int", "first_polynomial"),  # where they stand behind the pupil's table
        (PUPIL, "pupil"),
    ),
)

OWN_CAMERA = Record(
    "OwnCamera",  # what a camera of each kind has of its own; an environment camera has nothing
    (
        (PINHOLE_CAMERA, "pinhole"),
        (THIN_LENS_CAMERA, "thin_lens"),
        (THICK_LENS_CAMERA, "thick_lens"),
        (REALISTIC_CAMERA, "realistic"),
    ),
    is_union=True,
)

HALF_PUPIL = Record(
    "HalfPupil",  # see kernels/lens/half_pupil.h
    (
        ("float", "normal_x"),  # of the line that parts the pupil
        ("float", "normal_y"),
        ("float", "offset"),  # of the line along its normal
        ("float", "share"),  # of the film point by which the line moves
        ("int", "beyond"),  # whether the half beyond the line is meant
    ),
)

CAMERA = Record(
    "Camera",
    (
        ("float4", "right"),
        ("float4", "up"),
        ("float4", "back"),
        # Of a film that is moved (rptcam_cl/cameras/movements.py), x to the right, y up, z away from the lens: [mm], or
        # in film distances of a camera without a lens of surfaces.
        ("float4", "film_centre"),  # w: 1 / film distance [1/m]
        ("float4", "film_across"),  # half the film
        ("float4", "film_up"),
        ("float4", "film_normal"),  # unit
        ("float", "width"),  # [pixels]
        ("float", "height"),
        ("float", "per_width"),  # 1 / width, negative where the picture is shown as it lies on the film
        ("float", "per_height"),
        ("float", "exposure"),  # factor of every ray's weight
        ("float", "wavelength"),  # of all rays, where they have one [nm]
        (HALF_PUPIL, "half_pupil"),
        (OWN_CAMERA, "own"),
        ("int", "lamp_table"),  # see kernels/lens/lamp_aim.h: where it stands among the tables
        ("int", "lamp_across"),  # blocks of pixels
        ("int", "lamp_down"),
        ("int", "lamp_shift"),  # log2 of their side
        ("int", "reserved"),
    ),
)
