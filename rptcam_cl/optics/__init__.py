"""Lenses in float64: prescriptions, glass, first-order data, exact rays, focus and pupils. Needs no OpenCL.

Lengths are millimetres and wavelengths nanometres. The frame of a lens has its origin at the first vertex and +z
towards the film; surfaces are listed scene side first.
"""

from rptcam_cl.optics.absorption import Absorption
from rptcam_cl.optics.axial_beam import disk_irradiance
from rptcam_cl.optics.best_focus import best_film_distance, best_film_distance_at
from rptcam_cl.optics.blur import blur_variances
from rptcam_cl.optics.chief_fan import fan_chief_rays, round_chief_rays
from rptcam_cl.optics.chief_rays import ChiefRays, aimed_rays, film_chief_rays, unobstructed
from rptcam_cl.optics.coating import (
    BARE,
    MAGNESIUM_FLUORIDE,
    Coating,
    Interface,
    MeasuredReflectance,
    QuarterWave,
    constant_reflectance,
)
from rptcam_cl.optics.copies import PAIRS, Copies, Deviation
from rptcam_cl.optics.copies_trace import check_copies, film_points
from rptcam_cl.optics.design import GlassChoice, doublet, doublet_radii, image_distances, singlet
from rptcam_cl.optics.files.coatings import WORDS, layered
from rptcam_cl.optics.files.fields import FieldError
from rptcam_cl.optics.files.glass_names import glass_named, named_glass
from rptcam_cl.optics.files.glasses import read_glass
from rptcam_cl.optics.files.keys import GLASS
from rptcam_cl.optics.files.makers import glasses_of, plain_glass_name
from rptcam_cl.optics.files.native import document_of
from rptcam_cl.optics.files.schema import glass_json_schema, lens_json_schema_text
from rptcam_cl.optics.film_crossings import Crossings, crossings
from rptcam_cl.optics.film_frame import UNMOVED, FilmFrame
from rptcam_cl.optics.first_order import FirstOrder, Planes, Pupil, limiting_surface, system_matrix
from rptcam_cl.optics.focus import film_distance, object_distance
from rptcam_cl.optics.ghost_path import (
    GhostImage,
    ghost_image,
    ghost_magnification,
    steps,
    unfolded,
    with_film,
    with_wider_stop,
)
from rptcam_cl.optics.ghost_tree import Account, Lit
from rptcam_cl.optics.ghosts import FilmLight, Ghosts, find_ghosts
from rptcam_cl.optics.glare import Glare, veiling_glare
from rptcam_cl.optics.glass import (
    AIR,
    NO_DISPERSION,
    AbbeCauchy,
    AbbeLinear,
    ConstantIndex,
    Law,
    Medium,
    Melt,
    PowerSeries,
    Sellmeier,
    TabulatedIndex,
    abbe_number,
    attenuation,
    continued_words,
    held_index,
    known_range,
)
from rptcam_cl.optics.heat import BARRELS, Heat, thermal_of
from rptcam_cl.optics.irradiance import axial_irradiance, film_irradiance, on_axis_irradiance, pass_areas
from rptcam_cl.optics.layer_stack import Layer, LayerStack
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.library import digests_of_lens, list_lenses, load_lens, named_lens, names_a_file
from rptcam_cl.optics.placement import SurfacePose
from rptcam_cl.optics.prescription import FocusState
from rptcam_cl.optics.probe import BULGE, PATCH_RADII, FilmProbe, Wavelengths, cells, grid, narrowed, spread_points
from rptcam_cl.optics.pupil_boxes import FINE, narrowing_probes, pupil_boxes
from rptcam_cl.optics.pupil_function import PupilFunction, pupil_function
from rptcam_cl.optics.pupil_shape import (
    COARSE_OUTLINES,
    DIRECTIONS,
    PupilShapes,
    pupil_shapes,
    quarters_of,
    shared_shapes,
)
from rptcam_cl.optics.ray_trace import Rays, Status, passed_rays, passing, trace
from rptcam_cl.optics.region import Region
from rptcam_cl.optics.shapes import Biconic, Form, Toroid, short_radius
from rptcam_cl.optics.spot import Beam, chief_ray, passing_beam
from rptcam_cl.optics.stop_shape import StopMask, StopShape, blades, fitted, heart, polygon, star
from rptcam_cl.optics.stopped_pupils import StoppedPupils, stopped_pupils
from rptcam_cl.optics.summary import image_circle, lens_info, t_number
from rptcam_cl.optics.surface import Surface
from rptcam_cl.optics.thermal import STANDARD_C, STANDARD_HPA, Thermal, air_index
from rptcam_cl.optics.transmission import (
    BY_NAME,
    COATED,
    IDEAL,
    UNCOATED,
    LensTransmission,
    axial_transmittance,
    has_coatings,
    is_tinted,
    known_nm,
    with_coating,
)
from rptcam_cl.optics.variable import (
    at_position,
    brought_to_focus,
    configured,
    film_behind,
    floated,
    focused_by_group,
    moved,
    shift_of,
    travel_mm,
    zoom_range_mm,
    zoomed,
)
from rptcam_cl.optics.wave_image import (
    AIRY,
    Strehl,
    centroid,
    diffraction_mtf,
    encircled,
    encircling,
    peak_to_valley,
    radius_of_share,
    rms_waves,
    spread,
    strehl,
    transfer,
)
from rptcam_cl.optics.wide_beam import is_steep, passing_from, takes_steep_light

