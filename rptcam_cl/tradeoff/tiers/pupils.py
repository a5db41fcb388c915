"""Pupils of a lens as film points see them, to their very edge, and points that are spread over them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics import FINE, FilmProbe, Lens, narrowing_probes, pupil_boxes
from rptcam_cl.tradeoff.tiers.bundles import SPOKES, polar

Array = NDArray[np.float64]

FARTHEST = 1.5  # from the middle of a pupil's box, in its half sides: the corners lie within
SCAN = 12  # points along a direction
BISECTIONS = 14


@dataclass(frozen=True)
class Pupils:
    """Outlines on the plane of the last vertex.

    Attributes
    ----------
    film : (m, 2) array
        The film points that see them [mm].
    centres, axes : (m, 2) arrays
        Middles and half sides of their boxes [mm].
    radii : (m, SPOKES) array
        How far they reach in the directions of `bundles.polar`, in units of the half sides; 0 where nothing passes.
    """

    film: Array
    centres: Array
    axes: Array
    radii: Array

    @classmethod
    def of(cls, lens: Lens, film_distance_mm: float, film: Array, wavelength_nm: float) -> Pupils:
        """Return the pupils that film points (m, 2) see."""
        probes = narrowing_probes(lens, film_distance_mm, wavelength_nm)
        boxes, found = pupil_boxes(probes, film, FINE)
        centres, axes = (boxes[:, 1::2] + boxes[:, ::2]) / 2, (boxes[:, 1::2] - boxes[:, ::2]) / 2
        radii = np.zeros((len(film), SPOKES))
        radii[found] = _edges(probes[-1], film[found], centres[found], axes[found])
        return cls(film, centres, axes, radii)

    def nodes(self, rings: int) -> tuple[Array, Array]:
        """Return points (m, n, 2) of the pupils and the area that each stands for; those of the edge stand for none."""
        turns, radial = polar(SPOKES, rings)
        frame = self.axes[:, None] * turns * self.radii[..., None]
        inside = self.centres[:, None, None] + frame[:, :, None] * radial[:, 0, None]
        area = np.prod(self.axes, axis=1)[:, None, None] * self.radii[..., None] ** 2 * radial[:, 1] / SPOKES
        count = len(self.film)
        points = np.concatenate([inside.reshape(count, -1, 2), self.centres[:, None] + frame], axis=1)
        return points, np.concatenate([area.reshape(count, -1), np.zeros((count, SPOKES))], axis=1)


def _edges(probe: FilmProbe, film: Array, centres: Array, axes: Array) -> Array:
    """Return how far from the middles of their boxes pupils reach: the farthest point that passes, by bisection."""
    turns, _ = polar(SPOKES, 1)
    frame = axes[:, None] * turns

    def passing(rho: Array) -> NDArray[np.bool_]:
        return probe.passes(film[:, None], centres[:, None] + frame * rho[..., None])

    step = FARTHEST / SCAN
    tries = np.arange(SCAN, 0, -1) * step
    hits = probe.passes(film[:, None, None], centres[:, None, None] + frame[:, :, None] * tries[:, None])
    low = np.where(hits.any(axis=2), tries[np.argmax(hits, axis=2)], 0.0)
    high = low + step
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        inside = passing(middle)
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return low
