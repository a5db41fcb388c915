"""Flat boards that programs find in pictures: patterns of dark and light, and the points that they find."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import field
from functools import cache
from importlib.resources import files
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.assets.mesh import MeshSurface

# Square markers: the bits of OpenCV's predefined dictionaries.

SIZES = (50, 100, 250, 1000)
APRILTAG = "DICT_APRILTAG_36h11"
APRILTAGS = 587
# Name of each dictionary, with the row of the table that begins with it and how many markers it has.
DICTIONARIES: dict[str, tuple[str, int]] = {
    f"DICT_{side}X{side}_{count}": (f"{side}X{side}", count) for side in (4, 5, 6, 7) for count in SIZES
} | {APRILTAG: ("APRILTAG_36h11", APRILTAGS)}


@cache
def _table() -> dict[str, str]:
    dictionaries: dict[str, str] = json.loads(files(__package__).joinpath("dictionaries.json").read_text("utf-8"))
    return dictionaries


def marker_bits(dictionary: str, number: int) -> NDArray[np.bool_]:
    """Return which cells (side, side) of a marker are light, rows from the top, without its dark border.

    Raises
    ------
    InputError
        When there is no such dictionary or marker.
    """
    if dictionary not in DICTIONARIES:
        raise InputError(f"dictionary: is not known (got {dictionary}; allowed: {', '.join(DICTIONARIES)})")
    row, count = DICTIONARIES[dictionary]
    if not 0 <= number < count:
        raise InputError(f"{dictionary}: has no marker {number} (allowed: 0 to {count - 1})")
    side = 6 if row == "APRILTAG_36h11" else int(row[0])
    digits = -(-side * side // 4)
    value = int(_table()[row][digits * number : digits * (number + 1)], 16)
    return np.array([value >> bit & 1 for bit in range(side * side - 1, -1, -1)], np.bool_).reshape(side, side)


# A pattern under way: dark and light triangles of one plane that touch and never overlap, and its known points.

Array = NDArray[np.float64]
Shape = Literal["dark", "light"]

FLAT = 1e-9  # sine of a corner, below which a triangle has no area
ARC = 96  # corners of a circle, whose area they keep


@dataclass
class Pattern:
    """A pattern in the plane z = 0, x to the right and y up, its middle at the origin; its front faces +z.

    Attributes
    ----------
    width, height : float
        Of all of it.
    corners : list of (x, y)
        The points that it is known by, in their order; ids count from 0.
    markers : list of (id, corners)
        Square markers, with their corners from the upper left one clockwise.
    """

    width: float
    height: float
    corners: list[tuple[float, float]] = field(default_factory=list)
    markers: list[tuple[int, list[tuple[float, float]]]] = field(default_factory=list)
    _triangles: dict[Shape, list[Array]] = field(default_factory=lambda: {"dark": [], "light": []})

    def polygon(self, shape: Shape, points: Sequence[Array | tuple[float, float]]) -> None:
        """Add a convex polygon, its corners counter-clockwise."""
        corners = np.array(points, np.float64)
        for k in range(1, len(corners) - 1):
            (ax, ay), (bx, by) = corners[k] - corners[0], corners[k + 1] - corners[0]
            if ax * by - ay * bx > FLAT * math.hypot(ax, ay) * math.hypot(bx, by):
                self._triangles[shape].append(corners[[0, k, k + 1]])

    def rectangle(self, shape: Shape, x0: float, y0: float, x1: float, y1: float) -> None:
        """Add a rectangle; nothing where it has no area."""
        if x1 > x0 and y1 > y0:
            self.polygon(shape, [(x0, y0), (x1, y0), (x1, y1), (x0, y1)])

    def frame(self, outer: tuple[float, float, float, float], inner: tuple[float, float, float, float]) -> None:
        """Add what lies between two rectangles x0, y0, x1, y1, light."""
        (a, b, c, d), (x0, y0, x1, y1) = outer, inner
        self.rectangle("light", a, b, c, y0)
        self.rectangle("light", a, y1, c, d)
        self.rectangle("light", a, y0, x0, y1)
        self.rectangle("light", x1, y0, c, y1)

    def round_in_square(self, middle: tuple[float, float], radius: float, half: float, sectors: int = 0) -> None:
        """Add a square of half side `half`, light around a disk that is dark, or a star of so many dark sectors."""
        count = 2 * sectors * -(-ARC // (2 * sectors)) if sectors else ARC
        true = radius * math.sqrt(2 * math.pi / count / math.sin(2 * math.pi / count))
        turns = [2 * math.pi * k / count for k in range(count + 1)]
        centre = np.array(middle)
        rim = [centre + true * np.array([math.cos(turn), math.sin(turn)]) for turn in turns]
        for k, (first, second) in enumerate(pairwise(rim)):
            dark = not sectors or (2 * sectors * k // count) % 2 == 0
            self.polygon("dark" if dark else "light", [centre, first, second])
            self._outside(first - centre, second - centre, centre, half)

    def _outside(self, first: Array, second: Array, centre: Array, half: float) -> None:
        """Add what lies between a chord of a disk and the square around it."""
        ends = [point * half / np.abs(point).max() for point in (first, second)]
        sides = [int(np.argmax(np.abs(end))) for end in ends]
        corner = [] if sides[0] == sides[1] else [np.sign(first + second) * half]
        self.polygon("light", [centre + first, *(centre + end for end in (ends[0], *corner, ends[1])), centre + second])

    def surfaces(self) -> list[MeshSurface]:
        """Return the dark part and the light one."""
        return [_surface(self._triangles[shape]) for shape in ("dark", "light") if self._triangles[shape]]

    def described(self, world_from_board: Array) -> dict[str, Any]:
        """Return size and known points, taken to the world by a 4x4 matrix."""

        def there(points: Sequence[tuple[float, float]]) -> list[list[float]]:
            rows = np.array([(x, y, 0.0, 1.0) for x, y in points]).reshape(-1, 4)
            placed: list[list[float]] = (rows @ world_from_board.T)[:, :3].tolist()
            return placed

        said: dict[str, Any] = {"corners": there(self.corners), "ids": list(range(len(self.corners)))}
        if self.markers:
            said["markers"] = [{"id": number, "corners": there(corners)} for number, corners in self.markers]
        return said


def _surface(triangles: list[Array]) -> MeshSurface:
    flat = np.concatenate(triangles)
    positions, faces = np.unique(flat, axis=0, return_inverse=True)
    positions = np.hstack([positions, np.zeros((len(positions), 1))])
    return MeshSurface(positions, faces.reshape(-1, 3).astype(np.int32), None, None)


# The patterns of boards. Rows count from the top; what OpenCV calls a board of n x m has the same order of corners.


def _field(columns: int, rows: int, pitch: float, margin: float) -> tuple[Pattern, float, float]:
    """Return a pattern with a light margin round columns and rows, and their left and upper edges."""
    width, height = columns * pitch, rows * pitch
    pattern = Pattern(width + 2 * margin, height + 2 * margin)
    outer = pattern.width / 2, pattern.height / 2
    pattern.frame((-outer[0], -outer[1], *outer), (-width / 2, -height / 2, width / 2, height / 2))
    return pattern, -width / 2, height / 2


def _inner_corners(pattern: Pattern, columns: int, rows: int, pitch: float, left: float, top: float) -> None:
    pattern.corners += [
        (left + column * pitch, top - row * pitch) for row in range(1, rows) for column in range(1, columns)
    ]


def checker(columns: int, rows: int, pitch: float, margin: float) -> Pattern:
    """Return squares in turns, the upper left one dark; its points are where four meet."""
    pattern, left, top = _field(columns, rows, pitch, margin)
    for row in range(rows):
        for column in range(columns):
            x, y = left + column * pitch, top - row * pitch
            pattern.rectangle("light" if (row + column) % 2 else "dark", x, y - pitch, x + pitch, y)
    _inner_corners(pattern, columns, rows, pitch, left, top)
    return pattern


def charuco(
    columns: int, rows: int, pitch: float, margin: float, fill: float, dictionary: str, first_id: int
) -> Pattern:
    """Return a checker with a marker in each light square, numbered along the rows."""
    pattern, left, top = _field(columns, rows, pitch, margin)
    number = first_id
    for row in range(rows):
        for column in range(columns):
            x, y = left + column * pitch, top - row * pitch
            if (row + column) % 2:
                _marker(pattern, x, y, pitch, fill, dictionary, number)
                number += 1
            else:
                pattern.rectangle("dark", x, y - pitch, x + pitch, y)
    _inner_corners(pattern, columns, rows, pitch, left, top)
    return pattern


def aruco(columns: int, rows: int, pitch: float, margin: float, fill: float, dictionary: str, first_id: int) -> Pattern:
    """Return markers in rows, numbered along them; its points are their corners."""
    pattern, left, top = _field(columns, rows, pitch, margin)
    for index in range(columns * rows):
        row, column = divmod(index, columns)
        _marker(pattern, left + column * pitch, top - row * pitch, pitch, fill, dictionary, first_id + index)
    pattern.corners += [corner for _, corners in pattern.markers for corner in corners]
    return pattern


def _marker(pattern: Pattern, x: float, y: float, pitch: float, fill: float, dictionary: str, number: int) -> None:
    """Add a light square with a marker in its middle."""
    bits = marker_bits(dictionary, number)
    side = fill * pitch
    left, top = x + (pitch - side) / 2, y - (pitch - side) / 2
    pattern.frame((x, y - pitch, x + pitch, y), (left, top - side, left + side, top))
    count = len(bits) + 2
    lines = [side * k / count for k in range(count + 1)]
    for row in range(count):
        start = 0
        for column in range(1, count + 1):
            light = [0 < row < count - 1 and 0 < k < count - 1 and bool(bits[row - 1, k - 1]) for k in range(count)]
            if column == count or light[column] != light[start]:
                shape: Shape = "light" if light[start] else "dark"
                pattern.rectangle(
                    shape, left + lines[start], top - lines[row + 1], left + lines[column], top - lines[row]
                )
                start = column
    right, bottom = left + side, top - side
    pattern.markers.append((number, [(left, top), (right, top), (right, bottom), (left, bottom)]))


def circles(columns: int, rows: int, pitch: float, margin: float, fill: float) -> Pattern:
    """Return dark disks in rows; its points are their middles."""
    pattern, left, top = _field(columns, rows, pitch, margin)
    for row in range(rows):
        for column in range(columns):
            middle = left + (column + 0.5) * pitch, top - (row + 0.5) * pitch
            pattern.round_in_square(middle, fill * pitch / 2, pitch / 2)
            pattern.corners.append(middle)
    return pattern


def siemens(side: float, margin: float, fill: float, sectors: int) -> Pattern:
    """Return a star of dark and light sectors, the first dark one going up from the right; its point is the middle."""
    pattern, _, _ = _field(1, 1, side, margin)
    pattern.round_in_square((0.0, 0.0), fill * side / 2, side / 2, sectors)
    pattern.corners.append((0.0, 0.0))
    return pattern


def slanted_edge(side: float, margin: float, angle_degrees: float) -> Pattern:
    """Return a square, dark left of an edge that leans to the right by an angle; its points are the edge's ends."""
    pattern, _, _ = _field(1, 1, side, margin)
    half, lean = side / 2, side / 2 * math.tan(math.radians(angle_degrees))
    pattern.polygon("dark", [(-half, -half), (-lean, -half), (lean, half), (-half, half)])
    pattern.polygon("light", [(-lean, -half), (half, -half), (half, half), (lean, half)])
    pattern.corners += [(lean, half), (-lean, -half)]
    return pattern
