"""Bundles of rays from film points through camera models in float64, in the frame of the traced camera.

That frame has the centre of the film as its origin, x and y of the film as they lie there (inverted), and z along the
axis towards the scene. Millimetres. A stop that is not round counts as its circle; see `stops` for its shape.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.tradeoff.tiers.tiers import FirstOrderCamera, Tier

Array = NDArray[np.float64]

SPOKES = 64  # directions round a pupil
RINGS = 6  # points along each, at the nodes of Gauss and Legendre
OUTLINE = np.arange(32) * 2 * np.pi / 32  # directions in which the reach of a spot is measured


@dataclass(frozen=True)
class BundleSpot:
    """Where the light of a film point meets a plane across the axis.

    Attributes
    ----------
    middle : (2,) array
        Its centroid [mm].
    spread : (3,) array
        Standard deviation along the field, across it, and their root sum of squares [mm].
    outline : array
        How far it reaches from its middle, in the directions of `OUTLINE` [mm].
    """

    middle: Array
    spread: Array
    outline: Array


@dataclass(frozen=True)
class RayBundle:
    """The light that reaches a film point.

    Attributes
    ----------
    origins, directions : (n, 3) arrays
        Where rays leave the camera, and directions with z = 1; not a number for rays that do not.
    weights : (n,) array
        What each brings to the irradiance of the film point in a world of radiance 1, up to a factor of the camera;
        0 for those on the outline.
    """

    origins: Array
    directions: Array
    weights: Array

    @property
    def light(self) -> float:
        """Irradiance in a world of radiance 1, up to a factor of the camera."""
        return float(self.weights.sum())

    def only(self, which: NDArray[np.bool_]) -> RayBundle:
        """Return some of the rays."""
        return RayBundle(self.origins[which], self.directions[which], self.weights[which])

    def places(self, plane_mm: float) -> Array:
        """Return where the rays meet a plane across the axis, (n, 2)."""
        return np.asarray(self.origins[:, :2] + (plane_mm - self.origins[:, 2:]) * self.directions[:, :2])

    def spot(self, plane_mm: float, along: Array) -> BundleSpot:
        """Return the spot on a plane across the axis; ``along`` (2,) is the direction of the field, of length 1."""
        places = self.places(plane_mm)
        share = self.weights / self.light
        middle = share @ places
        away = places - middle
        across = np.array([-along[1], along[0]])
        spread = np.sqrt([share @ (away @ axis) ** 2 for axis in (along, across)])
        reach = away @ np.stack([np.cos(OUTLINE), np.sin(OUTLINE)])
        return BundleSpot(middle, np.append(spread, np.hypot(*spread)), reach.max(axis=0))


def polar(spokes: int, rings: int) -> tuple[Array, Array]:
    """Return directions (spokes, 2) and, along each, (rings, 2) shares of the radius and their weights.

    The integral of f over a disk of radius 1 is the mean over the directions of the sum of weight * f.
    """
    turn = (np.arange(spokes) + 0.5) * 2 * np.pi / spokes
    nodes, weights = np.polynomial.legendre.leggauss(rings)
    radii = (nodes + 1) / 2
    return np.stack([np.cos(turn), np.sin(turn)], axis=1), np.stack([radii, np.pi * weights * radii], axis=1)


def _disk() -> tuple[Array, Array]:
    """Return points (n, 2) of the unit disk and their shares of its area; its edge weighs nothing."""
    turns, radial = polar(SPOKES, RINGS)
    inside = (turns[:, None] * radial[:, 0, None]).reshape(-1, 2)
    area = np.tile(radial[:, 1] / SPOKES, SPOKES)
    return np.concatenate([inside, turns]), np.concatenate([area, np.zeros(SPOKES)])


def tier_bundle(first: FirstOrderCamera, tier: Tier, point: Array) -> RayBundle:
    """Return the rays of thick lens, thin lens or pinhole for a film point (2,)."""
    disk, area = _disk()
    if tier == "thick_lens":
        thick, lens_mm = first.thick, first.setting.lens.film_z(first.setting.film_distance_mm)
        height = thick.height[0] * point + thick.height[1] * disk
        slope = thick.slope[0] * point + thick.slope[1] * disk
        film_slope = thick.film_slope[0] * point + thick.film_slope[1] * disk
        weights = area / (1 + np.sum(film_slope**2, axis=1)) ** 2
        origins = np.column_stack([height, np.full(len(disk), lens_mm)])
        return RayBundle(origins, np.column_stack([slope, np.ones(len(disk))]), weights)
    if tier == "pinhole":
        disk, area = np.zeros((1, 2)), np.ones(1)
    chief = np.sign(first.thick.slope[0]) * point / first.film_mm_per_tangent
    start = first.radius_mm * disk
    plane = first.plane_mm if first.plane_mm is not None else np.inf
    slope = chief - start / plane
    origins = np.column_stack([start, np.full(len(disk), first.pupil_mm)])
    return RayBundle(origins, np.column_stack([slope, np.ones(len(disk))]), area)
