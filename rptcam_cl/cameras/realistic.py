"""The realistic camera: every ray is traced through every surface of a lens."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rptcam_cl.cameras.aperture import stop_shape
from rptcam_cl.cameras.blur import traced_blur
from rptcam_cl.cameras.geometry import intrinsics
from rptcam_cl.cameras.lens_records import lens_records
from rptcam_cl.cameras.lens_setting import LensSetting, lens_setting
from rptcam_cl.cameras.model import CameraModel, CameraView, camera_record, entrance_pupil_view
from rptcam_cl.cameras.pupil import pupil_sampling
from rptcam_cl.cameras.pupil_window import Window, paraxial_irradiance, pupil_in_windows
from rptcam_cl.cameras.thick_lens import thick_lens
from rptcam_cl.errors import InputError
from rptcam_cl.optics import Lens
from rptcam_cl.optics.irradiance import on_axis_irradiance
from rptcam_cl.scene.camera import RealisticCamera
from rptcam_cl.scene.scene import Scene


def build(scene: Scene) -> CameraModel:
    """Return the camera for the device.

    Raises
    ------
    InputError
        When the lens cannot be focused or stopped as asked, or lets no light through to the centre of the film.
    """
    return model_of(scene, lens_setting(scene))


def model_of(scene: Scene, setting: LensSetting, windows: Sequence[Window] = ()) -> CameraModel:
    """Return the camera of a scene with its lens set in some other way than the scene says.

    Parameters
    ----------
    windows
        Parts of the film that will be rendered, where not the whole is: then only the pupils seen from there are found,
        in a tenth of the time, and `exposure: relative` goes by first-order optics.
    """
    camera = scene.camera
    assert isinstance(camera, RealisticCamera)
    lens, back_mm = _shaped(scene, camera, setting.lens), setting.film_distance_mm
    width_mm, height_mm = (side * 1e3 for side in scene.film.size_m())
    irradiance = paraxial_irradiance if windows else on_axis_irradiance
    on_axis = irradiance(lens, back_mm, camera.wavelength_nm)
    if not on_axis > 0:
        raise InputError(
            f"camera.lens: {lens.name}: no ray from the centre of the film passes the lens"
            f" (film distance {back_mm:g} mm)"
        )
    half_film_mm = (width_mm / 2, height_mm / 2)
    if windows:
        pupil = pupil_in_windows(lens, back_mm, half_film_mm, camera.wavelength_nm, windows)
    else:
        pupil = pupil_sampling(lens, back_mm, half_film_mm, camera.wavelength_nm, camera.pupil)
    record = camera_record(camera, scene.film)
    record["a"][0] = (*half_film_mm, back_mm, setting.gain)
    record["b"][0] = (1e-3, -(back_mm + lens.length) * 1e-3, 0.0, 0.0)
    record["pupil"][0] = pupil.parameters
    record["count"] = len(lens.surfaces)
    traced = lens_records(lens, camera.wavelength_nm, "film", back_mm)
    return CameraModel(
        "camera/realistic.h",
        record,
        facts=traced.facts | pupil.facts,
        tables=pupil.table,
        surfaces=traced.surfaces,
        stop=traced.stop.astype(np.float32),
        has_lens=True,
        metadata={"camera": "realistic", **setting.metadata, "on_axis_irradiance": on_axis}
        | pupil.metadata
        | _projection(scene, camera, setting),
        view=_view(scene, setting),
        on_axis_irradiance=on_axis,
        axial_weight=on_axis,
    )


def _view(scene: Scene, setting: LensSetting) -> CameraView:
    """Return what layers need to know; a stop that is not round counts as its circle."""
    lens, wavelength_nm = setting.lens, setting.camera.wavelength_nm
    size_mm = [side * 1e3 for side in scene.film.size_m()]
    columns, rows = scene.film.resolution
    return entrance_pupil_view(
        lens.first_order(wavelength_nm),
        -(setting.film_distance_mm + lens.length) * 1e-3,
        lambda: traced_blur(
            lens,
            setting.film_distance_mm,
            setting.focus_distance_mm,
            (size_mm[0] / 2, size_mm[1] / 2),
            (columns / size_mm[0], rows / size_mm[1]),
            wavelength_nm,
        ),
    )


def _projection(scene: Scene, camera: RealisticCamera, setting: LensSetting) -> dict[str, Any]:
    """Return the intrinsics of the lens to first order, nothing where a thick lens cannot stand for it."""
    try:
        thick = thick_lens(setting.lens, setting.film_distance_mm, camera.wavelength_nm)
    except InputError:
        return {}
    per_tangent = thick.film_per_tangent(*scene.film.size_m())
    return {"intrinsics": intrinsics(scene.film, per_tangent, flip=camera.flip, distortion="traced lens")}


def _shaped(scene: Scene, camera: RealisticCamera, lens: Lens) -> Lens:
    """Return the lens with its stop in the shape of the camera's aperture."""
    shape = stop_shape(scene, camera.aperture)
    if shape is None:
        return lens
    if lens.stop is None:
        raise InputError(f"camera.aperture: {lens.name} has no stop to shape (mark one with stop: true)")
    return lens.with_stop_shape(shape)
