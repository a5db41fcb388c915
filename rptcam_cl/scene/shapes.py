"""Objects: a shape, its material and where it is placed; boards for calibration and measurement."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from rptcam_cl.scene.assets.boards import DICTIONARIES, Pattern, aruco, charuco, checker, circles, siemens, slanted_edge
from rptcam_cl.scene.assets.mesh import Draft, make_contents
from rptcam_cl.scene.base import refuse, unknown_name
from rptcam_cl.scene.materials import Material, Matte
from rptcam_cl.scene.meshes import LoadedMesh, MeshObject
from rptcam_cl.scene.placement import Bounds, PlacedObject, SceneObject
from rptcam_cl.scene.quantities import NUMBER, SMALLEST_LENGTH, WHOLE_NUMBER, Direction, Length, Position, cross

# Boards for calibration and measurement: flat patterns whose points pictures are to show where metadata say.

Kind = Literal["checker", "charuco", "aruco", "circles", "siemens", "slanted_edge"]
MOST_SQUARES = 200  # across or down
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

    columns: Annotated[int, Field(ge=1, le=MOST_SQUARES), WHOLE_NUMBER] = 7
    """Squares, markers or circles across."""

    rows: Annotated[int, Field(ge=1, le=MOST_SQUARES), WHOLE_NUMBER] = 5
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
    def pattern(self) -> Pattern:
        """What is on it [scene units]."""
        size, margin = (self.columns, self.rows, self.pitch, self.margin * self.pitch), self.margin * self.pitch
        match self.kind:
            case "checker":
                return checker(*size)
            case "charuco":
                return charuco(*size, self.fill, self.dictionary, self.first_id)
            case "aruco":
                return aruco(*size, self.fill, self.dictionary, self.first_id)
            case "circles":
                return circles(*size, self.fill)
            case "siemens":
                return siemens(self.pitch, margin, self.fill, self.sectors)
            case "slanted_edge":
                return slanted_edge(self.pitch, margin, self.angle_degrees)

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
        corner, u, v = np.array(self.corner), np.array(self.edge_u), np.array(self.edge_v)
        corners = np.array([corner, corner + u, corner + v, corner + u + v])
        return corners.min(axis=0), corners.max(axis=0)


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


class Plane(SceneObject):
    """An infinite plane; u and v are scene units along x and y of the frame that turns +z into the normal."""

    shape: Literal["plane"]
    """Kind of shape."""

    point: Position
    """A point of the plane, where u = v = 0 [scene units]."""

    normal: Direction
    """Direction of the front side; any length."""


def _check_apart(base: tuple[float, ...], end: tuple[float, ...], key: str) -> None:
    if np.linalg.norm(np.subtract(end, base)) < SMALLEST_LENGTH:
        raise refuse("equals base, so there is no axis", got=list(end), path=(key,))


def _along_axis(point: NDArray[np.float64], base: NDArray[np.float64], end: NDArray[np.float64]) -> tuple[float, float]:
    """Return the height of a point along an axis as a fraction of it, and its distance from the axis."""
    axis = end - base
    height = float((point - base) @ axis / (axis @ axis))
    return height, float(np.linalg.norm(point - base - height * axis))


Object = Annotated[
    Sphere | Disk | Rectangle | Box | Cylinder | Cone | Plane | MeshObject | Board, Field(discriminator="shape")
]
