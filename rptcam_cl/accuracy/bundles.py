"""Bundles of rays from film points through each camera model in float64, in the frame of the traced camera.

That frame has the centre of the film as its origin, x and y of the film as they lie there (inverted), and z along the
axis towards the scene. Millimetres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.accuracy.tiers import FirstOrderCamera, Tier
from rptcam_cl.optics import Lens
from rptcam_cl.optics.probe import FilmProbe, cells, grid
from rptcam_cl.optics.pupil_shape import FINE, narrowing_probes, pupil_boxes

Array = NDArray[np.float64]

RINGS, SPOKES = 8, 24  # of points of a round pupil, each for the same share of its area
GRID = (24, 24)  # of points of a traced pupil's box


@dataclass(frozen=True)
class Bundle:
    """The light that reaches a film point.

    Attributes
    ----------
    origins, directions : (n, 3) arrays
        Where rays leave the camera, and directions with z = 1.
    weights : (n,) array
        What each brings to the irradiance of the film point in a world of radiance 1, up to a factor of the camera.
    """

    origins: Array
    directions: Array
    weights: Array

    @property
    def light(self) -> float:
        """Irradiance in a world of radiance 1, up to a factor of the camera."""
        return float(self.weights.sum())

    def spot(self, plane_mm: float) -> tuple[Array, float]:
        """Return the centroid (2,) and the root mean square radius of where the rays meet a plane across the axis."""
        places = self.origins[:, :2] + (plane_mm - self.origins[:, 2:]) * self.directions[:, :2]
        share = self.weights / self.light
        middle = share @ places
        return middle, float(np.sqrt(share @ np.sum((places - middle) ** 2, axis=1)))


def traced_bundle(lens: Lens, film_mm: float, point: Array, wavelength_nm: float) -> Bundle | None:
    """Return the rays that pass a lens from a film point (2,), or None where none does."""
    probes = narrowing_probes(lens, film_mm, wavelength_nm)
    boxes, found = pupil_boxes(probes, point[None], FINE)
    if not found[0]:
        return None
    box = boxes
    at = grid(box, *GRID)[0]
    probe: FilmProbe = probes[-1]
    passes = probe.passes(point, at)
    if not passes.any():
        return None
    at = at[passes]
    square = np.sum((at - point) ** 2, axis=1)
    cell = float(np.prod(cells(box, *GRID)[0]))
    weights = cell * (film_mm / (film_mm**2 + square)) ** 2
    origins = np.tile([*point, lens.length + film_mm], (len(at), 1))
    towards = np.concatenate([at - point, np.full((len(at), 1), -film_mm)], axis=1)
    rays = lens.trace(origins, towards, wavelength_nm, "film")
    good = rays.status == 0
    z = lens.length + film_mm - rays.origins[good, 2]  # ahead of the film
    directions = rays.directions[good] / -rays.directions[good, 2:]
    directions[:, 2] = 1.0
    return Bundle(np.column_stack([rays.origins[good, :2], z]), directions, weights[good])


def _disk() -> Array:
    """Return points (n, 2) of the unit disk that stand for equal areas."""
    radius = np.sqrt((np.arange(RINGS) + 0.5) / RINGS)
    turn = (np.arange(SPOKES) + 0.5) * 2 * np.pi / SPOKES
    return np.stack([np.outer(radius, np.cos(turn)).ravel(), np.outer(radius, np.sin(turn)).ravel()], axis=1)


def first_order_bundle(first: FirstOrderCamera, tier: Tier, point: Array) -> Bundle:
    """Return the rays of thick lens, thin lens or pinhole for a film point (2,)."""
    disk = _disk()
    if tier == "thick_lens":
        thick, lens_mm = first.thick, first.setting.film_distance_mm + first.setting.lens.length
        height = thick.height[0] * point + thick.height[1] * disk
        slope = thick.slope[0] * point + thick.slope[1] * disk
        film_slope = thick.film_slope[0] * point + thick.film_slope[1] * disk
        weights = 1 / (1 + np.sum(film_slope**2, axis=1)) ** 2
        origins = np.column_stack([height, np.full(len(disk), lens_mm)])
        return Bundle(origins, np.column_stack([slope, np.ones(len(disk))]), weights)
    if tier == "pinhole":
        disk = np.zeros((1, 2))
    chief = np.sign(first.thick.slope[0]) * point / first.film_mm_per_tangent
    start = first.radius_mm * disk
    plane = first.plane_mm if first.plane_mm is not None else np.inf
    slope = chief - start / plane
    origins = np.column_stack([start, np.full(len(disk), first.pupil_mm)])
    return Bundle(origins, np.column_stack([slope, np.ones(len(disk))]), np.ones(len(disk)))
