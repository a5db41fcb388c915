"""Shapes of an aperture within the unit circle: outlines and masks, as regions of a stop and cut into triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.errors import InputError
from rptcam_cl.optics.region import Mask, Region

Array = NDArray[np.float64]

ARC_POINTS = 8  # per curved blade
HEART_POINTS = 64


def turned(vertices: Array, degrees: float) -> Array:
    """Return points (n, 2) turned about the centre, from +x towards +y."""
    angle = np.radians(degrees)
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(vertices @ np.array([[c, s], [-s, c]]))


def blades(count: int, curvature: float = 0.0) -> Array:
    """Return the outline of blades whose corners lie on the unit circle; the first corner on +x.

    ``curvature`` is that of each blade's edge times the aperture radius: 0 straight, 1 a full circle.
    """
    corners = _on_circle(np.arange(count) * 2 * np.pi / count)
    if curvature <= 0:
        return corners
    half_chord, middle = np.sin(np.pi / count), np.cos(np.pi / count)
    radius = 1.0 / curvature
    centre = middle - np.sqrt(radius * radius - half_chord * half_chord)  # of the arc, along the blade's normal
    half_angle = np.arcsin(half_chord / radius)
    sweep = np.linspace(-half_angle, half_angle, ARC_POINTS, endpoint=False)
    arc = np.stack([centre + radius * np.cos(sweep), radius * np.sin(sweep)], axis=1)
    return np.concatenate([turned(arc, 180.0 * (2 * k + 1) / count) for k in range(count)])


def star(points: int, inner_radius: float) -> Array:
    """Return a star with tips on the unit circle, the first on +x, and its inner corners at a radius."""
    corners = _on_circle(np.arange(2 * points) * np.pi / points)
    corners[1::2] *= inner_radius
    return corners


def heart() -> Array:
    """Return a heart, tip down, within the unit circle about its centre."""
    t = np.arange(HEART_POINTS) * 2 * np.pi / HEART_POINTS
    x = 16 * np.sin(t) ** 3
    y = 13 * np.cos(t) - 5 * np.cos(2 * t) - 2 * np.cos(3 * t) - np.cos(4 * t)
    return fitted(np.stack([x, y], axis=1)[::-1])


def fitted(vertices: ArrayLike) -> Array:
    """Return an outline moved and scaled so that the circle about the middle of its box holds it and touches it."""
    points = np.array(vertices, dtype=np.float64)
    points -= (points.min(axis=0) + points.max(axis=0)) / 2
    return np.asarray(points / np.hypot(*points.T).max())


def _on_circle(angles: Array) -> Array:
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


@dataclass(frozen=True)
class OutlineRegion(Region):
    """The inside of a polygon of the vertex plane, by the even-odd rule; ``vertices`` are (x, y) pairs [mm]."""

    vertices: tuple[tuple[float, float], ...] = ()

    def edges(self) -> Array:
        """Return (n, 4): y0, y1, x0 and dx/dy of every edge that is not level [mm]."""
        start = np.array(self.vertices)
        end = np.roll(start, -1, axis=0)
        rises = start[:, 1] != end[:, 1]
        start, end = start[rises], end[rises]
        slope = (end[:, 0] - start[:, 0]) / (end[:, 1] - start[:, 1])
        return np.stack([start[:, 1], end[:, 1], start[:, 0], slope], axis=1)

    def holds(self, x: Array, y: Array) -> Mask:
        """Return which points lie inside."""
        inside = np.zeros(np.broadcast(x, y).shape, dtype=bool)
        for y0, y1, x0, slope in self.edges():
            inside ^= ((y0 > y) != (y1 > y)) & (x < x0 + slope * (y - y0))
        return inside


@dataclass(frozen=True, eq=False)
class MaskRegion(Region):
    """The open cells of a square mask of the vertex plane.

    Attributes
    ----------
    cells : (n, n) boolean array
        Row 0 on top (+y), open where true.
    half_side : float
        Half the side of the square [mm].
    """

    cells: Mask = None  # type: ignore[assignment]
    half_side: float = 1.0

    def holds(self, x: Array, y: Array) -> Mask:
        """Return which points lie in an open cell."""
        n = len(self.cells)
        column = np.floor((x / self.half_side + 1) * n / 2)
        row = np.floor((1 - y / self.half_side) * n / 2)
        inside = (column >= 0) & (column < n) & (row >= 0) & (row < n)
        safe_row, safe_column = (np.clip(np.nan_to_num(place), 0, n - 1).astype(int) for place in (row, column))
        return np.asarray(inside & self.cells[safe_row, safe_column])


def triangles(vertices: Array) -> Array:
    """Return the triangles (n, 3, 2) of a simple polygon by cutting off ears.

    Raises
    ------
    InputError
        When the outline crosses itself.
    """
    x, y = vertices.T
    area = np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
    rest = list(vertices if area > 0 else vertices[::-1])
    found = []
    while len(rest) > 3:
        ear = next((i for i in range(len(rest)) if _is_ear(rest, i)), None)
        if ear is None:
            raise InputError("aperture: the outline crosses itself (allowed: a simple polygon)")
        found.append([rest[ear - 1], rest[ear], rest[(ear + 1) % len(rest)]])
        del rest[ear]
    return np.array([*found, rest])


def _is_ear(polygon: list[Array], i: int) -> bool:
    a, b, c = polygon[i - 1], polygon[i], polygon[(i + 1) % len(polygon)]
    if _turn(a, b, c) <= 0:
        return False
    others = (p for p in polygon if p is not a and p is not b and p is not c)
    return not any(_turn(a, b, p) >= 0 and _turn(b, c, p) >= 0 and _turn(c, a, p) >= 0 for p in others)


def _turn(a: Array, b: Array, c: Array) -> float:
    """Return twice the signed area of a triangle, positive counterclockwise."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
