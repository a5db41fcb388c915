"""The lens of a camera as its scene sets it: zoomed, stopped down and focused."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rptcam_cl.cameras.focusing import focused
from rptcam_cl.cameras.transmission import as_coated, transmission_of
from rptcam_cl.errors import InputError
from rptcam_cl.optics import Lens
from rptcam_cl.optics.focus import film_distance, object_distance
from rptcam_cl.optics.transmission import Transmission
from rptcam_cl.optics.variable import configured, film_behind, moved, zoomed
from rptcam_cl.scene.camera import NOT_FOUND_YET, LensCamera
from rptcam_cl.scene.scene import Scene


@dataclass(frozen=True)
class LensSetting:
    """A lens in use.

    Attributes
    ----------
    lens : Lens
        Zoomed, stopped down, and with its focusing group in place.
    film_distance_mm : float
        Last vertex to film.
    focus_distance_mm : float or None
        Object plane in focus to film; None when the film stands where no object is sharp.
    camera : LensCamera
        What was asked for.
    """

    lens: Lens
    film_distance_mm: float
    focus_distance_mm: float | None
    camera: LensCamera

    @property
    def gain(self) -> float:
        """Irradiance over that of the same rays in one medium: what a ray keeps is radiance over the squared index."""
        indices = self.lens.indices(self.camera.wavelength_nm)
        return float(indices[-1] / indices[0]) ** 2

    @property
    def transmission(self) -> Transmission:
        """Losses in the lens that count."""
        return transmission_of(self.camera)

    @property
    def metadata(self) -> dict[str, Any]:
        """What the picture's metadata should say."""
        first = self.lens.first_order(self.camera.wavelength_nm)
        focus = self.camera.focus
        sought = focus.film_distance_mm is None and focus.group_shift_mm is None
        return {
            "lens": self.lens.name,
            "zoom": self.camera.zoom,
            "focal_length_mm": _finite(first.focal_length_mm),
            "f_number": _finite(first.f_number),
            "film_distance_mm": self.film_distance_mm,
            "focus_distance_m": None if self.focus_distance_mm is None else self.focus_distance_mm * 1e-3,
            "focus_method": focus.method if sought else None,
            "focus_field": None if focus.field is None else list(focus.field),
            "focused_by": ("whole lens" if self.lens.focusing is None else "group") if sought else None,
            "wavelength_nm": self.camera.wavelength_nm,
        }


def _finite(value: float) -> float | None:
    """Return a number, or None for the infinite focal length of a lens without power."""
    return value if np.isfinite(value) else None


def lens_setting(scene: Scene) -> LensSetting:
    """Return the lens of a scene's camera in use.

    Raises
    ------
    InputError
        When it cannot be zoomed, stopped down or focused as asked.
    """
    camera = scene.camera
    assert isinstance(camera, LensCamera)
    lens, focus = lens_to_focus(scene, camera), camera.focus
    if focus.film_distance_mm is not None:
        return LensSetting(lens, focus.film_distance_mm, _sharp_at(lens, focus.film_distance_mm, camera), camera)
    if focus.group_shift_mm is not None:
        return _at_shift(lens, focus.group_shift_mm, camera)
    if focus.auto is not None:
        raise InputError(NOT_FOUND_YET)
    if focus.front_distance_m is not None:
        front_mm = focus.front_distance_m * 1e3
        lens, back_mm = focused(lens, front_mm, "front", focus.method, camera.wavelength_nm, _sharpest(scene, camera))
        return LensSetting(lens, back_mm, front_mm + lens.length + lens.sense * back_mm, camera)
    if focus.point is not None:
        distance_mm = camera.ahead(focus.point) * scene.metres_per_unit * 1e3
    else:
        assert focus.distance_m is not None
        distance_mm = focus.distance_m * 1e3
    lens, back_mm = focused(lens, distance_mm, "film", focus.method, camera.wavelength_nm, _sharpest(scene, camera))
    return LensSetting(lens, back_mm, distance_mm, camera)


def _sharpest(scene: Scene, camera: LensCamera) -> tuple[float, float] | None:
    """Return where on the film the picture is to be sharpest [mm]; None for the axis."""
    return None if camera.focus.field is None else film_point(scene, camera, *camera.focus.field)


def film_point(scene: Scene, camera: LensCamera, right: float, down: float) -> tuple[float, float]:
    """Return where on the film a point of the picture lies [mm], in the frame of the lens.

    A lens inverts: right and up in an upright picture are left and down on the film.

    Parameters
    ----------
    right, down
        Fractions of the picture from its left and top edges.
    """
    width_mm, height_mm = (side * 1e3 for side in scene.film.size_m())
    sense = -1.0 if camera.flip else 1.0
    return sense * (right - 0.5) * width_mm, sense * (0.5 - down) * height_mm


def lens_to_focus(scene: Scene, camera: LensCamera) -> Lens:
    """Return the lens at its focal length and working aperture."""
    lens = as_coated(scene.load_lens(), camera)
    if camera.zoom is not None:
        lens = configured(lens, camera.zoom)
    if camera.focal_length_mm is not None:
        lens = zoomed(lens, camera.focal_length_mm, camera.wavelength_nm)
    if camera.f_number is not None:
        return lens.with_stop_diameter(lens.stop_diameter_for(camera.f_number, camera.wavelength_nm))
    if camera.stop_diameter_mm is not None:
        return lens.with_stop_diameter(camera.stop_diameter_mm)
    return lens


def _at_shift(lens: Lens, shift_mm: float, camera: LensCamera) -> LensSetting:
    if lens.focusing is None:
        raise InputError(f"camera.focus.group_shift_mm: {lens.name}: has no focusing group (allowed: film_distance_mm)")
    low, high = lens.focusing.travel_mm
    if not low <= shift_mm <= high:
        raise InputError(
            f"camera.focus.group_shift_mm: beyond the travel of the group (got {shift_mm:g};"
            f" allowed: {low:g} to {high:g})"
        )
    infinity_mm = film_distance(lens, np.inf, wavelength_nm=camera.wavelength_nm)
    state, back_mm = moved(lens, shift_mm), film_behind(lens, shift_mm, infinity_mm)
    return LensSetting(state, back_mm, _sharp_at(state, back_mm, camera), camera)


def _sharp_at(lens: Lens, back_mm: float, camera: LensCamera) -> float | None:
    try:
        return object_distance(lens, back_mm, camera.wavelength_nm)
    except InputError:  # the film lies where no object images: legal, just never sharp
        return None
