"""Shapes of an aperture stop: blades, stars, hearts and polygons inside the unit circle, which is the round stop."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError

Array = NDArray[np.float64]

ARC_STEPS = 16  # straight pieces of a curved blade edge
MOST_VERTICES = 1024
SMALLEST_VIEW = 1e-6  # area that sees all of a shape, below which rounding might place its middle outside


@dataclass(frozen=True)
class StopShape:
    """A polygon that does not cross itself, inside the unit circle.

    Attributes
    ----------
    vertices : tuple of (x, y)
        In order, in units of the stop's radius; x to the right and y upwards as seen from the film.
    """

    vertices: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        points = np.array(self.vertices, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 2 or not 3 <= len(points) <= MOST_VERTICES:
            raise InputError(f"a stop shape needs 3 to {MOST_VERTICES} points [x, y]")
        if not np.all(np.isfinite(points)) or np.max(np.hypot(*points.T)) > 1 + 1e-9:
            raise InputError("the points of a stop shape must lie inside the unit circle")
        if not self.area > 0:
            raise InputError("a stop shape must enclose an area")

    @cached_property
    def triangles(self) -> Array:
        """Triangles (n, 3, 2) that make up the shape: a fan where one point sees all of it.

        Raises
        ------
        InputError
            When the outline crosses itself.
        """
        vertices = np.array(self.vertices, dtype=np.float64)
        if _crosses_itself(vertices):
            raise InputError("the outline of a stop shape crosses itself (allowed: a simple polygon)")
        counter_clockwise = vertices if _signed_area(vertices) > 0 else vertices[::-1]
        middle = _sees_all(counter_clockwise)
        if middle is None:
            return cut_ears(counter_clockwise)
        apex = np.broadcast_to(middle, counter_clockwise.shape)
        return np.stack([apex, counter_clockwise, np.roll(counter_clockwise, -1, axis=0)], axis=1)

    @cached_property
    def triangle_areas(self) -> Array:
        """Their areas."""
        first, second = (self.triangles[:, k] - self.triangles[:, 0] for k in (1, 2))
        return np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2

    @property
    def area(self) -> float:
        """Area in units of the squared radius of the stop; a full circle has pi."""
        return float(self.triangle_areas.sum())

    def edges(self) -> Array:
        """Return (n, 4): y0, y1, x0 and dx/dy of every edge that is not level."""
        start = np.array(self.vertices, dtype=np.float64)
        end = np.roll(start, -1, axis=0)
        rises = start[:, 1] != end[:, 1]
        start, end = start[rises], end[rises]
        slope = (end[:, 0] - start[:, 0]) / (end[:, 1] - start[:, 1])
        return np.stack([start[:, 1], end[:, 1], start[:, 0], slope], axis=1)

    def holds(self, x: Array, y: Array) -> NDArray[np.bool_]:
        """Return which points, in units of the stop's radius, lie inside."""
        inside = np.zeros(np.shape(x), dtype=bool)
        for y0, y1, x0, slope in self.edges():
            inside ^= ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) * slope)
        return inside

    def sample(self, u: Array) -> Array:
        """Return points (n, 2) spread evenly over the shape for numbers (n, 3) in [0, 1); none is rejected."""
        ends = np.cumsum(self.triangle_areas) / self.area
        k = np.minimum(np.searchsorted(ends, u[:, 0], side="right"), len(ends) - 1)
        corner, first, second = (self.triangles[k, i] for i in range(3))
        root = np.sqrt(u[:, 1])
        a, b = (root * (1 - u[:, 2]))[:, None], (root * u[:, 2])[:, None]
        return np.asarray(corner + a * (first - corner) + b * (second - corner))


@dataclass(frozen=True, eq=False)
class StopMask:
    """A square grid of open and closed cells; its inscribed circle is the stop's.

    Attributes
    ----------
    cells : (n, n) boolean array
        Row 0 on top (+y), open where true.
    """

    cells: NDArray[np.bool_]

    @property
    def area(self) -> float:
        """Of the open cells, in units of the square of the stop's radius."""
        return float(self.cells.mean()) * 4.0

    def holds(self, x: Array, y: Array) -> NDArray[np.bool_]:
        """Return which points, in units of the stop's radius, lie in an open cell."""
        count = len(self.cells)
        places = (np.floor((1 - y) * count / 2), np.floor((1 + x) * count / 2))
        inside = np.logical_and.reduce([(place >= 0) & (place < count) for place in places])
        row, column = (np.where(inside, place, 0).astype(np.intp) for place in places)
        return np.asarray(inside & self.cells[row, column])


