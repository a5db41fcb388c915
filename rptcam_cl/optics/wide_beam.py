"""Parallel beams from the side or from behind: fields beyond those that a plane across the axis can tell.

Rays are spread over a plane across the beam and met with the first surface, a sphere that bulges to the scene as those
of fisheyes do; behind it they travel towards the film, and the lens behind the first surface takes them on.
"""

from __future__ import annotations

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
    first = lens.surfaces[0]
    if not _takes_steep_light(lens):
        raise InputError(
            f"{lens.name}: light at {field_degrees:g} degrees needs a first surface that is spherical,"
            " bulging to the scene"
        )
    radius, angle = 1.0 / first.curvature, np.radians(field_degrees)
    along, across = np.array([0.0, np.sin(angle), np.cos(angle)]), np.array([0.0, np.cos(angle), -np.sin(angle)])
    depth = np.sqrt(np.maximum(radius**2 - np.sum(points**2, axis=1), 0.0))
    off = points[:, :1] * [1.0, 0.0, 0.0] + points[:, 1:] * across - depth[:, None] * along  # from the centre
    met = off + np.array([0.0, 0.0, radius])
    good = (np.sum(points**2, axis=1) < radius**2) & (met[:, 2] < radius) & first.clears(met[:, 0], met[:, 1])
    ratio = np.divide(*lens.indices(wavelength_nm)[:2])
    normals = -off / radius  # along the light
    bent, through = refract(
        np.broadcast_to(along[:, None], (3, len(points))), normals.T, normals @ along, np.asarray(ratio)
    )
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


def _takes_steep_light(lens: Lens) -> bool:
    first = lens.surfaces[0]
    plain = first.is_rotational and first.pose is None and first.region is None and first.is_sphere
    return len(lens.surfaces) > 1 and plain and first.curvature > 0 and lens.stop_index != 0


def passing_steep_beam(
    lens: Lens, field_degrees: float, wavelength_nm: float, across: int
) -> tuple[Array, Rays, float]:
    """Return points across the beam whose rays pass, those rays, and the area of a grid cell [mm2]."""
    reach = 1.0 / lens.surfaces[0].curvature if lens.surfaces[0].curvature > 0 else 1.0
    box = np.array([[-reach, -reach], [reach, reach]])
    for count in (FIRST, 64, across):
        for finer in (1, 4):  # a small pupil behind a large first surface slips through the first grid
            points, size = grid_points(box, finer * count)
            rays = enter(lens, field_degrees, points, wavelength_nm)
            good = rays.passed
            if good.any() or count != FIRST:
                break
        if not good.any():
            raise InputError(f"{lens.name}: nothing of a beam at {field_degrees:g} degrees comes through")
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

    reach = 1.0 / lens.surfaces[0].curvature if lens.surfaces[0].curvature > 0 else 1.0
    low, high = -reach, reach
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
