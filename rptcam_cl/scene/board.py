"""Boards for calibration and measurement: flat patterns whose points pictures are to show where metadata say."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from rptcam_cl.assets import boards
from rptcam_cl.assets.meshes import Draft, make_contents
from rptcam_cl.scene.base import listed, near_name, refuse
from rptcam_cl.scene.material import Material, Matte
from rptcam_cl.scene.mesh import LoadedMesh
from rptcam_cl.scene.quantities import NUMBER, WHOLE_NUMBER, Length
from rptcam_cl.scene.scene_object import Bounds, PlacedObject

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
        if name not in boards.DICTIONARIES:
            names = list(boards.DICTIONARIES)
            raise refuse(f"is no known dictionary{near_name(name, names)}", got=name, allowed=listed(names))
        return name

    @model_validator(mode="after")
    def _check_keys(self) -> Self:
        for key, kinds in _OF_KINDS.items():
            if key in self.model_fields_set and self.kind not in kinds:
                allowed = f"with kind {' or '.join(kinds)}"
                raise refuse(f"means nothing on a board of kind {self.kind}", got=getattr(self, key), allowed=allowed,
                             path=(key,))  # fmt: skip
        if self.kind in ("checker", "charuco") and min(self.columns, self.rows) < 2:
            key = "columns" if self.columns < 2 else "rows"
            raise refuse("leaves no corner where squares meet", got=1, allowed="2 or more", path=(key,))
        if self.kind in ("charuco", "aruco"):
            squares = self.columns * self.rows
            last = self.first_id + (squares if self.kind == "aruco" else squares // 2) - 1
            _, count = boards.DICTIONARIES[self.dictionary]
            if last >= count:
                raise refuse(
                    f"has fewer markers than the board needs, up to number {last}", got=self.dictionary,
                    allowed=f"a larger dictionary, or fewer squares (this one has 0 to {count - 1})",
                    path=("dictionary",),
                )  # fmt: skip
        return self

    @cached_property
    def pattern(self) -> boards.Pattern:
        """What is on it [scene units]."""
        size, margin = (self.columns, self.rows, self.pitch, self.margin * self.pitch), self.margin * self.pitch
        match self.kind:
            case "checker":
                return boards.checker(*size)
            case "charuco":
                return boards.charuco(*size, self.fill, self.dictionary, self.first_id)
            case "aruco":
                return boards.aruco(*size, self.fill, self.dictionary, self.first_id)
            case "circles":
                return boards.circles(*size, self.fill)
            case "siemens":
                return boards.siemens(self.pitch, margin, self.fill, self.sectors)
            case "slanted_edge":
                return boards.slanted_edge(self.pitch, margin, self.angle_degrees)

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
        """Return what the metadata of a picture say of it at a moment: its points in the axes of the scene [m]."""
        world = np.diag([metres_per_unit] * 3 + [1.0]) @ self.placed_at(time_s)
        keys = [key for key in ("columns", "rows", "fill", "dictionary", "first_id", "sectors", "angle_degrees")
                if self.kind in _OF_KINDS[key]]  # fmt: skip
        said = {"object": index, "name": self.name or f"objects.{index}", "kind": self.kind}
        said |= {"pitch_m": self.pitch * metres_per_unit} | {key: getattr(self, key) for key in keys}
        return said | self.pattern.described(world)
