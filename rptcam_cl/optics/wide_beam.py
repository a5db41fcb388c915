"""Beams from the side or from behind: fields beyond those that a plane across the axis can tell.

Rays are spread over a plane across the beam and met with the first surface, a sphere that bulges to the scene as those
of fisheyes do; behind it they travel towards the film, and the lens behind the first surface takes them on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.ray_trace import Rays, Status, refract

if TYPE_CHECKING:
    from rptcam_cl.optics.lens import Lens

Array = NDArray[np.float64]

STEEP = 85.0  # degrees, from which rays are spread across the beam
FIRST = 256  # rays across the first surface, each way
COARSE = 64  # across a beam about the ray through the middle of the stop


def is_steep(field_degrees: float) -> bool:
    """Return whether a field lies so far from the axis that its rays are spread across the beam."""
    return abs(field_degrees) > STEEP


def enter(lens: Lens, field_degrees: float, points: Array, wavelength_nm: float) -> Rays:
    """Return rays of a parallel beam traced through a lens, through points (n, 2) across the beam.

    Parameters
    ----------
    field_degrees : float
        From the axis; light of a positive angle travels towards +y.
    points : array
        x, and the other coordinate across the beam, from the line of the beam through the centre of the first surface.

    Raises
    ------
    InputError
        When the first surface is none that light from the side can meet here.
    """
    angle, middle = np.radians(field_degrees), np.array([0.0, 0.0, _radius(lens)])
    along, across = np.array([0.0, np.sin(angle), np.cos(angle)]), np.array([0.0, np.cos(angle), -np.sin(angle)])
    origins = middle + points[:, :1] * [1.0, 0.0, 0.0] + points[:, 1:] * across
    return enter_rays(lens, origins, np.broadcast_to(along, origins.shape), wavelength_nm)


def enter_rays(lens: Lens, origins: Array, directions: Array, wavelength_nm: float) -> Rays:
    """Return rays (n, 3) traced through a lens, whose first surface they meet from outside, whatever their direction.

    Origins may be any points of the rays; directions are unit vectors of the light.

    Raises
    ------
    InputError
        When the first surface is none that light from the side can meet here.
    """
    if not takes_steep_light(lens):
        steepest = np.degrees(np.arccos(np.clip(directions[:, 2].min(), -1.0, 1.0)))
        raise InputError(
            f"{lens.name}: light at {steepest:.4g} degrees needs a first surface that is spherical,"
            " bulging to the scene"
        )
    first, radius = lens.surfaces[0], _radius(lens)
    middle = np.array([0.0, 0.0, radius])
    off = origins - middle
    along = np.sum(off * directions, axis=1)
    square = along**2 - np.sum(off**2, axis=1) + radius**2
    off = off - (along + np.sqrt(np.maximum(square, 0.0)))[:, None] * directions
    met = off + middle
    good = (square > 0) & (met[:, 2] < radius) & first.clears(met[:, 0], met[:, 1])
    ratio = np.divide(*lens.indices(wavelength_nm)[:2])
    normals = -off / radius  # along the light
    bent, through = refract(directions.T, normals.T, np.sum(normals * directions, axis=1), np.asarray(ratio))
    rest = replace(
        lens,
        surfaces=lens.surfaces[1:],
        object_medium=first.glass,
        stop_index=None if lens.stop_index is None else lens.stop_index - 1,
        configurations=(),
        focusing=None,
    )
    shift = np.array([0.0, 0.0, first.thickness])
    rays = rest.trace(met - shift, bent.T, wavelength_nm, start="scene")
    status = np.where(good & through & (bent[2] > 0), rays.status, np.int32(Status.missed))
    return Rays(
        rays.origins + shift,
        rays.directions,
        status,
        np.where(rays.surface < 0, -1, rays.surface + 1),
        rays.optical_path,
    )


def takes_steep_light(lens: Lens) -> bool:
    """Return whether the first surface is one that light from the side can meet here: a sphere about the axis."""
    first = lens.surfaces[0]
    plain = first.is_rotational and first.pose is None and first.region is None and first.is_sphere
    return len(lens.surfaces) > 1 and plain and first.curvature > 0 and lens.stop_index != 0


def _radius(lens: Lens) -> float:
    """Return the radius of the first surface [mm], 1 of one that takes no steep light."""
    return 1.0 / lens.surfaces[0].curvature if lens.surfaces[0].curvature > 0 else 1.0


def passing_steep_beam(
    lens: Lens, field_degrees: float, wavelength_nm: float, across: int
) -> tuple[Array, Rays, float]:
    """Return points across the beam whose rays pass, those rays, and the area of a grid cell [mm2]."""

    def through(points: Array) -> Rays:
        return enter(lens, field_degrees, points, wavelength_nm)

    box = np.array([[-1.0, -1.0], [1.0, 1.0]]) * _radius(lens)
    return _passing(lens, through, box, (FIRST, COARSE, across), f"a beam at {field_degrees:g} degrees")


def passing_from(
    lens: Lens, away: Array, distance_mm: float, origin: Array, wavelength_nm: float, across: int
) -> tuple[Array, Rays]:
    """Return the light of a point of the scene that passes: how far each ray leans from the middle one, and the rays.

    The rays are spread over a plane across the direction of the point, through the centre of the first surface.

    Parameters
    ----------
    away : (3,) array
        Unit vector to the point.
    distance_mm : float
        How far it is from the origin; infinite for a parallel beam.
    origin : (3,) array
        Where the ray through the middle of the stop meets the first surface, in the frame of the lens [mm].

    Returns
    -------
    cosines : (n,) array
        Of the angles between rays and ``away``.
    rays : Rays
        Those that pass.

    Raises
    ------
    InputError
        When the first surface is no sphere that bulges to the scene, the point lies within it, or nothing passes.
    """
    radius = _radius(lens)
    middle = np.array([0.0, 0.0, radius])
    right = np.cross(away, [0.0, 0.0, 1.0])
    right = right / np.linalg.norm(right)
    up = np.cross(right, away)
    source = origin + away * distance_mm if np.isfinite(distance_mm) else None
    depth = np.inf if source is None else float((source - middle) @ away)
    if not depth > radius:
        raise InputError(f"{lens.name}: a point {distance_mm:g} mm away lies within the first surface")

    def beam(points: Array) -> tuple[Array, Array]:
        targets = middle + points[:, :1] * right + points[:, 1:] * up
        if source is None:
            return targets, np.broadcast_to(-away, targets.shape)
        light = targets - source
        return targets, light / np.linalg.norm(light, axis=1, keepdims=True)

    def through(points: Array) -> Rays:
        return enter_rays(lens, *beam(points), wavelength_nm)

    centre = np.array([(origin - middle) @ right, (origin - middle) @ up])
    half = 2.0 * lens.first_order(wavelength_nm).entrance_pupil.diameter_mm
    box = np.stack([centre - half, centre + half])
    while _cut_off(box, through) and half < radius:
        half *= 2.0
        box = np.stack([centre - half, centre + half])
    what = f"a point {np.degrees(np.arccos(-away[2])):.4g} degrees from the axis"
    points, rays, _ = _passing(lens, through, box, (COARSE, across), what)
    return -(beam(points)[1] @ away), rays


def _cut_off(box: Array, through: Callable[[Array], Rays]) -> bool:
    """Return whether light passes by the edges of a box, or none within."""
    points, size = grid_points(box, COARSE)
    lit = points[through(points).passed]
    return not len(lit) or bool(np.any(lit < box[0] + size) or np.any(lit > box[1] - size))


def _passing(
    lens: Lens, through: Callable[[Array], Rays], box: Array, counts: tuple[int, ...], what: str
) -> tuple[Array, Rays, float]:
    """Return points of a box whose rays pass, those rays, and a cell's area [mm2], on grids that narrow it down."""
    for count in counts:
        for finer in (1, 4):  # a small pupil behind a large first surface slips through the first grid
            points, size = grid_points(box, finer * count)
            rays = through(points)
            good = rays.passed
            if good.any() or count != counts[0]:
                break
        if not good.any():
            raise InputError(f"{lens.name}: nothing of {what} comes through")
        box = np.stack([points[good].min(axis=0) - size, points[good].max(axis=0) + size])
    kept = Rays(
        rays.origins[good], rays.directions[good], rays.status[good], rays.surface[good], rays.optical_path[good]
    )
    return points[good], kept, float(size.prod())


