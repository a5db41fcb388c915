"""Objects: a shape, its material and where it is placed; boards for calibration and measurement."""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Sequence
from dataclasses import field
from functools import cache, cached_property
from importlib.resources import files
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, field_validator, model_validator

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import Folders
from rptcam_cl.scene import assets
from rptcam_cl.scene.assets.mesh import Draft, MeshSurface, make_contents
from rptcam_cl.scene.base import Alternatives, refuse, unknown_name
from rptcam_cl.scene.materials import Conductor, Hair, Material, Matte, Mix, Plastic, Principled, Translucent, has_holes
from rptcam_cl.scene.meshes import LoadedMesh, MeshObject, WidePoints
from rptcam_cl.scene.placement import Bounds, PlacedObject, SceneObject
from rptcam_cl.scene.quantities import NUMBER, SMALLEST_LENGTH, WHOLE_NUMBER, Direction, Length, Position, cross

# Flat boards that programs find in pictures: patterns of dark and light, and the points that they find.

# Square markers: the bits of OpenCV's predefined dictionaries.

_SIZES = (50, 100, 250, 1000)
_APRILTAG = "DICT_APRILTAG_36h11"
_APRILTAGS = 587
# Name of each dictionary, with the row of the table that begins with it and how many markers it has.
DICTIONARIES: dict[str, tuple[str, int]] = {
    f"DICT_{side}X{side}_{count}": (f"{side}X{side}", count) for side in (4, 5, 6, 7) for count in _SIZES
} | {_APRILTAG: ("APRILTAG_36h11", _APRILTAGS)}


@cache
def _table() -> dict[str, str]:
    dictionaries: dict[str, str] = json.loads(files(assets).joinpath("dictionaries.json").read_text("utf-8"))
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
_ARC = 96  # corners of a circle, whose area they keep


