"""A pattern under way: dark and light triangles of one plane that touch and never overlap, and its known points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes import MeshSurface
from rptcam_cl.core.dataclass import dataclass

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
        for k in range(count):
            dark = not sectors or (2 * sectors * k // count) % 2 == 0
            self.polygon("dark" if dark else "light", [centre, rim[k], rim[k + 1]])
            self._outside(rim[k] - centre, rim[k + 1] - centre, centre, half)

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
            found: list[list[float]] = (rows @ world_from_board.T)[:, :3].tolist()
            return found

        said: dict[str, Any] = {"corners": there(self.corners), "ids": list(range(len(self.corners)))}
        if self.markers:
            said["markers"] = [{"id": number, "corners": there(corners)} for number, corners in self.markers]
        return said


def _surface(triangles: list[Array]) -> MeshSurface:
    flat = np.concatenate(triangles)
    positions, faces = np.unique(flat, axis=0, return_inverse=True)
    positions = np.hstack([positions, np.zeros((len(positions), 1))])
    return MeshSurface(positions, faces.reshape(-1, 3).astype(np.int32), None, None)
