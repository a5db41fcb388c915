"""Keyframes of cameras and objects, and where they are between two of them."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from rptcam_cl.scene.base import SceneModel, refuse
from rptcam_cl.scene.quantities import Direction, Moment, Position
from rptcam_cl.scene.transform import Matrix, Rotation, turn_about

Vector = NDArray[np.float64]

# Sine of the angle below which two axes count as one: beyond rounding, below what anybody writes.
SAME_AXIS = 1e-9

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
ObjectMotion = Annotated[tuple[ObjectKeyframe, ...], Field(max_length=MOST_KEYFRAMES), AfterValidator(in_order)]


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
        matrix[:3, 3] = frame.translate
        if frame.rotate is not None:
            matrix[:3, :3] = frame.rotate.matrix()
        if share > 0:
            following = self.frames[index + 1]
            matrix[:3, 3] += share * np.subtract(following.translate, frame.translate)
            axis, degrees = turn_between(frame.rotate, following.rotate)
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
        axis, degrees = turn_between(first.rotate, second.rotate)
        return axis, degrees / 360 * (end_s - begin_s) / (second.time_s - first.time_s)


def turn_between(first: Rotation | None, second: Rotation | None) -> tuple[Vector, float]:
    """Return axis and angle [degrees] of the turn that leads from one rotation to another."""
    a, b = _axis(first), _axis(second)
    if a is not None and b is not None and np.linalg.norm(np.cross(a, b)) > SAME_AXIS:
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