@dataclass
class BoardPattern:
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
        count = 2 * sectors * -(-_ARC // (2 * sectors)) if sectors else _ARC
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


def _field(columns: int, rows: int, pitch: float, margin: float) -> tuple[BoardPattern, float, float]:
    """Return a pattern with a light margin round columns and rows, and their left and upper edges."""
    width, height = columns * pitch, rows * pitch
    pattern = BoardPattern(width + 2 * margin, height + 2 * margin)
    outer = pattern.width / 2, pattern.height / 2
    pattern.frame((-outer[0], -outer[1], *outer), (-width / 2, -height / 2, width / 2, height / 2))
    return pattern, -width / 2, height / 2


def _inner_corners(pattern: BoardPattern, columns: int, rows: int, pitch: float, left: float, top: float) -> None:
    pattern.corners += [
        (left + column * pitch, top - row * pitch) for row in range(1, rows) for column in range(1, columns)
    ]


def _checker(columns: int, rows: int, pitch: float, margin: float) -> BoardPattern:
    """Return squares in turns, the upper left one dark; its points are where four meet."""
    pattern, left, top = _field(columns, rows, pitch, margin)
    for row in range(rows):
        for column in range(columns):
            x, y = left + column * pitch, top - row * pitch
            pattern.rectangle("light" if (row + column) % 2 else "dark", x, y - pitch, x + pitch, y)
    _inner_corners(pattern, columns, rows, pitch, left, top)
    return pattern


def _charuco(
    columns: int, rows: int, pitch: float, margin: float, fill: float, dictionary: str, first_id: int
) -> BoardPattern:
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


def _aruco(
    columns: int, rows: int, pitch: float, margin: float, fill: float, dictionary: str, first_id: int
) -> BoardPattern:
    """Return markers in rows, numbered along them; its points are their corners."""
    pattern, left, top = _field(columns, rows, pitch, margin)
    for index in range(columns * rows):
        row, column = divmod(index, columns)
        _marker(pattern, left + column * pitch, top - row * pitch, pitch, fill, dictionary, first_id + index)
    pattern.corners += [corner for _, corners in pattern.markers for corner in corners]
    return pattern


def _marker(pattern: BoardPattern, x: float, y: float, pitch: float, fill: float, dictionary: str, number: int) -> None:
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


def _circles(columns: int, rows: int, pitch: float, margin: float, fill: float) -> BoardPattern:
    """Return dark disks in rows; its points are their middles."""
    pattern, left, top = _field(columns, rows, pitch, margin)
    for row in range(rows):
        for column in range(columns):
            middle = left + (column + 0.5) * pitch, top - (row + 0.5) * pitch
            pattern.round_in_square(middle, fill * pitch / 2, pitch / 2)
            pattern.corners.append(middle)
    return pattern


def _siemens(side: float, margin: float, fill: float, sectors: int) -> BoardPattern:
    """Return a star of dark and light sectors, the first dark one going up from the right; its point is the middle."""
    pattern, _, _ = _field(1, 1, side, margin)
    pattern.round_in_square((0.0, 0.0), fill * side / 2, side / 2, sectors)
    pattern.corners.append((0.0, 0.0))
    return pattern


def _slanted_edge(side: float, margin: float, angle_degrees: float) -> BoardPattern:
    """Return a square, dark left of an edge that leans to the right by an angle; its points are the edge's ends."""
    pattern, _, _ = _field(1, 1, side, margin)
    half, lean = side / 2, side / 2 * math.tan(math.radians(angle_degrees))
    pattern.polygon("dark", [(-half, -half), (-lean, -half), (lean, half), (-half, half)])
    pattern.polygon("light", [(-lean, -half), (half, -half), (half, half), (lean, half)])
    pattern.corners += [(lean, half), (-lean, -half)]
    return pattern


# Boards for calibration and measurement: flat patterns whose points pictures are to show where metadata say.

Kind = Literal["checker", "charuco", "aruco", "circles", "siemens", "slanted_edge"]
_MOST_SQUARES = 200  # across or down
# The kinds that read a key, where not all do.
_OF_KINDS: dict[str, tuple[Kind, ...]] = {
    "columns": ("checker", "charuco", "aruco", "circles"),
    "rows": ("checker", "charuco", "aruco", "circles"),
    "fill": ("charuco", "aruco", "circles", "siemens"),
    "dictionary": ("charuco", "aruco"),
    "first_id": ("charuco", "aruco"),
    "sectors": ("siemens",),
    "angle_degrees": ("slanted_edge",),
}


class Board(PlacedObject):
    """A flat board in the plane z = 0 of its own frame, its middle at the origin, x to the right, its front to +z.

    The metadata of pictures have the points that it is known by.
    """

    shape: Literal["board"]
    """Kind of shape."""

    kind: Kind
    """What is on it."""

    columns: Annotated[int, Field(ge=1, le=_MOST_SQUARES), WHOLE_NUMBER] = 7
    """Squares, markers or circles across."""

    rows: Annotated[int, Field(ge=1, le=_MOST_SQUARES), WHOLE_NUMBER] = 5
    """Squares, markers or circles down."""

    pitch: Length = 0.03
    """Side of a square, of a star or of the square with an edge; distance of markers or circles [scene units]."""

    fill: Annotated[float, Field(ge=0.01, le=0.99), NUMBER] = 0.75
    """Share of the pitch that a marker's side or the diameter of a circle or star takes."""

    margin: Annotated[float, Field(ge=0, le=100), NUMBER] = 0.5
    """Width of the light margin, in pitches."""

    dictionary: str = "DICT_4X4_50"
    """OpenCV's name of the dictionary of the markers."""

    first_id: Annotated[int, Field(ge=0, le=999), WHOLE_NUMBER] = 0
    """Number of the first marker."""

    sectors: Annotated[int, Field(ge=2, le=360), WHOLE_NUMBER] = 36
    """Dark sectors of a star."""

    angle_degrees: Annotated[float, Field(ge=-44, le=44), NUMBER] = 5.0
    """By how much an edge leans to the right of upright."""

    dark: Annotated[float, Field(ge=0, le=1), NUMBER] = 0.03
    """Reflectance of what is dark."""

    light: Annotated[float, Field(ge=0, le=1), NUMBER] = 0.85
    """Reflectance of what is light."""

    @field_validator("dictionary")
    @classmethod
    def _check_dictionary(cls, name: str) -> str:
        if name not in DICTIONARIES:
            raise unknown_name("is no known dictionary", name, DICTIONARIES)
        return name

    @model_validator(mode="after")
    def _check_keys(self) -> Self:
        for key, kinds in _OF_KINDS.items():
            if key in self.model_fields_set and self.kind not in kinds:
                allowed = f"with kind {' or '.join(kinds)}"
                raise refuse(f"means nothing on a board of kind {self.kind}", got=getattr(self, key), allowed=allowed,
                             path=(key,))  # fmt: skip
        if self.instances is not None:
            raise refuse("does not go with a board, whose points are known", path=("instances",))
        if self.kind in ("checker", "charuco") and min(self.columns, self.rows) < 2:
            key = "columns" if self.columns < 2 else "rows"
            raise refuse("leaves no corner where squares meet", got=1, allowed="2 or more", path=(key,))
        if self.kind in ("charuco", "aruco"):
            squares = self.columns * self.rows
            last = self.first_id + (squares if self.kind == "aruco" else squares // 2) - 1
            _, count = DICTIONARIES[self.dictionary]
            if last >= count:
                raise refuse(
                    f"has fewer markers than the board needs, up to number {last}", got=self.dictionary,
                    allowed=f"a larger dictionary, or fewer squares (this one has 0 to {count - 1})",
                    path=("dictionary",),
                )  # fmt: skip
        return self

    @cached_property
    def pattern(self) -> BoardPattern:
        """What is on it [scene units]."""
        size, margin = (self.columns, self.rows, self.pitch, self.margin * self.pitch), self.margin * self.pitch
        match self.kind:
            case "checker":
                return _checker(*size)
            case "charuco":
                return _charuco(*size, self.fill, self.dictionary, self.first_id)
            case "aruco":
                return _aruco(*size, self.fill, self.dictionary, self.first_id)
            case "circles":
                return _circles(*size, self.fill)
            case "siemens":
                return _siemens(self.pitch, margin, self.fill, self.sectors)
            case "slanted_edge":
                return _slanted_edge(self.pitch, margin, self.angle_degrees)

    @cached_property
    def loaded(self) -> LoadedMesh:
        """Its dark and its light triangles, with the material of each."""
        contents = make_contents(Draft(self.pattern.surfaces()), "the board")
        return LoadedMesh(self, contents, self.shown_materials())

    @cached_property
    def _materials(self) -> tuple[Material, ...]:
        return tuple(Matte(kind="matte", reflectance=(value, value, value)) for value in (self.dark, self.light))

    def shown_materials(self) -> tuple[Material, ...]:
        """Return the dark material and the light one."""
        return self._materials

    def bounds(self) -> Bounds:
        """Return the lowest and highest corner of the board."""
        corner = np.array([self.pattern.width / 2, self.pattern.height / 2, 0.0])
        return -corner, corner

    def contains(self, point: NDArray[np.float64]) -> bool:
        """Return that no point lies inside."""
        return False

    def described(self, index: int, time_s: float, metres_per_unit: float) -> dict[str, Any]:
        """Describe the board at a moment, for the metadata of a picture: its points in the axes of the scene [m]."""
        world = np.diag([metres_per_unit] * 3 + [1.0]) @ self.placed_at(time_s)
        keys = [key for key in ("columns", "rows", "fill", "dictionary", "first_id", "sectors", "angle_degrees")
                if self.kind in _OF_KINDS[key]]  # fmt: skip
        said = {"object": index, "name": self.name or f"objects.{index}", "kind": self.kind}
        said |= {"pitch_m": self.pitch * metres_per_unit} | {key: getattr(self, key) for key in keys}
        return said | self.pattern.described(world)


# Objects: a shape, its material and where it is placed.


def _disk_reach(normal: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """Return how far a disk reaches from its centre along x, y and z."""
    unit = normal / np.linalg.norm(normal)
    return np.asarray(radius * np.sqrt(np.clip(1 - unit**2, 0, 1)))


_ROUND = 32  # corners that stand for a circle


def _polygon(center: tuple[float, ...], normal: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """Return corners (n, 3) on a circle."""
    across = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    across /= np.linalg.norm(across)
    down = np.cross(normal / np.linalg.norm(normal), across)
    angles = 2 * np.pi * np.arange(_ROUND)[:, None] / _ROUND
    return np.asarray(center + radius * (np.cos(angles) * across + np.sin(angles) * down))


class Sphere(SceneObject):
    """A sphere; u runs once round its z axis, v from the lowest point (-z) to the highest."""

    shape: Literal["sphere"]
    """Kind of shape."""

    center: Position
    """Centre [scene units]."""

    radius: Length
    """Radius [scene units]."""

    def bounds(self) -> Bounds:
        """Return the lowest and highest corner of the sphere."""
        center = np.array(self.center)
        return center - self.radius, center + self.radius

    def contains(self, point: NDArray[np.float64]) -> bool:
        """Return whether a point lies inside the sphere."""
        return bool(np.linalg.norm(point - self.center) < self.radius)


class Disk(SceneObject):
    """A flat disk; u and v are the in-plane coordinates divided by the radius, -1 to 1."""

    shape: Literal["disk"]
    """Kind of shape."""

    center: Position
    """Centre [scene units]."""

    normal: Direction
    """Direction of the front side; any length."""

    radius: Length
    """Radius [scene units]."""

    def bounds(self) -> Bounds:
        """Return the lowest and highest corner of the disk."""
        center, reach = np.array(self.center), _disk_reach(np.array(self.normal), self.radius)
        return center - reach, center + reach

    def flat_faces(self) -> list[NDArray[np.float64]]:
        """Return the corners of a polygon in the disk."""
        return [_polygon(self.center, np.array(self.normal), self.radius)]


class Rectangle(SceneObject):
    """A flat parallelogram; u and v run from 0 to 1 along its edges, the normal is edge_u x edge_v."""

    shape: Literal["rectangle"]
    """Kind of shape."""

    corner: Position
    """The corner where u = v = 0 [scene units]."""

    edge_u: Direction
    """Edge from the corner along u [scene units]."""

    edge_v: Direction
    """Edge from the corner along v [scene units]."""

    @model_validator(mode="after")
    def _check_area(self) -> Self:
        u, v = np.array(self.edge_u), np.array(self.edge_v)
        if np.linalg.norm(cross(u / np.linalg.norm(u), v / np.linalg.norm(v))) < 1e-6:
            raise refuse("is parallel to edge_u, so the rectangle has no area", got=list(self.edge_v), path=("edge_v",))
        return self

    def bounds(self) -> Bounds:
        """Return the lowest and highest corner of the rectangle."""
        [corners] = self.flat_faces()
        return corners.min(axis=0), corners.max(axis=0)

    def flat_faces(self) -> list[NDArray[np.float64]]:
        """Return the corners of the rectangle in turn."""
        corner, u, v = np.array(self.corner), np.array(self.edge_u), np.array(self.edge_v)
        return [np.array([corner, corner + u, corner + u + v, corner + v])]


class Box(SceneObject):
    """A box along the axes; u and v run from 0 to 1 over each face, along its two axes in alphabetical order."""

    shape: Literal["box"]
    """Kind of shape."""

    min: Position
    """Corner of lowest coordinates [scene units]."""

    max: Position
    """Corner of highest coordinates [scene units]."""

    @model_validator(mode="after")
    def _check_volume(self) -> Self:
        for index, (low, high) in enumerate(zip(self.min, self.max, strict=True)):
            if high - low < SMALLEST_LENGTH:
                raise refuse("is not above min", got=high, allowed=f"more than {low:g}", path=("max", index))
        return self

    def bounds(self) -> Bounds:
        """Return the lowest and highest corner of the box."""
        return np.array(self.min), np.array(self.max)

    def contains(self, point: NDArray[np.float64]) -> bool:
        """Return whether a point lies inside the box."""
        return bool(np.all(point > self.min) and np.all(point < self.max))

    def flat_faces(self) -> list[NDArray[np.float64]]:
        """Return the corners of the six sides, each in turn."""
        sides = []
        for axis in range(3):
            turn = np.roll([[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]], axis, axis=1)
            sides += [np.where(turn + end * np.eye(3, dtype=int)[axis], self.max, self.min) for end in (0, 1)]
        return sides


class Cylinder(SceneObject):
    """A circular cylinder; u runs once round the axis, v from base to top."""

    shape: Literal["cylinder"]
    """Kind of shape."""

    base: Position
    """Centre of the lower end [scene units]."""

    top: Position
    """Centre of the upper end [scene units]."""

    radius: Length
    """Radius [scene units]."""

    capped: bool = Field(default=True, strict=True)
    """Whether both ends are closed by disks."""

    @model_validator(mode="after")
    def _check_height(self) -> Self:
        _check_apart(self.base, self.top, "top")
        return self

    def bounds(self) -> Bounds:
        """Return the lowest and highest corner of the cylinder."""
        base, top = np.array(self.base), np.array(self.top)
        reach = _disk_reach(top - base, self.radius)
        return np.minimum(base, top) - reach, np.maximum(base, top) + reach

    def contains(self, point: NDArray[np.float64]) -> bool:
        """Return whether a point lies inside the closed cylinder."""
        height, distance = _along_axis(point, np.array(self.base), np.array(self.top))
        return self.capped and 0 < height < 1 and distance < self.radius

    def flat_faces(self) -> list[NDArray[np.float64]]:
        """Return the corners of a polygon in each closed end."""
        axis = np.subtract(self.top, self.base)
        return [_polygon(end, axis, self.radius) for end in (self.base, self.top)] if self.capped else []


class Cone(SceneObject):
    """A circular cone; u runs once round the axis, v from base to apex."""

    shape: Literal["cone"]
    """Kind of shape."""

    base: Position
    """Centre of the base [scene units]."""

    apex: Position
    """Tip [scene units]."""

    radius: Length
    """Radius of the base [scene units]."""

    capped: bool = Field(default=True, strict=True)
    """Whether the base is closed by a disk."""

    @model_validator(mode="after")
    def _check_height(self) -> Self:
        _check_apart(self.base, self.apex, "apex")
        return self

    def bounds(self) -> Bounds:
        """Return the lowest and highest corner of the cone."""
        base, apex = np.array(self.base), np.array(self.apex)
        reach = _disk_reach(apex - base, self.radius)
        return np.minimum(base - reach, apex), np.maximum(base + reach, apex)

    def contains(self, point: NDArray[np.float64]) -> bool:
        """Return whether a point lies inside the closed cone."""
        height, distance = _along_axis(point, np.array(self.base), np.array(self.apex))
        return self.capped and 0 < height < 1 and distance < self.radius * (1 - height)

    def flat_faces(self) -> list[NDArray[np.float64]]:
        """Return the corners of a polygon in the closed base."""
        axis = np.subtract(self.apex, self.base)
        return [_polygon(self.base, axis, self.radius)] if self.capped else []


class Plane(SceneObject):
    """An infinite plane; u and v are scene units along x and y of the frame that turns +z into the normal."""

    shape: Literal["plane"]
    """Kind of shape."""

    point: Position
    """A point of the plane, where u = v = 0 [scene units]."""

    normal: Direction
    """Direction of the front side; any length."""

    def contains(self, point: NDArray[np.float64]) -> bool:
        """Return whether a point lies behind the plane."""
        return bool((point - self.point) @ np.array(self.normal) < 0)


# Hair, fur, grass and wires: cubic curves with a width.

Basis = Literal["linear", "bezier", "bspline", "catmull_rom"]
_FEWEST: dict[str, int] = {"linear": 2, "bezier": 4, "bspline": 4, "catmull_rom": 2}
_MOST_POINTS = 1 << 22
# Bézier points of a piece from four points in a row.
_BEZIER_FROM = {
    "bezier": np.eye(4),
    "bspline": np.array([[1, 4, 1, 0], [0, 4, 2, 0], [0, 2, 4, 0], [0, 1, 4, 1]]) / 6,
    "catmull_rom": np.array([[0, 6, 0, 0], [-1, 6, 1, 0], [0, 1, 6, -1], [0, 0, 6, 0]]) / 6,
}


def bezier_pieces(points: Array, basis: Basis) -> Array:
    """Return the Bézier points (strands, pieces, 4, k) of strands of as many points each, (strands, n, k)."""
    if basis == "linear":
        first, last = points[:, :-1, None], points[:, 1:, None]
        return np.asarray(first + np.arange(4)[:, None] / 3 * (last - first))
    if basis == "catmull_rom":
        before, after = 2 * points[:, :1] - points[:, 1:2], 2 * points[:, -1:] - points[:, -2:-1]
        points = np.concatenate([before, points, after], axis=1)
    step = 3 if basis == "bezier" else 1
    rows = np.stack([points[:, k : points.shape[1] - 3 + k : step] for k in range(4)], axis=2)
    return np.asarray(_BEZIER_FROM[basis] @ rows)


class Curves(SceneObject):
    """Strands of cubic curves with a width: hair, fur, grass, wires; u runs along each strand, v across it."""

    shape: Literal["curves"]
    """Kind of shape."""

    points: WidePoints | None = None
    """Points of all strands, one strand after the other: a list of [x, y, z, width] [scene units]."""

    counts: tuple[Annotated[int, Field(ge=2), WHOLE_NUMBER], ...] = ()
    """How many points each strand has; without it all are one strand."""

    file: str | None = None
    """NumPy file (.npz) with the arrays `points` (n, 4) and `counts`, in place of both."""

    basis: Basis = "catmull_rom"
    """What the points are: `catmull_rom` strands pass through them; `bezier`, `bspline` or `linear`."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (Alternatives(("points", "file"), required=True),)

    form: Literal["tube", "flat"] = "tube"
    """Whether it is shaded as a tube, or as a flat ribbon; both turn to whoever sees them."""

    @model_validator(mode="before")
    @classmethod
    def _read_file(cls, data: Any, info: ValidationInfo) -> Any:
        if not isinstance(data, dict) or data.get("file") is None:
            return data
        if "points" in data or "counts" in data:
            raise refuse("does not go with points and counts", got=data["file"], path=("file",), allowed="one of both")
        folders = info.context["folders"] if info.context else Folders()
        try:
            with np.load(folders.find(data["file"]), allow_pickle=False) as content:
                arrays = {name: content[name] for name in ("points", "counts") if name in content}
        except InputError as problem:
            raise refuse(str(problem), path=("file",)) from None
        except (OSError, ValueError, EOFError, AttributeError, zipfile.BadZipFile) as problem:
            raise refuse(f"is no .npz file of NumPy: {str(problem).splitlines()[0]}", path=("file",)) from None
        if "points" not in arrays:
            raise refuse("has no array `points`", path=("file",), allowed="points (n, 4) and perhaps counts")
        counts = arrays.get("counts", np.zeros(0, int)).ravel().tolist()
        own = {key: value for key, value in data.items() if key != "file"}
        return own | {"points": arrays["points"], "counts": counts}

    @model_validator(mode="after")
    def _check_strands(self) -> Self:
        rows = self.rows
        total, sizes = len(rows), self.sizes
        if sum(sizes) != total:
            allowed = f"a sum of {total}"
            raise refuse(f"does not add up to the {total} points", got=sum(sizes), path=("counts",), allowed=allowed)
        if not 0 < total <= _MOST_POINTS:
            raise refuse("has too few or too many points", got=total, path=("points",), allowed=f"2 to {_MOST_POINTS}")
        least = _FEWEST[self.basis]
        for index, size in enumerate(sizes):
            if size < least or (self.basis == "bezier" and size % 3 != 1):
                allowed = "4, 7, 10 … points" if self.basis == "bezier" else f"at least {least} points"
                what = f"makes no strand of basis {self.basis}"
                raise refuse(what, got=size, path=("counts", index), allowed=allowed)
        if (rows[:, 3] < 0).any():
            index = int(np.argmin(rows[:, 3]))
            raise refuse("is negative", got=float(rows[index, 3]), path=("points", index, 3), allowed="0 or more")
        _check_strand_material(self.material)
        return self

    @property
    def rows(self) -> Array:
        """Points and widths (n, 4)."""
        assert self.points is not None
        return self.points.rows

    @property
    def sizes(self) -> tuple[int, ...]:
        """Points of each strand."""
        return self.counts or (len(self.rows),)

    @cached_property
    def pieces(self) -> tuple[Array, Array, Array]:
        """Bézier points of all pieces (n, 4, 3), widths at their ends and places along their strands (n, 2)."""
        sizes = np.array(self.sizes)
        starts = np.cumsum(sizes) - sizes
        parts, spans = [], []
        for size in np.unique(sizes):
            rows = self.rows[starts[sizes == size][:, None] + np.arange(size)]
            of_strand = bezier_pieces(rows, self.basis)
            strands, pieces = of_strand.shape[:2]
            parts.append(of_strand.reshape(-1, 4, 4))
            ends = np.arange(pieces + 1) / pieces
            spans.append(np.tile(np.stack([ends[:-1], ends[1:]], axis=1), (strands, 1)))
        whole = np.concatenate(parts)
        return whole[:, :, :3], np.maximum(whole[:, [0, 3], 3], 0), np.concatenate(spans)

    def bounds(self) -> Bounds:
        """Return the lowest and highest corner of the curves."""
        points, widths, _ = self.pieces
        reach = widths.max() / 2
        return points.min(axis=(0, 1)) - reach, points.max(axis=(0, 1)) + reach


def _check_strand_material(material: Material, path: tuple[str | int, ...] = ("material",)) -> None:
    """Refuse what curves cannot be made of: lamps, mirrors, solids of glass, media, holes."""
    for index, part in enumerate(material.materials if isinstance(material, Mix) else ()):
        _check_strand_material(part, (*path, "materials", index))
    fits = isinstance(material, Hair | Matte | Translucent | Plastic | Conductor | Mix)
    if isinstance(material, Principled):
        emits = not isinstance(material.emission, tuple) or max(material.emission) > 0
        fits = material.transmission == 0 and not emits
    if not fits or has_holes(material):
        raise refuse(
            "is nothing that curves can be made of", got=material.kind, path=path,
            allowed="hair, matte, translucent, plastic, conductor, opaque principled that does not shine; no holes",
        )  # fmt: skip


def _check_apart(base: tuple[float, ...], end: tuple[float, ...], key: str) -> None:
    if np.linalg.norm(np.subtract(end, base)) < SMALLEST_LENGTH:
        raise refuse("equals base, so there is no axis", got=list(end), path=(key,))


def _along_axis(point: NDArray[np.float64], base: NDArray[np.float64], end: NDArray[np.float64]) -> tuple[float, float]:
    """Return the height of a point along an axis as a fraction of it, and its distance from the axis."""
    axis = end - base
    height = float((point - base) @ axis / (axis @ axis))
    return height, float(np.linalg.norm(point - base - height * axis))


Object = Annotated[
    Sphere | Disk | Rectangle | Box | Cylinder | Cone | Plane | Curves | MeshObject | Board,
    Field(discriminator="shape"),
]
