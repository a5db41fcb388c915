"""Which rays from points of the film come through the lens: the ground on which pupils and irradiance are measured.

A ray is named by its film point (x, y on the film) and the point (u, v) where it crosses the plane of the last vertex.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.film_frame import UNMOVED, FilmFrame
from rptcam_cl.optics.ray_trace import passing

if TYPE_CHECKING:
    from rptcam_cl.optics.lens import Lens
    from rptcam_cl.optics.surface import Surface

PATCH_AZIMUTHS = 32
PATCH_RADII = 257  # so many that the outline of a bulging surface, which lies between two, is met within 1e-4
BULGE = 1e-4
LEAST_GAP = 1e-3  # of the film distance, between the last surface and points whose windows are sought

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Wavelengths = float | tuple[float, ...]


class FilmProbe:
    """Traces bundles of rays from film points through a lens.

    Parameters
    ----------
    lens : Lens
    film_distance_mm : float
        Last vertex to film.
    wavelength_nm : float or tuple
        With several, rays pass that pass at any of them.
    frame : FilmFrame
        How the film stands; points in front of the last surface see no light.
    azimuth : (x, y)
        Unit vector: direction of the first axis of film points and points of the rear plane; the second is a quarter of
        a turn ahead.
    """

    def __init__(
        self,
        lens: Lens,
        film_distance_mm: float,
        wavelength_nm: Wavelengths,
        frame: FilmFrame = UNMOVED,
        azimuth: tuple[float, float] = (1.0, 0.0),
    ) -> None:
        if not np.isfinite(lens.surfaces[-1].semi_diameter):
            raise InputError(f"{lens.name}: the last surface needs a diameter")
        self.patch = _patch(lens.surfaces[-1], lens.sense)
        if not film_distance_mm > max(0.0, float(self.patch[:, 2].max())):
            raise InputError(
                f"{lens.name}: the film must stand behind the last surface "
                f"(got {film_distance_mm:g} mm from its vertex)"
            )
        self.lens = lens
        self.frame = frame
        self.azimuth = azimuth
        if not lens.surfaces[-1].is_rotational:
            self.patch[:, :2] = self.turned(self.patch[:, :2], back=True)
        self.distance = float(film_distance_mm)
        self.wavelength_nm, *self.others_nm = wavelength_nm if isinstance(wavelength_nm, tuple) else (wavelength_nm,)

    def turned(self, points: Array, *, back: bool = False) -> Array:
        """Return points (..., 2) of the probe's axes in those of the lens, or back."""
        c, s = self.azimuth
        if s == 0.0 and c == 1.0:
            return points
        x, y = points[..., 0], points[..., 1] * (-1.0 if back else 1.0)
        return np.stack([c * x - s * y, (s * x + c * y) * (-1.0 if back else 1.0)], axis=-1)

    def distances(self, film: Array) -> Array:
        """Return how far behind the last vertex film points (..., 2) lie [mm]."""
        if self.frame.is_flat:
            return np.full(film.shape[:-1], self.distance)
        return self.distance + self.frame.depth(self.turned(film))

    def windows(self, film: Array) -> Array:
        """Return boxes (m, 4) u0, u1, v0, v1 [mm] that hold every ray from film points (m, 2) to the last surface."""
        points = film[:1] if self.frame.is_flat else film
        distances = np.maximum(self.distances(points), LEAST_GAP * self.distance + self.patch[:, 2].max())[:, None]
        scale = distances / (distances - self.patch[:, 2])
        crossing = film[:, None, :] * (1.0 - scale)[..., None] + self.patch[:, :2] * scale[..., None]
        low, high = crossing.min(axis=1), crossing.max(axis=1)
        ring = crossing[:, -(len(self.patch) // PATCH_RADII) :]
        if np.any(ring.min(axis=1) > low) or np.any(ring.max(axis=1) < high):  # a bulge beyond the rim
            middle, half = (low + high) / 2, (high - low) / 2 * (1.0 + BULGE)
            low, high = middle - half, middle + half
        if not self.lens.surfaces[-1].is_rotational:  # the rim bulges between the azimuths that were taken
            middle, half = (low + high) / 2, (high - low) / 2 / np.cos(np.pi / PATCH_AZIMUTHS)
            low, high = middle - half, middle + half
        return np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], axis=1)

    def passes(self, film: Array, rear: Array) -> Mask:
        """Return which rays pass: film points (..., 2) through points (..., 2) of the plane of the last vertex."""
        film, rear = np.broadcast_arrays(film, rear)
        shape = rear.shape[:-1]
        distances = self.distances(film)
        origins = np.empty((*shape, 3))
        origins[..., :2] = self.turned(film)
        origins[..., 2] = self.lens.length + self.lens.sense * distances
        directions = np.empty((*shape, 3))
        directions[..., :2] = self.turned(rear - film)
        directions[..., 2] = -self.lens.sense * distances
        origins, directions = origins.reshape(-1, 3), directions.reshape(-1, 3)
        passed = passing(self.lens, origins, directions, self.wavelength_nm)
        for wavelength_nm in self.others_nm:
            dark = np.flatnonzero(~passed)
            passed[dark] = passing(self.lens, origins[dark], directions[dark], wavelength_nm)
        return passed.reshape(shape)

    def reaches_lens(self, half_film_mm: tuple[float, float]) -> bool:
        """Return whether some corner of a film of such half sides stands in or in front of the last surface."""
        corners = self.frame.corners(half_film_mm)
        return bool(np.any(self.distance + corners[:, 2] <= max(0.0, float(self.patch[:, 2].max()))))


def _patch(surface: Surface, sense: float) -> Array:
    """Return points (n, 3) spread over the clear area of the last surface about its vertex, z towards the film."""
    azimuths = 4 if surface.is_rotational else PATCH_AZIMUTHS
    angles = np.arange(azimuths) * 2 * np.pi / azimuths
    radii = np.linspace(0.0, surface.semi_diameter * (1 - 1e-12), PATCH_RADII)
    x, y = (np.outer(radii, turn(angles)).ravel() for turn in (np.cos, np.sin))
    points = np.stack([x, y, surface.sag(x, y)])
    if surface.pose:
        points, _ = surface.pose.outward(points, points)
    return points.T * [1.0, 1.0, sense]


def grid(boxes: Array, nu: int, nv: int) -> Array:
    """Return the centres (m, nu * nv, 2) of the cells of boxes (m, 4) u0, u1, v0, v1."""
    u = boxes[:, 0, None] + (boxes[:, 1] - boxes[:, 0])[:, None] * (np.arange(nu) + 0.5) / nu
    v = boxes[:, 2, None] + (boxes[:, 3] - boxes[:, 2])[:, None] * (np.arange(nv) + 0.5) / nv
    points = np.empty((len(boxes), nu, nv, 2))
    points[..., 0] = u[:, :, None]
    points[..., 1] = v[:, None, :]
    return points.reshape(len(boxes), nu * nv, 2)


def spread_points(boxes: Array, count: int) -> Array:
    """Return points (m, count, 2) spread over boxes (m, 4) more evenly than by chance (R2, Roberts 2018)."""
    share = (0.5 + np.arange(1, count + 1)[:, None] * np.array([0.7548776662466927, 0.5698402909980532])) % 1.0
    low, high = boxes[:, None, ::2], boxes[:, None, 1::2]
    return np.asarray(low + (high - low) * share)


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
