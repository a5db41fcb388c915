"""Where objects are: steps that place them, keyframes, and what all objects have in common."""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, TypeVar
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field, PrivateAttr, model_validator
from pydantic_core import PydanticCustomError

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import Folders
from rptcam_cl.core.records import Hidden
from rptcam_cl.scene.base import AlsoAccepts, Alternatives, FileReference, SceneModel, refuse
from rptcam_cl.scene.materials import Material
from rptcam_cl.scene.quantities import LARGEST_COORDINATE, NUMBER, AffineRows, Direction, GroupName, Moment, Position

# Transforms: steps that place an object in the world.

# Ratio of the smallest to the largest stretch that float32 inverts with some accuracy left.
SMALLEST_STRETCH_RATIO = 1e-6

Matrix = NDArray[np.float64]


def _three_factors(value: Any) -> Any:
    """Return one factor as three equal ones."""
    if isinstance(value, (list, tuple, np.ndarray)):
        return value
    return [value, value, value]


class Rotation(SceneModel):
    """A turn about an axis through the origin."""

    axis: Direction
    """Direction of the axis; any length."""

    degrees: Annotated[float, Field(ge=-1e6, le=1e6), NUMBER]
    """Angle [degrees], counter-clockwise when the axis points at the viewer."""

    def matrix(self) -> Matrix:
        """Return the 3x3 matrix."""
        return turn_about(np.divide(self.axis, np.linalg.norm(self.axis)), self.degrees)


def turn_about(axis: NDArray[np.float64], degrees: float) -> Matrix:
    """Return the 3x3 matrix of a turn about a unit axis (Rodrigues)."""
    angle = math.radians(degrees)
    cross = np.cross(np.eye(3), axis)
    aligned = np.outer(axis, axis)
    return np.asarray(aligned + math.cos(angle) * (np.eye(3) - aligned) + math.sin(angle) * cross)