def fit_to_stop(points: ArrayLike) -> Array:
    """Return points (n, 2) moved and scaled so that the circle about the middle of their box holds them and touches."""
    moved = np.array(points, dtype=np.float64)
    moved -= (moved.min(axis=0) + moved.max(axis=0)) / 2
    return np.asarray(moved / np.hypot(*moved.T).max())


def cut_ears(vertices: Array) -> Array:
    """Return triangles (n, 3, 2) that make up a counter-clockwise polygon, cutting off one corner after the other."""
    rest = list(vertices)
    triangles = []
    while len(rest) > 3:
        # Corners in one line are no ears; where rounding leaves nothing else, any corner may go.
        ear = next((i for i in range(len(rest)) if _is_ear(rest, i)), 0)
        triangles.append([rest[ear - 1], rest[ear], rest[(ear + 1) % len(rest)]])
        del rest[ear]
    return np.array([*triangles, rest])


def _signed_area(vertices: Array) -> float:
    """Return the area of a polygon, positive counter-clockwise."""
    x, y = vertices.T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2


def cut_polygon(polygon: Array, side: Array) -> Array:
    """Return the part of a polygon (n, any) on one side of a plane; ``side`` (n,) grows with the distance from it.

    Sutherland and Hodgman 1974.
    """
    following, after = np.roll(polygon, -1, axis=0), np.roll(side, -1)
    crossing = (side < 0) != (after < 0)
    share = np.where(crossing, side / np.where(crossing, side - after, 1.0), 0.0)[:, None]
    both = np.stack([polygon, polygon + share * (following - polygon)], axis=1)
    return np.asarray(both[np.stack([side >= 0, crossing], axis=1)])


def _sees_all(vertices: Array) -> Array | None:
    """Return a point (2,) from which all of a counter-clockwise polygon is seen; None where there is next to none."""
    seen = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])  # what lies left of every edge
    for start, end in zip(vertices, np.roll(vertices, -1, axis=0), strict=True):
        along = end - start
        seen = cut_polygon(seen, along[0] * (seen[:, 1] - start[1]) - along[1] * (seen[:, 0] - start[0]))
        if len(seen) < 3:
            return None
    return np.asarray(seen.mean(axis=0)) if _signed_area(seen) > SMALLEST_VIEW else None


def _crosses_itself(vertices: Array) -> bool:
    """Return whether two edges of a polygon cross."""
    start, along = vertices, np.roll(vertices, -1, axis=0) - vertices

    def sides(of: Array) -> Array:
        """On which side of edge i (rows) each point of `of` lies."""
        away = of[None, :, :] - start[:, None, :]
        return np.asarray(np.sign(along[:, None, 0] * away[..., 1] - along[:, None, 1] * away[..., 0]))

    parted = sides(start) * sides(np.roll(start, -1, axis=0)) < 0
    return bool(np.any(parted & parted.T))


def _is_ear(polygon: list[Array], i: int) -> bool:
    a, b, c = polygon[i - 1], polygon[i], polygon[(i + 1) % len(polygon)]
    if _turn(a, b, c) <= 0:
        return False
    others = (p for p in polygon if p is not a and p is not b and p is not c)
    return not any(_turn(a, b, p) >= 0 and _turn(b, c, p) >= 0 and _turn(c, a, p) >= 0 for p in others)


def _turn(a: Array, b: Array, c: Array) -> float:
    """Return twice the signed area of a triangle, positive counter-clockwise."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


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


def polygon(points: ArrayLike, rotation_degrees: float = 0.0) -> StopShape:
    """Return a polygon of points in units of the stop's radius, turned from +x towards +y."""
    flat = np.array(points, dtype=np.float64)
    if flat.ndim != 2 or flat.shape[1] != 2:
        raise InputError("a stop shape is a list of points [x, y]")
    if rotation_degrees:
        c, s = math.cos(math.radians(rotation_degrees)), math.sin(math.radians(rotation_degrees))
        flat = flat @ np.array([[c, s], [-s, c]])
    return StopShape(tuple((float(x), float(y)) for x, y in flat))


def _shape(angles: Array, radii: Array, rotation_degrees: float) -> StopShape:
    turn = angles + math.radians(rotation_degrees)
    points = np.stack([radii * np.cos(turn), radii * np.sin(turn)], axis=1)
    return StopShape(tuple((float(x), float(y)) for x, y in points))
