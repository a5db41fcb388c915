"""Shapes of an aperture stop: blades, stars, hearts and polygons inside the unit circle, which is the round stop."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.errors import InputError

Array = NDArray[np.float64]

ARC_STEPS = 16  # straight pieces of a curved blade edge
MOST_VERTICES = 1024


@dataclass(frozen=True)
class StopShape:
    """A polygon that every ray from the axis leaves once, so that it can be sampled as a fan of triangles.

    Attributes
    ----------
    vertices : tuple of (x, y)
        Counter-clockwise, in units of the stop's radius; x to the right and y upwards as seen from the film.
    """

    vertices: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        points = np.array(self.vertices, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 2 or not 3 <= len(points) <= MOST_VERTICES:
            raise InputError(f"a stop shape needs 3 to {MOST_VERTICES} points [x, y]")
        if not np.all(np.isfinite(points)) or np.max(np.hypot(*points.T)) > 1 + 1e-9:
            raise InputError("the points of a stop shape must lie inside the unit circle")
        if np.min(self.fan_areas) <= 0:
            raise InputError("a stop shape must run counter-clockwise round the axis and be seen whole from it")

    @cached_property
    def fan_areas(self) -> Array:
        """Area of the triangle from the axis to each edge."""
        first = np.array(self.vertices)
        second = np.roll(first, -1, axis=0)
        return np.asarray((first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2, dtype=np.float64)

    @property
    def area(self) -> float:
        """Area in units of the squared radius of the stop; a full circle has pi."""
        return float(self.fan_areas.sum())

    def holds(self, x: Array, y: Array) -> NDArray[np.bool_]:
        """Return which points, in units of the stop's radius, lie inside."""
        inside = np.zeros(np.shape(x), dtype=bool)
        for (x0, y0), (x1, y1) in zip(self.vertices, (*self.vertices[1:], self.vertices[0]), strict=True):
            if y0 != y1:
                inside ^= ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
        return inside

    def sample(self, u: Array) -> Array:
        """Return points (n, 2) spread evenly over the shape for numbers (n, 3) in [0, 1); none is rejected."""
        edges = np.cumsum(self.fan_areas) / self.area
        k = np.minimum(np.searchsorted(edges, u[:, 0], side="right"), len(edges) - 1)
        first = np.array(self.vertices)
        root = np.sqrt(u[:, 1])
        return np.asarray(
            (root * (1 - u[:, 2]))[:, None] * first[k] + (root * u[:, 2])[:, None] * np.roll(first, -1, axis=0)[k]
        )


def blades(count: int, rotation_degrees: float = 0.0, curvature: float = 0.0) -> StopShape:
    """Return an iris of blades: corners on the circle, edges straight (curvature 0) to circular (1)."""
    if not 3 <= count <= 64:
        raise InputError(f"an iris has 3 to 64 blades (got {count})")
    if not 0 <= curvature <= 1:
        raise InputError(f"the curvature of blades lies between 0 and 1 (got {curvature:g})")
    steps = 1 if curvature == 0 else ARC_STEPS
    angles = np.arange(count * steps) * 2 * np.pi / (count * steps)
    within = np.mod(angles, 2 * np.pi / count) - np.pi / count
    straight = np.cos(np.pi / count) / np.cos(within)
    return _shape(angles, (1 - curvature) * straight + curvature, rotation_degrees)


def star(points: int, inner: float = 0.4, rotation_degrees: float = 90.0) -> StopShape:
    """Return a star whose inner corners lie at a share of the radius."""
    if not 3 <= points <= 64:
        raise InputError(f"a star has 3 to 64 points (got {points})")
    if not 0 < inner < 1:
        raise InputError(f"the inner radius of a star lies between 0 and 1 (got {inner:g})")
    angles = np.arange(2 * points) * np.pi / points
    return _shape(angles, np.where(np.arange(2 * points) % 2 == 0, 1.0, inner), rotation_degrees)


def heart(rotation_degrees: float = 0.0) -> StopShape:
    """Return a heart, upright as seen from the film: x = 16 sin^3 t, y = 13 cos t - 5 cos 2t - 2 cos 3t - cos 4t."""
    t = np.linspace(0.0, 2 * np.pi, 64, endpoint=False)
    x = -16 * np.sin(t) ** 3
    y = 13 * np.cos(t) - 5 * np.cos(2 * t) - 2 * np.cos(3 * t) - np.cos(4 * t)
    radius, angles = np.hypot(x, y), np.arctan2(y, x)
    return _shape(angles, radius / radius.max(), rotation_degrees)


def polygon(points: list[tuple[float, float]]) -> StopShape:
    """Return a polygon of points in units of the stop's radius, in either sense of rotation."""
    flat = np.array(points, dtype=np.float64)
    if flat.ndim == 2 and flat.shape[1] == 2:
        turned = np.roll(flat, -1, axis=0)
        if np.sum(flat[:, 0] * turned[:, 1] - flat[:, 1] * turned[:, 0]) < 0:
            points = points[::-1]
    return StopShape(tuple((float(x), float(y)) for x, y in points))


def _shape(angles: Array, radii: Array, rotation_degrees: float) -> StopShape:
    turn = angles + math.radians(rotation_degrees)
    points = np.stack([radii * np.cos(turn), radii * np.sin(turn)], axis=1)
    return StopShape(tuple((float(x), float(y)) for x, y in points))
