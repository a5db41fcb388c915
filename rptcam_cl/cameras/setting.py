"""The lens of a camera as its scene sets it: zoomed, stopped down and focused."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from rptcam_cl.cameras.as_made import DESIGN, RealState, real_state
from rptcam_cl.cameras.lens_losses import as_coated, transmission_of
from rptcam_cl.cameras.movements import film_frame
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import (
    Lens,
    LensTransmission,
    at_position,
    best_film_distance,
    best_film_distance_at,
    film_behind,
    film_distance,
    floated,
    focused_by_group,
    moved,
    object_distance,
    travel_mm,
)
from rptcam_cl.scene import NOT_FOUND_YET, LensCamera, Pose, Scene, at_opening

Method = Literal["thick", "spot"]
Side = Literal["film", "front"]
FilmPoint = tuple[float, float, float] | None

ROUNDS = 30  # of the searches below, which need three to six
CONVERGED = 1e-8  # of a distance, between two rounds
CONVERGED_AT_A_POINT = 1e-5  # the same for a spot off the axis, found to a millionth


def focused(
    lens: Lens,
    distance_mm: float,
    measured_from: Side,
    method: Method,
    wavelength_nm: float,
    film_point_mm: FilmPoint = None,
) -> tuple[Lens, float]:
    """Return the lens focused on an object plane, and the distance from its last vertex to the film [mm].

    Parameters
    ----------
    lens
        At its working aperture.
    distance_mm
        From the object plane to the film or to the first vertex.
    method
        ``thick``: by first-order optics. ``spot``: by the least rms spot of traced rays.
    film_point_mm
        Where that spot lies on the film: x and y in the frame of the lens, and how far behind the film distance; on the
        axis when absent.

    Raises
    ------
    InputError
        When the distance is out of reach; the nearest possible is named.
    """
    if lens.floating and not lens.focuses_by_group:
        lens = _floated(lens, distance_mm, measured_from, wavelength_nm)
    if not lens.focuses_by_group:
        return lens, _film_distance(lens, distance_mm, measured_from, method, wavelength_nm, film_point_mm)
    film = film_distance(lens, np.inf, wavelength_nm=wavelength_nm)
    if measured_from == "film":
        return _by_group(lens, distance_mm, film, method, wavelength_nm, film_point_mm)
    converged = CONVERGED if film_point_mm is None else CONVERGED_AT_A_POINT
    whole = distance_mm + lens.length + lens.sense * film
    for _ in range(ROUNDS):
        state, back = _by_group(lens, whole, film, method, wavelength_nm, film_point_mm)
        new = distance_mm + state.length + state.sense * back  # the first vertex may belong to the group
        if abs(new - whole) <= converged * whole:
            return state, back
        whole = new
    raise InputError(f"{lens.name}: its group finds no focus {distance_mm:g} mm in front of the first surface")


def _floated(lens: Lens, distance_mm: float, measured_from: Side, wavelength_nm: float) -> Lens:
    """Return the lens with its floating groups set for an object plane."""
    if measured_from == "film":
        return floated(lens, distance_mm)
    state = lens
    for _ in range(ROUNDS):  # the state decides how far the film is, which decides the state
        film = film_distance(state, distance_mm, "front", wavelength_nm)
        new = floated(lens, distance_mm + state.length + film)
        if abs(new.length - state.length) <= CONVERGED * lens.length:
            return new
        state = new
    return state


def _film_distance(
    lens: Lens, distance_mm: float, measured_from: Side, method: Method, wavelength_nm: float, film_point_mm: FilmPoint
) -> float:
    if method == "spot" and film_point_mm is not None:
        x, y, depth = film_point_mm
        there = distance_mm + depth if measured_from == "film" else distance_mm
        return best_film_distance_at(lens, (x, y), there, measured_from, wavelength_nm) - depth
    if method == "spot":
        return best_film_distance(lens, distance_mm, measured_from, (wavelength_nm,))
    return film_distance(lens, distance_mm, measured_from, wavelength_nm)


def _by_group(
    lens: Lens, distance_mm: float, film_mm: float, method: Method, wavelength_nm: float, film_point_mm: FilmPoint
) -> tuple[Lens, float]:
    """Return the lens with its group moved, for a film that stays, and the film distance [mm].

    The least spot lies at an offset from the first-order image. So the group is focused by first-order optics for a
    film displaced by an offset the other way; a secant search finds the offset that is that of the lens so moved.
    """
    offset = before = error_before = 0.0
    for _ in range(ROUNDS):
        state, image = focused_by_group(lens, distance_mm - offset, film_mm - offset, wavelength_nm)
        if method == "thick":
            return state, image
        front = distance_mm - offset - state.length - state.sense * image
        error = _film_distance(state, front, "front", method, wavelength_nm, film_point_mm) - image - offset
        if abs(error) <= (CONVERGED if film_point_mm is None else CONVERGED_AT_A_POINT) * film_mm:
            return state, image + offset
        slope = (error - error_before) / (offset - before) if offset != before else -1.0
        offset, before, error_before = offset - error / slope, offset, error
    raise InputError(f"{lens.name}: its group finds no least spot for {distance_mm:g} mm from the film")


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
        The request.
    real : RealState
        How the lens differs from its design.
    """

    lens: Lens
    film_distance_mm: float
    focus_distance_mm: float | None
    camera: LensCamera
    real: RealState = DESIGN

    @property
    def gain(self) -> float:
        """Irradiance over that of the same rays in one medium: what a ray keeps is radiance over the squared index."""
        indices = self.lens.indices(self.camera.wavelength_nm)
        return float(indices[-1] / indices[0]) ** 2

    @property
    def transmission(self) -> LensTransmission:
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
            "focused_by": ("group" if self.lens.focuses_by_group else "whole lens") if sought else None,
            "wavelength_nm": self.camera.wavelength_nm,
            **self.real.metadata,
        }


