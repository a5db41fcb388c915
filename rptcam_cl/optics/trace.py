"""Exact rays through every surface in float64: the reference for every other tracer.

The hit point is found from the tangent plane of the vertex, so that weak curvature costs no accuracy: a ray is moved to
the plane of the vertex first, then to the surface. A plane is curvature 0 and needs no case of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.errors import InputError
from rptcam_cl.optics.glass import WAVELENGTH_D

if TYPE_CHECKING:
    from rptcam_cl.optics.lens import Lens
    from rptcam_cl.optics.surface import Surface

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Status(IntEnum):
    """What became of a ray."""

    ok = 0
    missed = 1
    clipped = 2
    total_internal_reflection = 3


@dataclass(frozen=True)
class Rays:
    """Rays after the lens, in its frame [mm].

    Attributes
    ----------
    origins, directions : (n, 3) arrays
        Point on the last surface met and unit direction after it; of a failed ray, the last good ones.
    status : (n,) array of `Status` values
    surface : (n,) array
        Index of the surface where the ray failed, -1 if it did not.
    optical_path : (n,) array
        Sum of index times length from the start to the origin [mm].
    """

    origins: Array
    directions: Array
    status: NDArray[np.int32]
    surface: NDArray[np.int32]
    optical_path: Array

    @property
    def passed(self) -> Mask:
        """Which rays came through."""
        return np.asarray(self.status == Status.ok)


def trace(
    lens: Lens, origins: ArrayLike, directions: ArrayLike, wavelength_nm: ArrayLike = WAVELENGTH_D, start: str = "film"
) -> Rays:
    """Return the rays after they have crossed every surface.

    Parameters
    ----------
    lens : Lens
    origins, directions : (n, 3) arrays
        Points [mm] and directions of any length in the frame of the lens, z = 0 at its first vertex and +z to the film.
    wavelength_nm : float or (n,) array
    start : "film" or "scene"
        Side where the rays begin: from the film they travel to -z, from the scene to +z.
    """
    if start not in ("film", "scene"):
        raise InputError(f'start must be "film" or "scene" (got {start!r})')
    beam = _Beam(origins, directions)
    indices = lens.indices(wavelength_nm)
    count = len(lens.surfaces)
    for k in range(count) if start == "scene" else reversed(range(count)):
        before, after = (indices[k], indices[k + 1]) if start == "scene" else (indices[k + 1], indices[k])
        beam.cross(lens.surfaces[k], k, float(lens.vertices[k]), before, after, 1.0 if start == "scene" else -1.0)
    return Rays(beam.origins, beam.directions, beam.status, beam.surface, beam.path)


class _Beam:
    """Rays under way, and which of them still are."""

    def __init__(self, origins: ArrayLike, directions: ArrayLike) -> None:
        points, vectors = np.broadcast_arrays(
            np.atleast_2d(np.asarray(origins, dtype=np.float64)),
            np.atleast_2d(np.asarray(directions, dtype=np.float64)),
        )
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError(f"rays need origins and directions of shape (n, 3) (got {points.shape})")
        with np.errstate(invalid="ignore", divide="ignore"):
            vectors = vectors / np.sqrt(np.sum(vectors * vectors, axis=1, keepdims=True))
        self.origins = points.copy()
        self.directions = vectors
        self.status = np.zeros(len(points), dtype=np.int32)
        self.surface = np.full(len(points), -1, dtype=np.int32)
        self.path = np.zeros(len(points))

    def fail(self, which: Mask, reason: Status, surface: int) -> None:
        """Stop the rays of a mask that are still under way."""
        which = which & (self.status == Status.ok)
        self.status[which] = reason
        self.surface[which] = surface

    def cross(self, surface: Surface, number: int, vertex: float, before: Array, after: Array, sense: float) -> None:
        """Move every ray to a surface and refract it there."""
        local = self.origins - (0.0, 0.0, vertex)
        with np.errstate(all="ignore"):
            point, distance, normal, cosine, met = meet_sphere(surface.curvature, local, self.directions)
            met = met & (self.directions[:, 2] * sense > 0) & np.isfinite(distance)
            inside = point[:, 0] ** 2 + point[:, 1] ** 2 <= surface.semi_diameter**2
            bent, through = refract(self.directions, normal, cosine, before, after)
        self.fail(~met, Status.missed, number)
        self.fail(~inside, Status.clipped, number)
        alive = self.status == Status.ok
        self.path[alive] += np.broadcast_to(before, distance.shape)[alive] * distance[alive]
        self.origins[alive] = point[alive] + (0.0, 0.0, vertex)
        self.fail(~through, Status.total_internal_reflection, number)
        alive = self.status == Status.ok
        self.directions[alive] = bent[alive]


def meet_sphere(curvature: float, points: Array, directions: Array) -> tuple[Array, Array, Array, Array, Mask]:
    """Return hit point, distance, unit normal, cosine and whether there is a hit with the hemisphere about the vertex.

    The normal has positive z; the cosine between it and the ray has the sign of the ray's z, so the ray crosses the
    hemisphere in the sense in which it travels.
    """
    dx, dy, dz = directions.T
    to_plane = -points[:, 2] / dz
    x, y = points[:, 0] + to_plane * dx, points[:, 1] + to_plane * dy
    f = curvature * (x * x + y * y)
    g = dz - curvature * (dx * x + dy * y)
    discriminant = g * g - curvature * f
    cosine = np.copysign(np.sqrt(np.maximum(discriminant, 0.0)), dz)
    step = f / (g + cosine)
    hit = np.stack([x + step * dx, y + step * dy, step * dz], axis=1)
    normal = -curvature * hit
    normal[:, 2] += 1.0
    met = (discriminant >= 0) & (normal[:, 2] > 0)
    return hit, to_plane + step, normal, cosine, met


def refract(directions: Array, normals: Array, cosines: Array, before: Array, after: Array) -> tuple[Array, Mask]:
    """Return directions after Snell's law, and which rays are refracted and not totally reflected."""
    ratio = before / after
    square = 1.0 - ratio * ratio * (1.0 - cosines * cosines)
    through = square >= 0
    bend = np.copysign(np.sqrt(np.maximum(square, 0.0)), cosines) - ratio * cosines
    bent = ratio[..., None] * directions + bend[..., None] * normals
    same = np.broadcast_to(before == after, cosines.shape)
    return np.where(same[:, None], directions, bent), through | same
