"""Rays from the pixel under the pointer: the fan through the section, the spot and the transfer of its light.

The device traces them, by the kernel that traces given rays. They lie in the plane of the axis and the film point, in
which heights are counted; of a lens that is not the same from every side, in its y-z plane.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rptcam_cl.cameras import film_frame, film_point, thick_lens_of
from rptcam_cl.lenstools import FilmSpot, field_mtf, wavelength_colour
from rptcam_cl.optics import FilmProbe, Rays, Status, narrowed
from rptcam_cl.scene import LensCamera, Scene
from rptcam_cl.viewfinder.depth_of_field import perspective
from rptcam_cl.viewfinder.lens_section import APPROACH, ideal_opening
from rptcam_cl.viewfinder.lens_state import LINES_NM, Array, LensState

FAN = 9  # rays of each wavelength that pass
BEYOND = 3  # and on each side, as far as there is glass, that do not
LINE = 145  # rays that find out which pass
SCOUTS = (40, 40)
ACROSS = 24  # rays that span the beam of the spot each way
DOTS = 120  # of each wavelength that are drawn
FREQUENCIES = np.arange(0.0, 101.0, 5.0)  # [cycles/mm]
CENTRED_MM = 1e-6


def pointer_rays(state: LensState, x: float, y: float) -> dict[str, Any]:
    """Return fan, spot and transfer of a point of the picture, in fractions from its left and top."""
    camera = state.scene.camera
    assert isinstance(camera, LensCamera)
    *place, depth = film_point(state.scene, camera, x, y)
    start = np.array([*place, state.film_z + state.lens.sense * depth])
    across = _section(state, start)
    probe = FilmProbe(state.lens, state.setting.film_distance_mm, camera.wavelength_nm, film_frame(camera))
    film = start[None, :2]
    window = probe.windows(film)
    boxes, found = narrowed(probe, film, window, SCOUTS)
    passes = bool(found[0])
    rays = _fan(state, start, across, boxes[0] if passes else window[0], window[0])
    result = {"x": x, "y": y, "film_mm": [round(float(value), 4) for value in start[:2]], "rays": rays}
    return result | (_beam(state, start, across, boxes[0]) if passes else _NO_LIGHT)


_NO_LIGHT: dict[str, Any] = {"field_degrees": None, "spot": None, "mtf": None}


def _section(state: LensState, start: Array) -> Array:
    """Return the unit vector of heights on the film."""
    radius = float(np.hypot(*start[:2]))
    if radius < CENTRED_MM or not state.lens.is_rotational:
        return np.array([0.0, 1.0])
    away = start[:2] / radius
    return away if away[1] >= 0 else -away


def _fan(state: LensState, start: Array, across: Array, box: Array, window: Array) -> list[dict[str, Any]]:
    """Return the rays of every wavelength, evenly over what passes and on beyond it."""
    foot = np.array([box[0] + box[1], box[2] + box[3]]) / 2
    heights = _heights(state, start, across, foot, window)
    targets = np.column_stack([foot + heights[:, None] * across, np.full(len(heights), state.lens.length)])
    wavelengths = np.repeat(state.wavelengths_nm, len(heights))
    vectors = np.tile(targets - start, (len(state.wavelengths_nm), 1))
    points = np.broadcast_to(start, vectors.shape).copy()
    corners, rays = state.from_film.paths(points, vectors, wavelengths)
    return [_drawn(state, corners[:, ray], rays, ray, across, float(wavelengths[ray])) for ray in range(len(points))]


def _heights(state: LensState, start: Array, across: Array, foot: Array, window: Array) -> Array:
    """Return where the fan meets the plane of the last vertex: heights about a point of it.

    They step evenly over what passes, by the device's own judgement, and on beyond it as far as there is glass.
    """
    w0, w1, t0, t1 = window
    reach = float(np.abs(across) @ [w1 - w0, t1 - t0]) / 2
    middle = float(across @ (foot - np.array([w0 + w1, t0 + t1]) / 2))
    line = np.linspace(-reach - middle, reach - middle, LINE)
    targets = np.column_stack([foot + line[:, None] * across, np.full(LINE, state.lens.length)])
    points = np.broadcast_to(start, targets.shape).copy()
    rays = state.from_film.trace(points, targets - start, np.full(LINE, state.setting.camera.wavelength_nm))
    passed = np.flatnonzero(rays.passed)
    if len(passed) < 2:
        return np.asarray(line[:: LINE // FAN])
    if state.lens.is_obstructed:  # even steps would mostly end at the obstruction
        stopped = np.flatnonzero(~rays.passed)
        few = (passed[np.linspace(0, len(passed) - 1, FAN).astype(int)], stopped[:: max(1, len(stopped) // BEYOND)])
        return np.asarray(line[np.sort(np.concatenate(few))])
    low, high = line[passed[0]], line[passed[-1]]
    step = (high - low) / (FAN - 1)
    below, above = (int(min(BEYOND, room // step)) for room in (low - line[0], line[-1] - high))
    return np.asarray(low + step * np.arange(-below, FAN + above))


def _drawn(
    state: LensState, corners: Array, rays: Rays, ray: int, across: Array, wavelength_nm: float
) -> dict[str, Any]:
    """Return a ray as drawn, from the film to before the lens, or to where it was stopped."""
    status, surface = Status(int(rays.status[ray])), int(rays.surface[ray])
    direction, lens = rays.directions[ray], state.lens
    if status == Status.ok:
        ahead = min(APPROACH * state.size_mm, state.object_mm)
        line = np.concatenate([corners, corners[-1:] + ahead * direction])
    else:
        line = corners[: len(lens.surfaces) - surface + 1]
        if status == Status.missed and direction[2]:
            step = (lens.vertices[surface] - line[-1, 2]) / direction[2]
            line = np.concatenate([line[:-1], line[-1:] + max(float(step), 0.0) * direction])
    points = np.column_stack([line[:, 2], line[:, :2] @ across])
    return {
        "points": np.round(points, 4).tolist(),
        "wavelength_nm": round(wavelength_nm, 2),
        "colour": wavelength_colour(wavelength_nm),
        "passed": status == Status.ok,
        "stopped_by": None if status == Status.ok else surface,
        "why": None if status == Status.ok else status.name.replace("_", " "),
    }


def _beam(state: LensState, start: Array, across: Array, box: Array) -> dict[str, Any]:
    """Return the angle of the beam of a film point in the scene, and the spot of the object point that it shows."""
    rays = _scouts(state, start, box)
    good = rays.passed
    if good.sum() < 4:
        return _NO_LIGHT
    origins, directions = rays.origins[good], rays.directions[good]
    entrance = origins - directions * (origins[:, 2:] / directions[:, 2:])
    mean = directions.mean(axis=0)
    angle = float(np.degrees(np.arctan2(np.hypot(*mean[:2]), -mean[2])))
    spots = _spots(state, entrance, mean, across)
    return {"field_degrees": round(angle, 3), "spot": _spot(spots), "mtf": _mtf(spots)}


def _scouts(state: LensState, start: Array, box: Array) -> Rays:
    """Return rays from a film point over the box that holds its beam."""
    u, v = (np.linspace(low, high, ACROSS) for low, high in (box[:2], box[2:]))
    targets = np.column_stack([*(axis.ravel() for axis in np.meshgrid(u, v)), np.full(ACROSS**2, state.lens.length)])
    points = np.broadcast_to(start, targets.shape).copy()
    return state.from_film.trace(points, targets - start, np.full(len(targets), state.setting.camera.wavelength_nm))


def _spots(state: LensState, entrance: Array, mean: Array, across: Array) -> list[FilmSpot]:
    """Return the spots of each wavelength: rays of one object point, spread over the plane of the first vertex.

    Their axes are sagittal and tangential: across the plane of the section, and in it.
    """
    (u0, v0), (u1, v1) = entrance[:, :2].min(axis=0), entrance[:, :2].max(axis=0)
    margin = np.array([u1 - u0, v1 - v0]) / ACROSS
    u, v = (np.linspace(low - gap, high + gap, ACROSS) for low, high, gap in ((u0, u1, margin[0]), (v0, v1, margin[1])))
    grid = np.column_stack([*(axis.ravel() for axis in np.meshgrid(u, v)), np.zeros(ACROSS**2)])
    along = -mean / np.linalg.norm(mean)
    if np.isinf(state.object_mm):
        vectors = np.broadcast_to(along, grid.shape)
    else:
        source = entrance.mean(axis=0) - along * state.object_mm / along[2]
        vectors = grid - source
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    back = (
        np.full_like(lengths, 2 * state.size_mm)
        if np.isinf(state.object_mm)
        else np.minimum(2 * state.size_mm, lengths)
    )
    origins = grid - vectors / lengths * back
    count, axes = len(state.wavelengths_nm), np.stack([[across[1], -across[0]], across], axis=1)
    wavelengths = np.repeat(state.wavelengths_nm, len(grid))
    rays = state.from_scene.trace(np.tile(origins, (count, 1)), np.tile(vectors, (count, 1)), wavelengths)
    good = rays.passed
    step = (state.film_z - rays.origins[:, 2:]) / np.where(good[:, None], rays.directions[:, 2:], 1.0)
    film = (rays.origins[:, :2] + rays.directions[:, :2] * step) @ axes
    turned = rays.directions[:, :2] @ axes
    spots = []
    for wavelength in state.wavelengths_nm:
        rows = good & (wavelengths == wavelength)
        index = float(state.lens.indices(wavelength)[-1])
        cone = 2.0 * index * np.std(turned[rows], axis=0) if rows.any() else np.zeros(2)
        spots.append(FilmSpot(0.0, wavelength, film[rows], (float(cone[0]), float(cone[1]))))
    return spots


def _spot(spots: list[FilmSpot]) -> dict[str, Any] | None:
    """Return the dots [µm] about their centroid, sagittal and tangential, and their root mean square radius."""
    together = np.concatenate([spot.points for spot in spots])
    if not len(together):
        return None
    centroid = together.mean(axis=0)
    dots, colours = [], []
    for spot in spots:
        few = spot.points[:: max(1, len(spot.points) // DOTS)]
        dots.append(np.round((few - centroid) * 1e3, 2))
        colours += [wavelength_colour(spot.wavelength_nm)] * len(few)
    square = np.mean(np.square((together - centroid) * 1e3), axis=0)
    return {
        "points_um": np.concatenate(dots).tolist(),
        "colours": colours,
        "rms_um": float(np.sqrt(square.sum())),
        "rms_sagittal_um": float(np.sqrt(square[0])),
        "rms_tangential_um": float(np.sqrt(square[1])),
        "rays": len(together),
    }


def _mtf(spots: list[FilmSpot]) -> dict[str, Any] | None:
    """Return the modulation by frequency [cycles/mm], tangential and sagittal, and the limits of diffraction."""
    curves = field_mtf([spot for spot in spots if len(spot.points)], FREQUENCIES) if _lit(spots) else None
    if curves is None:
        return None
    names = ("tangential", "sagittal", "tangential_limit", "sagittal_limit")
    plain = {name: np.round(curve, 4).tolist() for name, curve in zip(names, curves, strict=True)}
    return {"frequencies": FREQUENCIES.tolist()} | plain


def _lit(spots: list[FilmSpot]) -> bool:
    return any(len(spot.points) for spot in spots)


def thick_rays(state: LensState, x: float, y: float) -> dict[str, Any]:
    """Return the rays of a thick lens: straight lines between film, lens and scene, through points of its pupil."""
    camera = state.scene.camera
    assert isinstance(camera, LensCamera)
    film = np.array(film_point(state.scene, camera, x, y)[:2])
    across = _section(state, np.array([*film, 0.0]))
    height = float(film @ across)
    thick = thick_lens_of(state.setting.lens, state.setting.film_distance_mm, camera.wavelength_nm)
    ahead = min(APPROACH * state.size_mm, state.object_mm)
    lines = []
    for pupil in np.linspace(-1.0, 1.0, FAN).tolist():
        behind = height - (thick.film_slope[0] * height + thick.film_slope[1] * pupil) * state.setting.film_distance_mm
        before = thick.height[0] * height + thick.height[1] * pupil
        slope = thick.slope[0] * height + thick.slope[1] * pupil
        lines.append(
            [[state.film_z, height], [state.lens.length, behind], [0.0, before], [-ahead, before + slope * ahead]]
        )
    angle = float(np.degrees(np.arctan(abs(thick.slope[0] * height))))
    return _ideal(x, y, film, lines, angle)


def ideal_rays(scene: Scene, x: float, y: float) -> dict[str, Any]:
    """Return the rays of a thin lens or a pinhole."""
    radius, film_z = ideal_opening(scene)
    camera = scene.camera
    if film_z <= 0:
        return {"x": x, "y": y, "rays": []} | _NO_LIGHT
    film = np.array(film_point(scene, camera, x, y)[:2])
    away = float(np.hypot(*film))
    height = away if film[1] >= 0 else -away
    found = perspective(scene)
    vergence = 0.0 if found is None else 1.0 / found.focus_mm
    lines = []
    for pupil in np.linspace(-radius, radius, FAN if radius else 1).tolist():
        # towards the object point at -height / film_z per unit of distance, from where the ray leaves the lens
        slope = -height / film_z - pupil * vergence
        lines.append([[film_z, height], [0.0, pupil], [-film_z, pupil + slope * film_z]])
    return _ideal(x, y, film, lines, float(np.degrees(np.arctan2(away, film_z))))


def _ideal(x: float, y: float, film: Array, lines: list[list[list[float]]], angle: float) -> dict[str, Any]:
    nm = LINES_NM[1]
    rays = [
        {"points": np.round(line, 4).tolist(), "wavelength_nm": round(nm, 2), "colour": wavelength_colour(nm),
         "passed": True, "stopped_by": None, "why": None}
        for line in lines
    ]  # fmt: skip
    place = [round(float(value), 4) for value in film]
    return {"x": x, "y": y, "film_mm": place, "rays": rays, "field_degrees": round(angle, 3), "spot": None, "mtf": None}
