"""The cross-section of a camera as lines to draw, in millimetres of the frame of its lens: z to the film, height."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.lenstools import blades, glass, lines, obstruction
from rptcam_cl.scene import EnvironmentCamera, Scene, ThinLensCamera
from rptcam_cl.viewfinder.depth_of_field import perspective
from rptcam_cl.viewfinder.lens_state import LensState
from rptcam_cl.viewfinder.panel import focal_length_mm

Array = NDArray[np.float64]

EVERY = 4  # of the points of an outline
CORNER = 0.15  # turn of an outline that is a corner [radians]
DIGITS = 3
APPROACH = 0.35  # of the axis drawn before the lens, in its size
IDEAL_BLADE = 1.6  # radius of an ideal opening's screen over its own


def lens_section(state: LensState) -> dict[str, Any]:
    """Return surfaces, glass, stop, pupils, film and axis of a lens."""
    lens, wavelength_nm = state.lens, state.setting.camera.wavelength_nm
    first = lens.first_order(wavelength_nm)
    surfaces = []
    for k, surface in enumerate(lens.surfaces):
        block = obstruction(lens, k, "y")
        if block is not None:
            surfaces.append({"surface": k, "points": _plain(block), "kind": "obstruction"})
        elif not (surface.is_stop and surface.is_sphere and not surface.curvature):
            kind = "mirror" if surface.is_mirror else "glass"
            surfaces += [{"surface": k, "points": _plain(line), "kind": kind} for line in lines(lens, k, "y")]
    half_mm = state.scene.film.diagonal_m() * 500
    pupils = {
        "entrance": _pupil(first.entrance_pupil.distance_mm, first.entrance_pupil.diameter_mm),
        "exit": _pupil(lens.length + lens.sense * first.exit_pupil.distance_mm, first.exit_pupil.diameter_mm),
    }
    return {
        "kind": state.scene.camera.kind,
        "name": lens.name,
        "surfaces": surfaces,
        "glass": [
            {"index": round(index, 4), "points": _plain(outline)} for index, outline in glass(lens, "y", wavelength_nm)
        ],
        "stop": [{"surface": lens.stop_index, "points": _plain(blade)} for blade in blades(lens, "y")],
        "film": {"points": [[_round(state.film_z), _round(h)] for h in (-half_mm, half_mm)]},
        "pupils": pupils,
        "axis": [_round(-APPROACH * state.size_mm), _round(max(state.film_z, lens.length))],
    }  # fmt: skip


def _pupil(z_mm: float, diameter_mm: float) -> dict[str, float] | None:
    """Return a pupil; None where it lies infinitely far away."""
    if not (math.isfinite(z_mm) and math.isfinite(diameter_mm)):
        return None
    return {"z_mm": _round(z_mm), "radius_mm": _round(diameter_mm / 2)}


def ideal_section(scene: Scene) -> dict[str, Any]:
    """Return opening, film and axis of a camera without a lens of glass: the opening is at z = 0."""
    camera, kind = scene.camera, scene.camera.kind
    empty: dict[str, Any] = {"kind": kind, "name": kind.replace("_", " "), "surfaces": [], "glass": [], "stop": []}
    if isinstance(camera, EnvironmentCamera):
        return empty | {"film": None, "pupils": {"entrance": None, "exit": None}, "axis": [0.0, 0.0]}
    radius, film_z = ideal_opening(scene)
    half_mm = scene.film.diagonal_m() * 500
    screen = max(IDEAL_BLADE * radius, 0.25 * half_mm)
    pupil = _pupil(0.0, 2 * radius)
    sides = [[[0.0, side * _round(radius)], [0.0, side * _round(screen)]] for side in (1, -1)]
    return empty | {
        "stop": [{"surface": None, "points": points} for points in sides],
        "film": {"points": [[_round(film_z), _round(h)] for h in (-half_mm, half_mm)]},
        "pupils": {"entrance": pupil, "exit": pupil},
        "axis": [_round(-film_z), _round(film_z)],
    }  # fmt: skip


def ideal_opening(scene: Scene) -> tuple[float, float]:
    """Return the radius of an ideal camera's opening and how far behind it the film lies [mm]."""
    if isinstance(scene.camera, ThinLensCamera):
        found = perspective(scene)
        if found is not None:
            return found.diameter_mm / 2, found.per_tangent_mm
    return 0.0, focal_length_mm(scene) or 0.0


def _plain(points: Array) -> list[list[float]]:
    """Return points (m, 2) as rounded numbers: every few of a curve, its ends and its corners."""
    kept = np.zeros(len(points), bool)
    kept[::EVERY] = kept[-1] = True
    steps = np.diff(points, axis=0)
    along = np.arctan2(steps[:, 1], steps[:, 0])
    turn = np.abs(np.angle(np.exp(1j * np.diff(along))))
    kept[1:-1] |= turn > CORNER
    rounded: list[list[float]] = np.round(points[kept], DIGITS).tolist()
    return rounded


def _round(value: float) -> float:
    return round(float(value), DIGITS)
