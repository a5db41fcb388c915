"""The thin lens: an ideal lens of no thickness with one plane of focus."""

from __future__ import annotations

import math

from rptcam_cl.cameras.aperture import aperture_tables, stop_shape
from rptcam_cl.cameras.blur import Blur, film_depths, perfect_blur
from rptcam_cl.cameras.entrance_pupil import EntrancePupil
from rptcam_cl.cameras.exposure import opening_irradiance
from rptcam_cl.cameras.geometry import intrinsics
from rptcam_cl.cameras.lamp_reach import thin_lens_reach
from rptcam_cl.cameras.model import CameraModel, CameraView, camera_record, half_tangents
from rptcam_cl.cameras.movements import movements_metadata, place_film
from rptcam_cl.scene import Film, Scene, ThinLensCamera


def optics_of(camera: ThinLensCamera, film: Film) -> tuple[float, float, float]:
    """Return the tangents of half the field across and down, and the focal length [m].

    The film stands where the plane of focus is sharp, 1/f = 1/focus + 1/film distance; given the field of view instead
    of the focal length, the film distance follows from the film's size.
    """
    width, height = film.size_m()
    focus = camera.plane_m
    if camera.focal_length_mm is not None:
        focal_length = camera.focal_length_mm * 1e-3
        distance = 1 / (1 / focal_length - 1 / focus)
        return width / 2 / distance, height / 2 / distance, focal_length
    assert camera.fov_degrees is not None
    across, down = half_tangents(camera.fov_degrees, camera.fov_axis, film)
    distance = width / 2 / across
    return across, down, 1 / (1 / distance + 1 / focus)


def radius_of(camera: ThinLensCamera, focal_length_m: float) -> float:
    """Return the radius of the opening [m]."""
    if camera.aperture_radius_m is not None:
        return camera.aperture_radius_m
    assert camera.f_number is not None
    return focal_length_m / camera.f_number / 2


def build(scene: Scene) -> CameraModel:
    """Return the camera for the device.

    Its film is lit evenly: every pixel has the irradiance that its light would have on the axis.
    """
    camera = scene.camera
    assert isinstance(camera, ThinLensCamera)
    return model_of(scene, camera)


def model_of(scene: Scene, camera: ThinLensCamera) -> CameraModel:
    """Return the camera of a scene set in some other way than the scene says."""
    across, down, focal_length = optics_of(camera, scene.film)
    radius = radius_of(camera, focal_length)
    record = camera_record(
        camera, scene.film, "thin_lens",
        half_width=across, half_height=down, focus_distance=camera.plane_m, aperture_radius=radius,
    )  # fmt: skip
    tables, facts = aperture_tables(scene, camera.aperture)
    film_distance = scene.film.size_m()[0] / 2 / across
    shape = stop_shape(scene, camera.aperture)
    on_axis = opening_irradiance(shape, radius, film_distance) if radius else None
    facts |= place_film(record, scene, film_distance * 1e3)
    metadata = movements_metadata(camera) | {
        "camera": "thin_lens",
        "focal_length_mm": focal_length * 1e3,
        "f_number": focal_length / (2 * radius) if radius else math.inf,
        "focus_distance_m": camera.plane_m,
        "on_axis_irradiance": on_axis,
        "intrinsics": intrinsics(scene, (0.5 / across, 0.5 / down)),
        "entrance_pupil": EntrancePupil(diameter_mm=2e3 * radius).described(),
    }
    pixels_per_tangent = math.sqrt(scene.film.resolution[0] / across * scene.film.resolution[1] / down) / 2
    view = CameraView(
        pupil_radius_m=radius,
        blur=lambda: _blur(scene, 2 * radius * pixels_per_tangent, 1 / camera.plane_m, film_distance),
    )
    return CameraModel(
        "camera/thin_lens.h",
        record,
        facts=facts,
        tables=tables,
        metadata=metadata,
        view=view,
        on_axis_irradiance=on_axis,
        reach=thin_lens_reach(radius, camera.plane_m, (across, down), shape) if radius else None,
    )


def _blur(scene: Scene, gain: float, focus: float, film_distance_m: float) -> Blur:
    """Return the circle of confusion: a film point farther back has its plane of focus nearer, and a longer lever."""
    nearer = 1.0 + film_depths(scene) * 1e-3 / film_distance_m
    return perfect_blur(gain * nearer, focus + (1.0 - 1.0 / nearer) / film_distance_m)
