"""The realistic camera: every ray is traced through every surface of a lens."""

from __future__ import annotations

from typing import Any

import numpy as np

from rptcam_cl.cameras.aperture import stop_shape
from rptcam_cl.cameras.lens_records import lens_records
from rptcam_cl.cameras.model import CameraModel, camera_record
from rptcam_cl.cameras.pupil import pupil_sampling
from rptcam_cl.errors import InputError
from rptcam_cl.optics import Lens, load_lens
from rptcam_cl.optics.focus import film_distance, object_distance
from rptcam_cl.optics.irradiance import on_axis_irradiance
from rptcam_cl.scene.camera import RealisticCamera
from rptcam_cl.scene.scene import Scene


def lens_of(scene: Scene) -> Lens:
    """Return the lens of a realistic camera, stopped down as the scene says."""
    camera = scene.camera
    assert isinstance(camera, RealisticCamera)
    source = scene.lens_source()
    assert source is not None
    lens = load_lens(source)
    if camera.f_number is not None:
        lens = lens.with_stop_diameter(lens.stop_diameter_for(camera.f_number, camera.wavelength_nm))
    elif camera.stop_diameter_mm is not None:
        lens = lens.with_stop_diameter(camera.stop_diameter_mm)
    return _with_shaped_stop(scene, lens, camera)


def _with_shaped_stop(scene: Scene, lens: Lens, camera: RealisticCamera) -> Lens:
    """Return the lens with its stop in the shape of the camera's aperture."""
    shape = stop_shape(scene, camera.aperture)
    if shape is None:
        return lens
    if lens.stop is None:
        raise InputError(f"camera.aperture: {lens.name} has no stop to shape (mark one with stop: true)")
    return lens.with_stop_shape(shape)


def film_distance_of(camera: RealisticCamera, lens: Lens) -> float:
    """Return the distance from the last vertex to the film [mm]."""
    if camera.focus.film_distance_mm is not None:
        return camera.focus.film_distance_mm
    assert camera.focus.distance_m is not None
    return film_distance(lens, camera.focus.distance_m * 1e3, wavelength_nm=camera.wavelength_nm)


def _metadata(camera: RealisticCamera, lens: Lens, back_mm: float, on_axis: float) -> dict[str, Any]:
    first = lens.first_order(camera.wavelength_nm)
    try:
        focus_m: float | None = object_distance(lens, back_mm, camera.wavelength_nm) * 1e-3
    except InputError:  # the film lies where no object images: legal, just never sharp
        focus_m = None
    return {
        "camera": "realistic",
        "lens": lens.name,
        "focal_length_mm": first.focal_length_mm,
        "f_number": first.f_number,
        "film_distance_mm": back_mm,
        "focus_distance_m": focus_m,
        "on_axis_irradiance": on_axis,
        "wavelength_nm": camera.wavelength_nm,
    }


def build(scene: Scene) -> CameraModel:
    """Return the camera for the device.

    Raises
    ------
    InputError
        When the lens cannot be focused or stopped as asked, or lets no light through to the centre of the film.
    """
    camera = scene.camera
    assert isinstance(camera, RealisticCamera)
    lens = lens_of(scene)
    back_mm = film_distance_of(camera, lens)
    width_mm, height_mm = (side * 1e3 for side in scene.film.size_m())
    on_axis = on_axis_irradiance(lens, back_mm, camera.wavelength_nm)
    if not on_axis > 0:
        raise InputError(
            f"camera.lens: {lens.name}: no ray from the centre of the film passes the lens"
            f" (film distance {back_mm:g} mm)"
        )
    half_film_mm = (width_mm / 2, height_mm / 2)
    pupil = pupil_sampling(lens, back_mm, half_film_mm, camera.wavelength_nm, camera.pupil)
    indices = lens.indices(camera.wavelength_nm)
    scale = float(indices[-1] / indices[0]) ** 2  # radiance over n^2 is what refraction conserves
    if scene.exposure == "relative":
        scale /= on_axis
    record = camera_record(camera, scene.film)
    record["a"][0] = (*half_film_mm, back_mm, scale)
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
        metadata=_metadata(camera, lens, back_mm, on_axis) | pupil.metadata,
    )