def grid_points(box: Array, count: int) -> tuple[Array, Array]:
    """Return the centres (count^2, 2) of the cells of a box and the size of a cell."""
    size = (box[1] - box[0]) / count
    x, y = (box[0, i] + size[i] * (np.arange(count) + 0.5) for i in (0, 1))
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2), size


def steep_chief_ray(lens: Lens, field_degrees: float, stop: int, wavelength_nm: float) -> tuple[float, Rays]:
    """Return the place across the beam of the ray through the centre of the stop, a surface, and its trace."""
    opened = tuple(replace(surface, semi_diameter=np.inf, region=None) for surface in lens.surfaces[1 : stop + 1])
    front = replace(lens, surfaces=(lens.surfaces[0], *opened), stop_index=None)

    def at(places: Array) -> Array:
        return np.column_stack([np.zeros_like(places), places])

    low, high = -_radius(lens), _radius(lens)
    for count in (801, 65, 65, 65, 65, 65):
        places = np.linspace(low, high, count)
        rays = enter(front, field_degrees, at(places), wavelength_nm)
        values = np.where(rays.passed, rays.origins[:, 1], np.nan)
        with np.errstate(invalid="ignore"):
            cross = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) <= 0)
        if not len(cross):
            raise InputError(f"{lens.name}: no ray at {field_degrees:g} degrees reaches the centre of the stop")
        k = cross[np.argmin(np.abs(values[cross]) + np.abs(values[cross + 1]))]
        low, high = places[k], places[k + 1]
    place = float((low + high) / 2)
    return place, enter(lens, field_degrees, at(np.array([place])), wavelength_nm)
