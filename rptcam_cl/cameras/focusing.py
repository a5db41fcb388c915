"""Focusing a lens on an object plane: by moving the whole lens, or the group of surfaces that moves for it."""

from __future__ import annotations

from typing import Literal

import numpy as np

from rptcam_cl.errors import InputError
from rptcam_cl.optics import Lens
from rptcam_cl.optics.best_focus import best_film_distance, best_film_distance_at
from rptcam_cl.optics.focus import film_distance
from rptcam_cl.optics.variable import floated, focused_by_group

Method = Literal["thick", "spot"]
Side = Literal["film", "front"]
FilmPoint = tuple[float, float] | None

ROUNDS = 30  # of the searches below, which need three to six
SETTLED = 1e-8  # of a distance, between two rounds
SETTLED_AT_A_POINT = 1e-5  # the same for a spot off the axis, found to a millionth


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
        Where that spot lies on the film, x and y in the frame of the lens; on the axis when absent.

    Raises
    ------
    InputError
        When the distance is out of reach; the nearest possible is named.
    """
    if lens.floating:
        lens = _floated(lens, distance_mm, measured_from, wavelength_nm)
    if lens.focusing is None:
        return lens, _film_distance(lens, distance_mm, measured_from, method, wavelength_nm, film_point_mm)
    film = film_distance(lens, np.inf, wavelength_nm=wavelength_nm)
    if measured_from == "film":
        return _by_group(lens, distance_mm, film, method, wavelength_nm, film_point_mm)
    settled = SETTLED if film_point_mm is None else SETTLED_AT_A_POINT
    whole = distance_mm + lens.length + lens.sense * film
    for _ in range(ROUNDS):
        state, back = _by_group(lens, whole, film, method, wavelength_nm, film_point_mm)
        new = distance_mm + state.length + state.sense * back  # the first vertex may belong to the group
        if abs(new - whole) <= settled * whole:
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
        if abs(new.length - state.length) <= SETTLED * lens.length:
            return new
        state = new
    return state


def _film_distance(
    lens: Lens, distance_mm: float, measured_from: Side, method: Method, wavelength_nm: float, film_point_mm: FilmPoint
) -> float:
    if method == "spot" and film_point_mm is not None:
        return best_film_distance_at(lens, film_point_mm, distance_mm, measured_from, wavelength_nm)
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
        if abs(error) <= (SETTLED if film_point_mm is None else SETTLED_AT_A_POINT) * film_mm:
            return state, image + offset
        slope = (error - error_before) / (offset - before) if offset != before else -1.0
        offset, before, error_before = offset - error / slope, offset, error
    raise InputError(f"{lens.name}: its group finds no least spot for {distance_mm:g} mm from the film")
