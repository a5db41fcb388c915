"""Which rays from points of the film come through the lens: the ground on which pupils and irradiance are measured.

A ray is named by its film point (x, y at z = film) and the point (u, v) where it crosses the plane of the last vertex.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.errors import InputError

if TYPE_CHECKING:
    from rptcam_cl.optics.lens import Lens

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class FilmProbe:
    """Traces bundles of rays from film points through a lens.

    Parameters
    ----------
    lens : Lens
    film_distance_mm : float
        Last vertex to film.
    wavelength_nm : float
    """

    def __init__(self, lens: Lens, film_distance_mm: float, wavelength_nm: float) -> None:
        rear = lens.surfaces[-1]
        if not np.isfinite(rear.semi_diameter):
            raise InputError(f"{lens.name}: the last surface needs a diameter")
        if not film_distance_mm > max(0.0, rear.rim_sag()):
            raise InputError(
                f"{lens.name}: the film must stand behind the last surface "
                f"(got {film_distance_mm:g} mm from its vertex)"
            )
        self.lens = lens
        self.distance = float(film_distance_mm)
        self.wavelength_nm = wavelength_nm

    def windows(self, film: Array) -> Array:
        """Return boxes (m, 4) u0, u1, v0, v1 [mm] that hold every ray from film points (m, 2) to the last surface."""
        heights = np.linspace(0.0, self.lens.surfaces[-1].semi_diameter, 17)
        sags = np.array([self.lens.surfaces[-1].rim_sag(height) for height in heights])
        scale = self.distance / (self.distance - sags)
        centre = film[:, None, :] * (1.0 - scale)[None, :, None]
        reach = (heights * scale)[None, :, None]
        low, high = (centre - reach).min(axis=1), (centre + reach).max(axis=1)
        return np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], axis=1)

    def passes(self, film: Array, rear: Array) -> Mask:
        """Return which rays pass: film points (..., 2) through points (..., 2) of the plane of the last vertex."""
        film, rear = np.broadcast_arrays(film, rear)
        shape = rear.shape[:-1]
        origins = np.empty((*shape, 3))
        origins[..., :2] = film
        origins[..., 2] = self.lens.length + self.distance
        directions = np.empty((*shape, 3))
        directions[..., :2] = rear - film
        directions[..., 2] = -self.distance
        rays = self.lens.trace(origins.reshape(-1, 3), directions.reshape(-1, 3), self.wavelength_nm)
        return rays.passed.reshape(shape)


def grid(boxes: Array, nu: int, nv: int) -> Array:
    """Return the centres (m, nu * nv, 2) of the cells of boxes (m, 4) u0, u1, v0, v1."""
    u = boxes[:, 0, None] + (boxes[:, 1] - boxes[:, 0])[:, None] * (np.arange(nu) + 0.5) / nu
    v = boxes[:, 2, None] + (boxes[:, 3] - boxes[:, 2])[:, None] * (np.arange(nv) + 0.5) / nv
    points = np.empty((len(boxes), nu, nv, 2))
    points[..., 0] = u[:, :, None]
    points[..., 1] = v[:, None, :]
    return points.reshape(len(boxes), nu * nv, 2)


def cells(boxes: Array, nu: int, nv: int) -> Array:
    """Return the size (m, 2) of the cells of boxes."""
    return np.stack([(boxes[:, 1] - boxes[:, 0]) / nu, (boxes[:, 3] - boxes[:, 2]) / nv], axis=1)


def narrowed(probe: FilmProbe, film: Array, boxes: Array, shape: tuple[int, int]) -> tuple[Array, Mask]:
    """Return boxes round the rays of a grid that pass, widened by a cell, and which film points have any.

    Film points (m, 2) and boxes (m, 4) as in `FilmProbe.windows`; without a passing ray the box stays as it was.
    """
    points = grid(boxes, *shape)
    hits = probe.passes(film[:, None], points)
    margin = cells(boxes, *shape)
    low = np.where(hits[..., None], points, np.inf).min(axis=1) - margin
    high = np.where(hits[..., None], points, -np.inf).max(axis=1) + margin
    found: Mask = np.asarray(np.any(hits, axis=1))
    tight = np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], axis=1)
    return np.where(found[:, None], tight, boxes), found
