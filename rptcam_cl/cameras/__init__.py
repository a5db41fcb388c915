"""Camera models, one module each: a camera of the scene becomes a record, tables and the kernel that reads them."""

from __future__ import annotations

from collections.abc import Callable

from rptcam_cl.cameras import environment, pinhole, realistic, thick_lens, thin_lens
from rptcam_cl.cameras.aperture import stop_shape
from rptcam_cl.cameras.chief_rays import CameraRays, chief_rays
from rptcam_cl.cameras.dispersion import EXTREMES_NM, colour_error_px, disperses, fewest_terms, fit_nodes, usable_nm
from rptcam_cl.cameras.entrance_pupil import EntrancePupil, entrance_pupil, pupil_in_world
from rptcam_cl.cameras.exposure import exposed, on_axis_irradiance, values_per_irradiance
from rptcam_cl.cameras.film_pupil import FilmPupil, FilmPupils, film_pupils
from rptcam_cl.cameras.filter import FilterTable, filter_table
from rptcam_cl.cameras.geometry import camera_geometry
from rptcam_cl.cameras.ghost_records import WayRecords, ghost_setting, ghosts_have_colours
from rptcam_cl.cameras.half_pupil import PupilLine, Split, halved, pupil_line
from rptcam_cl.cameras.lamp_aim import Shows, Sights, aimed_at_lamps
from rptcam_cl.cameras.lamp_fits import SeenLamp
from rptcam_cl.cameras.model import CameraModel, CameraView, turned
from rptcam_cl.cameras.movements import film_frame, half_film_mm
from rptcam_cl.cameras.pupil_rays import PupilRays, lens_rays, thin_lens_rays
from rptcam_cl.cameras.ray_map import RayMap
from rptcam_cl.cameras.rays import allowed_px, fitted_map
from rptcam_cl.cameras.realistic import lens_tint, shows_losses
from rptcam_cl.cameras.records import lens_records
from rptcam_cl.cameras.seen_places import seen_places
from rptcam_cl.cameras.setting import (
    LensSetting,
    design_to_focus,
    film_for_infinity,
    film_point,
    focused,
    lens_setting,
    lens_to_focus,
)
from rptcam_cl.cameras.stop_dirt import dirt_edges, edges_of
from rptcam_cl.cameras.thick_lens import ThickLens, thick_lens_of
from rptcam_cl.cameras.trajectory import camera_trajectory, exposure_timing
from rptcam_cl.scene import LensColour, RealisticCamera, Scene, at_opening, unknown_camera

_MODELS: dict[str, Callable[[Scene], CameraModel]] = {
    "pinhole": pinhole.build,
    "environment": environment.build,
    "thin_lens": thin_lens.build,
    "thick_lens": thick_lens.build,
}


def camera_model(scene: Scene, lens_colour: LensColour = "off", *, coarse: bool = False) -> CameraModel:
    """Return what the camera of a scene needs on the device, where it is when the shutter opens.

    Parameters
    ----------
    lens_colour
        Whether the lens refracts each wavelength separately: only where a picture of this size shows it with ``auto``.
    coarse
        Whether a table of the pupil does that is made faster and holds all but slivers of it.
    """
    scene = at_opening(scene)
    if isinstance(scene.camera, RealisticCamera):
        return exposed(realistic.build(scene, lens_colour, coarse=coarse), scene)
    if scene.camera.kind not in _MODELS:
        raise unknown_camera(scene.camera.kind, "what makes its records (_MODELS in rptcam_cl/cameras/__init__.py)")
    return exposed(_MODELS[scene.camera.kind](scene), scene)


__all__ = [
    "EXTREMES_NM",
    "CameraModel",
    "CameraRays",
    "CameraView",
    "EntrancePupil",
    "FilmPupil",
    "FilmPupils",
    "FilterTable",
    "LensSetting",
    "PupilLine",
    "PupilRays",
    "RayMap",
    "SeenLamp",
    "Shows",
    "Sights",
    "Split",
    "ThickLens",
    "WayRecords",
    "aimed_at_lamps",
    "allowed_px",
    "camera_geometry",
    "camera_model",
    "camera_trajectory",
    "chief_rays",
    "colour_error_px",
    "design_to_focus",
    "dirt_edges",
    "disperses",
    "edges_of",
    "entrance_pupil",
    "exposed",
    "exposure_timing",
    "fewest_terms",
    "film_for_infinity",
    "film_frame",
    "film_point",
    "film_pupils",
    "filter_table",
    "fit_nodes",
    "fitted_map",
    "focused",
    "ghost_setting",
    "ghosts_have_colours",
    "half_film_mm",
    "halved",
    "lens_rays",
    "lens_records",
    "lens_setting",
    "lens_tint",
    "lens_to_focus",
    "on_axis_irradiance",
    "pupil_in_world",
    "pupil_line",
    "seen_places",
    "shows_losses",
    "stop_shape",
    "thick_lens_of",
    "thin_lens_rays",
    "turned",
    "usable_nm",
    "values_per_irradiance",
]