__all__ = [
    "AIR",
    "AIRY",
    "BARE",
    "BARRELS",
    "BULGE",
    "BY_NAME",
    "COARSE_OUTLINES",
    "COATED",
    "DIRECTIONS",
    "FINE",
    "GLASS",
    "IDEAL",
    "MAGNESIUM_FLUORIDE",
    "NO_DISPERSION",
    "PAIRS",
    "PATCH_RADII",
    "STANDARD_C",
    "STANDARD_HPA",
    "UNCOATED",
    "UNMOVED",
    "WORDS",
    "AbbeCauchy",
    "AbbeLinear",
    "Absorption",
    "Account",
    "Beam",
    "Biconic",
    "ChiefRays",
    "Coating",
    "ConstantIndex",
    "Copies",
    "Crossings",
    "Deviation",
    "FieldError",
    "FilmFrame",
    "FilmLight",
    "FilmProbe",
    "FirstOrder",
    "FocusState",
    "Form",
    "GhostImage",
    "Ghosts",
    "Glare",
    "GlassChoice",
    "Heat",
    "Interface",
    "Law",
    "Layer",
    "LayerStack",
    "Lens",
    "LensTransmission",
    "Lit",
    "MeasuredReflectance",
    "Medium",
    "Melt",
    "Planes",
    "PowerSeries",
    "Pupil",
    "PupilFunction",
    "PupilShapes",
    "QuarterWave",
    "Rays",
    "Region",
    "Sellmeier",
    "Status",
    "StopMask",
    "StopShape",
    "StoppedPupils",
    "Strehl",
    "Surface",
    "SurfacePose",
    "TabulatedIndex",
    "Thermal",
    "Toroid",
    "Wavelengths",
    "abbe_number",
    "aimed_rays",
    "air_index",
    "at_position",
    "attenuation",
    "axial_irradiance",
    "axial_transmittance",
    "best_film_distance",
    "best_film_distance_at",
    "blades",
    "blur_variances",
    "brought_to_focus",
    "cells",
    "centroid",
    "check_copies",
    "chief_ray",
    "configured",
    "constant_reflectance",
    "continued_words",
    "crossings",
    "diffraction_mtf",
    "digests_of_lens",
    "disk_irradiance",
    "document_of",
    "doublet",
    "doublet_radii",
    "encircled",
    "encircling",
    "fan_chief_rays",
    "film_behind",
    "film_chief_rays",
    "film_distance",
    "film_irradiance",
    "film_points",
    "find_ghosts",
    "fitted",
    "floated",
    "focused_by_group",
    "ghost_image",
    "ghost_magnification",
    "glass_json_schema",
    "glass_named",
    "glasses_of",
    "grid",
    "has_coatings",
    "heart",
    "held_index",
    "image_circle",
    "image_distances",
    "is_steep",
    "is_tinted",
    "known_nm",
    "known_range",
    "layered",
    "lens_info",
    "lens_json_schema_text",
    "limiting_surface",
    "list_lenses",
    "load_lens",
    "moved",
    "named_glass",
    "named_lens",
    "names_a_file",
    "narrowed",
    "narrowing_probes",
    "object_distance",
    "on_axis_irradiance",
    "pass_areas",
    "passed_rays",
    "passing",
    "passing_beam",
    "passing_from",
    "peak_to_valley",
    "plain_glass_name",
    "polygon",
    "pupil_boxes",
    "pupil_function",
    "pupil_shapes",
    "quarters_of",
    "radius_of_share",
    "read_glass",
    "rms_waves",
    "round_chief_rays",
    "shared_shapes",
    "shift_of",
    "short_radius",
    "singlet",
    "spread",
    "spread_points",
    "star",
    "steps",
    "stopped_pupils",
    "strehl",
    "system_matrix",
    "t_number",
    "takes_steep_light",
    "thermal_of",
    "trace",
    "transfer",
    "travel_mm",
    "unfolded",
    "unobstructed",
    "veiling_glare",
    "with_coating",
    "with_film",
    "with_wider_stop",
    "zoom_range_mm",
    "zoomed",
]