class TransformStep(SceneModel):
    """One step of a transform: exactly one of the four keys."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (
        Alternatives(("scale", "rotate", "translate", "matrix"), required=True),
    )

    scale: Annotated[Position, BeforeValidator(_three_factors), AlsoAccepts({"type": "number"})] | None = None
    """Factor along all axes, or [x, y, z] factors; negative ones reflect, none is zero."""

    rotate: Rotation | None = None
    """Turn about an axis through the origin."""

    translate: Position | None = None
    """Shift [scene units]."""

    matrix: AffineRows | None = None
    """Rows of an affine matrix, 3x4, or 4x4 with the last row [0, 0, 0, 1]."""

    @model_validator(mode="after")
    def _check_invertible(self) -> Self:
        if self.matrix is not None and self.matrix[3] != (0, 0, 0, 1):
            last = list(self.matrix[3])
            raise refuse("is not affine", got=last, allowed="[0, 0, 0, 1]", path=("matrix", 3))
        key = "matrix" if self.matrix is not None else "scale"
        _check_invertible(self.as_matrix(), path=(key,))
        return self

    def as_matrix(self) -> Matrix:
        """Return the step as a 4x4 matrix."""
        result = np.eye(4)
        if self.scale is not None:
            result[:3, :3] = np.diag(self.scale)
        elif self.rotate is not None:
            result[:3, :3] = self.rotate.matrix()
        elif self.translate is not None:
            result[:3, 3] = self.translate
        elif self.matrix is not None:
            result[:] = self.matrix
        return result


def _check_invertible(matrix: Matrix, path: tuple[str | int, ...] = ()) -> None:
    """Refuse a 4x4 matrix that flattens space, or overflows when its coordinates are squared in float32."""
    stretches = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    if not stretches[-1] > SMALLEST_STRETCH_RATIO * stretches[0]:
        raise refuse(
            "cannot be inverted: it flattens space",
            allowed=f"stretches whose ratio is at least {SMALLEST_STRETCH_RATIO:g}",
            path=path,
        )
    if np.abs(matrix).max() > LARGEST_COORDINATE or stretches[-1] < 1 / LARGEST_COORDINATE:
        raise refuse(
            "stretches or shifts too far for float32",
            allowed=f"factors of {1 / LARGEST_COORDINATE:g} to {LARGEST_COORDINATE:g}",
            path=path,
        )


def _as_steps(value: Any) -> Any:
    """Return a single step as a list of one."""
    return [value] if isinstance(value, (dict, TransformStep)) else value


def _check_product(steps: tuple[TransformStep, ...]) -> tuple[TransformStep, ...]:
    _check_invertible(product(steps))
    return steps


def product(steps: tuple[TransformStep, ...]) -> Matrix:
    """Return the 4x4 matrix that applies the steps in their order."""
    result = np.eye(4)
    for step in steps:
        result = step.as_matrix() @ result
    return result


Transform = Annotated[
    tuple[TransformStep, ...],
    Field(max_length=100),
    BeforeValidator(_as_steps),
    AfterValidator(_check_product),
    AlsoAccepts(),
]


# Keyframes of cameras and objects, and where they are between two of them.

Vector = NDArray[np.float64]

# Sine of the angle below which two axes count as one: beyond rounding, below what anybody writes.
_SAME_AXIS = 1e-9

_RIGID = 1e-5  # by which the rows of a matrix that only turns may miss being at right angles and of length 1

MOST_KEYFRAMES = 100_000


class Keyframe(SceneModel):
    """A moment."""

    time_s: Moment
    """When [s]: a number, or a fraction such as 1/125; `shutter.open_s` counts from the same moment."""


class CameraKeyframe(Keyframe):
    """Where a camera is at a moment; keys left out are those of the camera."""

    eye: Position | None = None
    """Where the camera stands [scene units]."""

    target: Position | None = None
    """A point that the camera looks at [scene units]."""

    up: Direction | None = None
    """Direction that appears upwards."""


class ObjectKeyframe(Keyframe):
    """Where an object is at a moment: first turned about the origin, then shifted."""

    rotate: Rotation | None = None
    """Turn about an axis through the origin; none by default."""

    translate: Position = (0.0, 0.0, 0.0)
    """Shift [scene units]."""

    matrix: AffineRows | None = None
    """Rows of a matrix that turns and shifts, 3x4 or 4x4, in place of the other two."""

    @model_validator(mode="after")
    def _check_rigid(self) -> Self:
        if self.matrix is None:
            return self
        if self.model_fields_set & {"rotate", "translate"}:
            raise refuse("says what rotate and translate say", allowed="matrix, or the other two", path=("matrix",))
        linear = np.array(self.matrix)[:3, :3]
        if (
            self.matrix[3] != (0, 0, 0, 1)
            or np.abs(linear.T @ linear - np.eye(3)).max() > _RIGID
            or np.linalg.det(linear) < 0
        ):
            raise refuse("does more than turn and shift", allowed="stretches in `transform`", path=("matrix",))
        return self

    @cached_property
    def turn(self) -> Rotation | None:
        """The turn about the origin; of a matrix the one of at most 180 degrees."""
        if self.matrix is None:
            return self.rotate
        axis, degrees = _shortest(np.array(self.matrix)[:3, :3])
        return Rotation(axis=axis.tolist(), degrees=degrees)

    @property
    def shift(self) -> tuple[float, ...]:
        """The shift [scene units]."""
        return self.translate if self.matrix is None else tuple(row[3] for row in self.matrix[:3])


_K = TypeVar("_K", bound=Keyframe)


def in_order(frames: tuple[_K, ...]) -> tuple[_K, ...]:
    """Return keyframes; refuse those whose times do not rise."""
    for index in range(1, len(frames)):
        if not frames[index].time_s > frames[index - 1].time_s:
            raise refuse(
                "does not come after the keyframe before it",
                got=frames[index].time_s,
                allowed=f"a time after {frames[index - 1].time_s:g}",
                path=(index, "time_s"),
            )
    return frames


CameraMotion = Annotated[tuple[CameraKeyframe, ...], Field(max_length=MOST_KEYFRAMES), AfterValidator(in_order)]
_ObjectMotion = Annotated[tuple[ObjectKeyframe, ...], Field(max_length=MOST_KEYFRAMES), AfterValidator(in_order)]


def place_between(frames: Sequence[Keyframe], time_s: float) -> tuple[int, float]:
    """Return the keyframe that a moment follows, and how far it is on the way to the next; the ends hold."""
    index = bisect_right(frames, time_s, key=lambda frame: frame.time_s) - 1
    if index < 0:
        return 0, 0.0
    if index == len(frames) - 1:
        return index, 0.0
    begin, end = frames[index].time_s, frames[index + 1].time_s
    return index, (time_s - begin) / (end - begin)


def moments(frames: Sequence[Keyframe], begin_s: float, end_s: float) -> list[float]:
    """Return the moments between which motion is uniform: begin, the keyframes in between, and end."""
    return [begin_s, *(frame.time_s for frame in frames if begin_s < frame.time_s < end_s), end_s]


class Trajectory:
    """The way of an object through its keyframes.

    Between two keyframes it goes straight and turns uniformly: about the axis where both have the same, by whole turns
    if the angles say so; otherwise the shortest way.
    """

    def __init__(self, frames: Sequence[ObjectKeyframe]) -> None:
        self.frames = frames

    def at(self, time_s: float) -> Matrix:
        """Return the 4x4 matrix that takes the object from where its transform leaves it to its place at a moment."""
        index, share = place_between(self.frames, time_s)
        matrix, frame = np.eye(4), self.frames[index]
        matrix[:3, 3] = frame.shift
        if frame.turn is not None:
            matrix[:3, :3] = frame.turn.matrix()
        if share > 0:
            following = self.frames[index + 1]
            matrix[:3, 3] += share * np.subtract(following.shift, frame.shift)
            axis, degrees = _turn_between(frame.turn, following.turn)
            matrix[:3, :3] = turn_about(axis, share * degrees) @ matrix[:3, :3]
        return matrix

    def moves(self, begin_s: float, end_s: float) -> bool:
        """Return whether it is not the same all the time between two moments."""
        times = moments(self.frames, begin_s, end_s)
        return any(
            self.turn(a, b)[1] != 0 or not np.array_equal(self.at(a)[:3, 3], self.at(b)[:3, 3])
            for a, b in pairwise(times)
        )

    def turn(self, begin_s: float, end_s: float) -> tuple[Vector, float]:
        """Return axis and angle [turns] of the turn between two moments without a keyframe in between."""
        index, _ = place_between(self.frames, (begin_s + end_s) / 2)
        if index == len(self.frames) - 1 or begin_s < self.frames[0].time_s or end_s <= begin_s:
            return np.array([0.0, 0.0, 1.0]), 0.0
        first, second = self.frames[index : index + 2]
        axis, degrees = _turn_between(first.turn, second.turn)
        return axis, degrees / 360 * (end_s - begin_s) / (second.time_s - first.time_s)


def _turn_between(first: Rotation | None, second: Rotation | None) -> tuple[Vector, float]:
    """Return axis and angle [degrees] of the turn that leads from one rotation to another."""
    a, b = _axis(first), _axis(second)
    if a is not None and b is not None and np.linalg.norm(np.cross(a, b)) > _SAME_AXIS:
        return _shortest(_matrix(second) @ _matrix(first).T)
    axis = a if a is not None else b
    if axis is None:
        return np.array([0.0, 0.0, 1.0]), 0.0
    opposite = a is not None and b is not None and a @ b < 0
    return axis, (-1 if opposite else 1) * _degrees(second) - _degrees(first)


def _degrees(rotation: Rotation | None) -> float:
    return 0.0 if rotation is None else rotation.degrees


def _matrix(rotation: Rotation | None) -> Matrix:
    return np.eye(3) if rotation is None else rotation.matrix()


def _axis(rotation: Rotation | None) -> Vector | None:
    """Return the unit axis, None where nothing is turned, so that any axis will do."""
    if rotation is None or rotation.degrees == 0:
        return None
    return np.asarray(np.divide(rotation.axis, np.linalg.norm(rotation.axis)))


def _shortest(matrix: Matrix) -> tuple[Vector, float]:
    """Return axis and angle [degrees], at most 180, of a 3x3 rotation."""
    quaternion = quaternion_of(matrix)
    sine = float(np.linalg.norm(quaternion[:3]))
    if sine == 0:
        return np.array([0.0, 0.0, 1.0]), 0.0
    return quaternion[:3] / sine, math.degrees(2 * math.atan2(sine, quaternion[3]))


def quaternion_of(matrix: Matrix) -> Vector:
    """Return x, y, z and w >= 0 of a 3x3 rotation (the eigenvector of Bar-Itzhack 2000: accurate for every angle)."""
    m = matrix
    k = np.array(
        [
            [m[0, 0] - m[1, 1] - m[2, 2], m[1, 0] + m[0, 1], m[2, 0] + m[0, 2], m[2, 1] - m[1, 2]],
            [m[1, 0] + m[0, 1], m[1, 1] - m[0, 0] - m[2, 2], m[2, 1] + m[1, 2], m[0, 2] - m[2, 0]],
            [m[2, 0] + m[0, 2], m[2, 1] + m[1, 2], m[2, 2] - m[0, 0] - m[1, 1], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], m[0, 0] + m[1, 1] + m[2, 2]],
        ]
    )
    quaternion = np.linalg.eigh(k)[1][:, -1]
    return np.asarray(quaternion * math.copysign(1.0, quaternion[3]))


# Tables of places, beside the scene: a forest, a crowd, the atoms of a crystal.

_MOST_PLACES = 1 << 26  # of one table
_BLOCK = 1 << 14  # places of which something is worked out at a time
_TABLE_KEYS = "allowed: matrices (n, 3, 4), or positions (n, 3) and perhaps scales (n,)"


_TABLES: WeakValueDictionary[Any, Matrix] = WeakValueDictionary()  # those in use, by the content that they are of


class Instances(FileReference):
    """Many places at which an object stands: a table of NumPy beside the scene."""

    _sound: Any = PrivateAttr(None)
    """The content whose places are known to be sound: bytes, or a path with the size and time of its file."""

    def content(self, folders: Folders) -> bytes | tuple[str, int, int]:
        """Identify the table: its bytes, or the path, size and time of its file."""
        source = self.source(folders)
        if isinstance(source, bytes):
            return source
        return str(source), source.stat().st_size, source.stat().st_mtime_ns

    def matrices(self, folders: Folders) -> Matrix:
        """Find the matrices that take the object, after its transform, to its places (n, 3, 4).

        A table is not kept for longer than somebody uses it, and read again then: it would be a fifth of all that a
        scene of many places takes.

        Raises
        ------
        InputError
            When the file has no such table, or places something where float32 cannot.
        """
        content = self.content(folders)
        matrices = _TABLES.get(content)
        if matrices is None:
            try:
                matrices = _read_places(self.source(folders))
                if self._sound != content:
                    _check_places(matrices)
            except InputError as problem:
                raise InputError(f"{self.place}{problem}") from None
            matrices.setflags(write=False)
            self._sound = content
            _TABLES[content] = matrices
        return matrices


def _read_places(source: Path | bytes) -> Matrix:
    table = _read_table(source)
    if "matrices" in table:
        rows = table["matrices"]
        if rows.ndim != 3 or rows.shape[1:] not in ((3, 4), (4, 4)):
            raise InputError(f"matrices have the shape {rows.shape} ({_TABLE_KEYS})")
        matrices = np.ascontiguousarray(rows[:, :3])
    else:
        positions = table["positions"]
        scales = table.get("scales", np.ones(len(positions)))
        if positions.shape != (len(scales), 3) or scales.ndim != 1:
            raise InputError(f"positions have the shape {positions.shape}, scales {scales.shape} ({_TABLE_KEYS})")
        matrices = np.zeros((len(scales), 3, 4))
        matrices[:, range(3), range(3)], matrices[:, :, 3] = scales[:, None], positions
    if not 0 < len(matrices) <= _MOST_PLACES:
        raise InputError(f"has {len(matrices)} places (allowed: 1 to {_MOST_PLACES})")
    return matrices


def _read_table(source: Path | bytes) -> dict[str, Matrix]:
    try:
        loaded = np.load(io.BytesIO(source) if isinstance(source, bytes) else source, allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            return {"matrices": _numbers(loaded)}
        with loaded as content:
            if sum(info.file_size for info in content.zip.infolist()) > _MOST_PLACES * 128:
                raise InputError(f"holds more than {_MOST_PLACES} places")
            table = {name: _numbers(content[name]) for name in ("matrices", "positions", "scales") if name in content}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error) as problem:
        raise InputError(f"is no table of NumPy: {str(problem).splitlines()[0]} ({_TABLE_KEYS})") from None
    if "matrices" not in table and "positions" not in table:
        raise InputError(f"has neither matrices nor positions ({_TABLE_KEYS})")
    return table


def _numbers(array: NDArray[Any]) -> Matrix:
    if array.dtype.kind not in "fiu":
        raise InputError(f"holds more than numbers ({_TABLE_KEYS})")
    return np.asarray(array, np.float64)


def _check_places(matrices: Matrix) -> None:
    """Refuse places that `_check_invertible` refuses."""
    starts = range(0, len(matrices), _BLOCK)
    doubtful = [start + _doubtful(matrices[start : start + _BLOCK]) for start in starts]
    for index in np.concatenate(doubtful):
        try:
            if not np.isfinite(matrices[index]).all():
                raise refuse("holds numbers that are not finite", allowed="numbers")
            _check_invertible(np.vstack([matrices[index], (0, 0, 0, 1)]))
        except PydanticCustomError as problem:
            details = problem.context or {}
            raise InputError(f"place {index} {details['problem']} (allowed: {details['allowed']})") from None


def _doubtful(matrices: Matrix) -> NDArray[np.int64]:
    """Return which places may be unsound; one product of stretches spares most their exact ones."""
    linear = matrices[:, :, :3]
    with np.errstate(all="ignore"):
        norm = np.sqrt(np.einsum("nij,nij->n", linear, linear))
        volume = np.abs(np.einsum("ni,ni->n", linear[:, 0], np.cross(linear[:, 1], linear[:, 2])))
        is_sound = volume > 0.5 * norm**3 * SMALLEST_STRETCH_RATIO  # the least stretch is at least 2 volume / norm²
        is_sound &= 2 * volume > norm**2 / LARGEST_COORDINATE
        is_sound &= np.abs(matrices).max(axis=(1, 2)) <= LARGEST_COORDINATE
    return np.flatnonzero(~is_sound)


# What the objects of a scene have in common.

Bounds = tuple[NDArray[np.float64], NDArray[np.float64]]

MATERIAL_NAME = AlsoAccepts({"type": "string", "description": "Name of one of `materials`."})


class CameraVisibility(SceneModel):
    """Whether the camera sees it directly."""

    camera: bool = Field(default=True, strict=True)
    """Whether the camera sees it directly; it shines and casts shadows in any case."""


class Visibility(CameraVisibility):
    """Which rays meet an object; the others pass through it as if it were not there."""

    shadow: bool = Field(default=True, strict=True)
    """Whether it stands in the way of the light of lamps."""

    reflection: bool = Field(default=True, strict=True)
    """Whether rays from other surfaces meet it: what mirrors and glass show, and light that surfaces exchange."""

    @property
    def hidden(self) -> int:
        """The rays that it is hidden from, as a sum of `Hidden`."""
        return (
            (not self.camera) * Hidden.FROM_CAMERA
            + (not self.shadow) * Hidden.FROM_SHADOW
            + (not self.reflection) * Hidden.FROM_REFLECTION
        )


class PlacedObject(SceneModel):
    """What every object has."""

    name: Annotated[str, Field(max_length=200)] | None = None
    """Name of the object, for the reader."""

    label: Annotated[str, Field(min_length=1, max_length=200)] | None = None
    """Class of the object, as chair: of semantic masks and annotations."""

    group: GroupName | None = None
    """Name of the layer that has its light, where `render.layers` has `lights` and it shines; by default its own."""

    transform: Transform = ()
    """One step or a list of steps, applied in their order to the shape as described by its own keys."""

    instances: Instances | None = None
    """Table of places at which it stands, each after its transform; in one place, that of its transform, by default."""

    motion: _ObjectMotion = ()
    """Where it is over time, after its transform; without keyframes it stands still."""

    visible: Visibility = Visibility()
    """Which rays meet it; a lamp without `reflection` lights as one without size does, and mirrors do not show it."""

    @cached_property
    def world_from_object(self) -> NDArray[np.float64]:
        """Return the 4x4 matrix of the transform (read-only); its determinant is negative when it reflects."""
        matrix = product(self.transform)
        matrix.setflags(write=False)
        return matrix

    @property
    def trajectory(self) -> Trajectory | None:
        """Return its way through the keyframes, None where it has none."""
        return Trajectory(self.motion) if self.motion else None

    def places(self, folders: Folders, time_s: float, some: slice = slice(None)) -> NDArray[np.float64]:
        """Return the matrices that place the object in the world at a moment (n, 4, 4), one for each instance."""
        if self.instances is None:
            return self.placed_at(time_s)[None]
        rows = self.instances.matrices(folders)[some]
        places = np.zeros((len(rows), 4, 4))
        places[:, :3], places[:, 3, 3] = rows @ self.world_from_object, 1.0
        return places if self.trajectory is None else self.trajectory.at(time_s) @ places

    def place_blocks(self, folders: Folders, time_s: float) -> Iterator[NDArray[np.float64]]:
        """Yield the same some at a time: what is worked out of them takes no memory beside a table then."""
        table = None if self.instances is None else self.instances.matrices(folders)
        for first in range(0, 1 if table is None else len(table), _BLOCK):
            yield self.places(folders, time_s, slice(first, first + _BLOCK))

    def placed_at(self, time_s: float) -> NDArray[np.float64]:
        """Return the 4x4 matrix that places the object in the world at a moment: its transform, then its motion."""
        matrix = self.world_from_object
        return matrix if self.trajectory is None else self.trajectory.at(time_s) @ matrix


class SceneObject(PlacedObject):
    """An object that has one material, and a shape of a few numbers."""

    material: Annotated[Material, MATERIAL_NAME]
    """Name of one of `materials`, or a material written out as a mapping."""

    def shown_materials(self) -> tuple[Material, ...]:
        """Return the object's material."""
        return (self.material,)

    def bounds(self) -> Bounds:
        """Return the lowest and highest corner of the shape before its transform [scene units]."""
        raise NotImplementedError

    def contains(self, point: NDArray[np.float64]) -> bool:
        """Return whether a point, in the frame before the transform, lies inside the solid."""
        return False

    def flat_faces(self) -> list[NDArray[np.float64]]:
        """Return the corners (n, 3) of each flat face in turn, before the transform; a round one is a polygon."""
        return []
