"""Lists of vectors and faces written out in a scene, or given as arrays from Python."""

from __future__ import annotations

from numbers import Integral
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import PlainSerializer, PlainValidator, WithJsonSchema
from pydantic_core import PydanticCustomError

from rptcam_cl.assets.meshes import NormalsMode, Polygons
from rptcam_cl.scene.base import listed, near_name, number_at, refuse
from rptcam_cl.scene.quantities import LARGEST_COORDINATE

NORMALS_MODES: tuple[NormalsMode, ...] = ("auto", "smooth", "flat")


class Vectors:
    """Rows of numbers that do not change: `rows` is an (n, k) float64 array."""

    def __init__(self, rows: NDArray[np.float64]) -> None:
        rows.setflags(write=False)
        self.rows = rows

    def __len__(self) -> int:
        return len(self.rows)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Vectors) and np.array_equal(self.rows, other.rows)

    def __hash__(self) -> int:
        return hash(self.rows.tobytes())

    def plain(self) -> list[Any]:
        """Return the rows as lists."""
        return list(self.rows.tolist())


class Faces:
    """Polygons of three or more corners that do not change: `groups` holds them by their number of corners."""

    def __init__(self, groups: list[Polygons]) -> None:
        self.groups = groups

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Faces) and self.plain() == other.plain()

    def __hash__(self) -> int:
        return hash(tuple(corners.tobytes() for _, corners in self.groups))

    def plain(self) -> list[Any]:
        """Return the polygons in their order, as lists."""
        found = [
            (int(number), row.tolist())
            for numbers, corners in self.groups
            for number, row in zip(numbers, corners, strict=True)
        ]
        return [row for _, row in sorted(found)]


def _vectors(size: int, value: Any) -> Vectors:
    meaning = f"rows of {size} numbers"
    if isinstance(value, Vectors):
        return value
    if isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.ndim == 2 and value.shape[1] == size:
        rows = value.astype(np.float64)
    elif isinstance(value, (list, tuple)):
        for index, row in enumerate(value):
            if not isinstance(row, (list, tuple)) or len(row) != size:
                raise refuse(f"must be {size} numbers", got=row, allowed=f"a list of {size} numbers", path=(index,))
        rows = np.array(
            [[number_at(item, (i, j)) for j, item in enumerate(row)] for i, row in enumerate(value)], np.float64
        ).reshape(-1, size)
    else:
        raise refuse(f"must be {meaning}", allowed=f"a list of lists of {size} numbers")
    beyond = ~(np.abs(rows) <= LARGEST_COORDINATE)
    if beyond.any():
        row, column = (int(place) for place in np.argwhere(beyond)[0])
        got = float(rows[row, column])
        raise refuse("is out of range", got=got, allowed=f"up to {LARGEST_COORDINATE:g} in size", path=(row, column))
    if not len(rows):
        raise refuse("is empty", got=[], allowed=meaning)
    return Vectors(rows)


def _faces(value: Any) -> Faces:
    allowed = "a list of lists of 3 or more vertex numbers, which count from 0"
    if isinstance(value, Faces):
        return value
    if isinstance(value, np.ndarray) and value.dtype.kind in "iu" and value.ndim == 2 and value.shape[1] >= 3:
        value = value.astype(np.int64)
        if not len(value):
            raise refuse("is empty", got=[], allowed=allowed)
        return Faces([Polygons(np.arange(len(value)), value)])
    if not isinstance(value, (list, tuple)) or not value:
        raise refuse("must be faces", allowed=allowed)
    by_size: dict[int, tuple[list[int], list[Any]]] = {}
    for index, row in enumerate(value):
        if not isinstance(row, (list, tuple)) or len(row) < 3 or not all(_is_index(item) for item in row):
            form = "3 or more vertex numbers, which count from 0"
            raise refuse("is not a face", got=row, allowed=form, path=(index,))
        numbers, rows = by_size.setdefault(len(row), ([], []))
        numbers.append(index)
        rows.append(row)
    return Faces([Polygons(np.array(numbers), np.array(rows, np.int64)) for numbers, rows in by_size.values()])


def _is_index(value: Any) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool) and 0 <= int(value) < 2**31


def _normals(value: Any) -> Vectors | str:
    if not isinstance(value, str):
        return _vectors(3, value)
    if value not in NORMALS_MODES:
        raise _unknown_mode(value)
    return value


def _unknown_mode(value: str) -> PydanticCustomError:
    names = listed(NORMALS_MODES)
    return refuse(f"is not a known choice{near_name(value, NORMALS_MODES)}", allowed=f"{names}, or a list of vectors")


def _rows_schema(item: str, least: int, most: int | None) -> dict[str, Any]:
    row: dict[str, Any] = {"type": "array", "items": {"type": item}, "minItems": least}
    if most is not None:
        row["maxItems"] = most
    return {"type": "array", "minItems": 1, "items": row}


_PLAIN = PlainSerializer(lambda value: value if value is None or isinstance(value, str) else value.plain())
_POINTS_SCHEMA = _rows_schema("number", 3, 3)

Points = Annotated[Vectors, PlainValidator(lambda value: _vectors(3, value)), _PLAIN, WithJsonSchema(_POINTS_SCHEMA)]
Pairs = Annotated[
    Vectors, PlainValidator(lambda value: _vectors(2, value)), _PLAIN, WithJsonSchema(_rows_schema("number", 2, 2))
]
FaceRows = Annotated[Faces, PlainValidator(_faces), _PLAIN, WithJsonSchema(_rows_schema("integer", 3, None))]
Normals = Annotated[
    Vectors | NormalsMode,
    PlainValidator(_normals),
    _PLAIN,
    WithJsonSchema({"anyOf": [{"enum": list(NORMALS_MODES)}, _POINTS_SCHEMA]}),
]