def _finite(value: float) -> float | None:
    """Return a number, or None for the infinite focal length of a lens without power."""
    return value if np.isfinite(value) else None


def lens_setting(scene: Scene) -> LensSetting:
    """Return the lens of a scene's camera in use.

    Raises
    ------
    InputError
        When it cannot be zoomed, stopped down or focused as requested.
    """
    if isinstance(scene.camera, LensCamera) and scene.camera.focus.object is not None:
        scene = at_opening(scene)
    camera = scene.camera
    assert isinstance(camera, LensCamera)
    lens, focus, real = design_to_focus(scene, camera), camera.focus, real_state(scene)
    if focus.film_distance_mm is not None:
        lens, back_mm = real.lens(lens), focus.film_distance_mm
        return LensSetting(lens, back_mm, _sharp_at(lens, back_mm, camera), camera, real)
    if focus.group_shift_mm is not None:
        return _at_shift(lens, focus.group_shift_mm, camera, real)
    if focus.auto is not None:
        raise InputError(NOT_FOUND_YET)
    if focus.front_distance_m is not None:
        front_mm = focus.front_distance_m * 1e3
        lens, back_mm = focused(lens, front_mm, "front", focus.method, camera.wavelength_nm, _sharpest(scene, camera))
        distance_mm = front_mm + lens.length + lens.sense * back_mm
        return LensSetting(real.lens(lens), real.film(back_mm), distance_mm, camera, real)
    if focus.point is not None:
        distance_mm = camera.ahead(focus.point) * scene.metres_per_unit * 1e3
    else:
        assert focus.distance_m is not None
        distance_mm = focus.distance_m * 1e3
    lens, back_mm = focused(lens, distance_mm, "film", focus.method, camera.wavelength_nm, _sharpest(scene, camera))
    return LensSetting(real.lens(lens), real.film(back_mm), distance_mm, camera, real)


def _sharpest(scene: Scene, camera: LensCamera) -> FilmPoint:
    """Return where on the film the picture is to be sharpest [mm]; None for the axis."""
    return None if camera.focus.field is None else film_point(scene, camera, *camera.focus.field)


def film_point(scene: Scene, camera: Pose, right: float, down: float) -> tuple[float, float, float]:
    """Return where on the film a point of the picture lies [mm]: x, y in the frame of the lens, depth behind the film
    distance.

    A lens inverts: right and up in an upright picture are left and down on the film.

    Parameters
    ----------
    right, down
        Fractions of the picture from its left and top edges.
    """
    width_mm, height_mm = (side * 1e3 for side in scene.film.size_m())
    sense = -1.0 if camera.flip else 1.0
    film = np.array([sense * (right - 0.5) * width_mm, sense * (0.5 - down) * height_mm])
    x, y, depth = film_frame(camera).points(film).tolist()
    return x, y, depth


def lens_to_focus(scene: Scene, camera: LensCamera) -> Lens:
    """Return the lens as it really is, at its focal length and working aperture."""
    return real_state(scene).lens(design_to_focus(scene, camera))


def film_for_infinity(scene: Scene, camera: LensCamera) -> float:
    """Return the distance from the last vertex to a film that stays where the scale says infinity [mm]."""
    design = design_to_focus(scene, camera)
    return real_state(scene).film(film_distance(design, np.inf, wavelength_nm=camera.wavelength_nm))


def design_to_focus(scene: Scene, camera: LensCamera) -> Lens:
    """Return the design of the lens at its focal length and working aperture."""
    lens = as_coated(scene.load_lens(), camera)
    lens = at_position(lens, camera.zoom, camera.focal_length_mm, camera.wavelength_nm)
    if camera.f_number is not None:
        return lens.with_stop_diameter(lens.stop_diameter_for(camera.f_number, camera.wavelength_nm))
    if camera.stop_diameter_mm is not None:
        return lens.with_stop_diameter(camera.stop_diameter_mm)
    return lens


def _at_shift(lens: Lens, shift_mm: float, camera: LensCamera, real: RealState) -> LensSetting:
    if not lens.focuses_by_group:
        raise InputError(f"camera.focus.group_shift_mm: {lens.name}: has no focusing group (allowed: film_distance_mm)")
    low, high = travel_mm(lens)
    if not low <= shift_mm <= high:
        raise InputError(
            f"camera.focus.group_shift_mm: beyond the travel of the group (got {shift_mm:g};"
            f" allowed: {low:g} to {high:g})"
        )
    infinity_mm = real.film(film_distance(lens, np.inf, wavelength_nm=camera.wavelength_nm))
    state, back_mm = moved(real.lens(lens), shift_mm), film_behind(lens, shift_mm, infinity_mm)
    return LensSetting(state, back_mm, _sharp_at(state, back_mm, camera), camera, real)


def _sharp_at(lens: Lens, back_mm: float, camera: LensCamera) -> float | None:
    try:
        return object_distance(lens, back_mm, camera.wavelength_nm)
    except InputError:  # the film lies where no object images: legal, just never sharp
        return None
