"""The patterns of boards. Rows count from the top; what OpenCV calls a board of n x m has the same order of corners."""

from __future__ import annotations

import math

from rptcam_cl.assets.boards.markers import marker_bits
from rptcam_cl.assets.boards.pattern import Pattern, Shape


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
