"""Everything that moves while the shutter is open, in metres about the eye, as the device holds it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import SEGMENT
from rptcam_cl.plan.primitives import Primitive
from rptcam_cl.scene import Scene, Trajectory, moments, quaternion_of

Array = NDArray[np.float64]

STEPS_PER_TURN = 64
MOST_STEPS = 1024  # of a segment
ROUNDING = 4e-6  # of a place, relative to its distances from eye and pivot: beyond MOTION_ROUNDING of kernels/geometry


@dataclass(frozen=True, eq=False)
class Places:
    """Places that a body takes one after another.

    Attributes
    ----------
    matrices : (n, 4, 4) array
        To there from where the body is at rest.
    pivots : (n, 3) array
        About which it turns [m].
    bends : (n,) array
        How far at most a point gets off the straight line to the next place, per distance from the pivot.
    """

    matrices: Array
    pivots: Array
    bends: Array

    def box(self, low: Array, high: Array, rest: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return the corners (3,) of a box round the whole way.

        Parameters
        ----------
        low, high
            Corners of boxes round the body at each place (n, 3).
        rest
            Corners (3,) of a box round the body at rest.
        """
        corners = np.stack(rest)
        reach = np.linalg.norm(np.maximum(*np.abs(corners[:, None] - self.pivots)), axis=1)
        margin = self.bends * reach + ROUNDING * (reach + np.linalg.norm(self.pivots, axis=1))
        return (low - margin[:, None]).min(axis=0), (high + margin[:, None]).max(axis=0)


@dataclass(frozen=True, eq=False)
class Movements:
    """The segments of everything that moves.

    Attributes
    ----------
    segments : array of ``Segment`` records
        See ``kernels/geometry/movement.h``.
    of_primitive : (n, 2) int32 array
        First segment and number of segments of each primitive; none for what stands still.
    """

    segments: NDArray[np.void]
    of_primitive: NDArray[np.int32]

    @property
    def facts(self) -> dict[str, int]:
        """Facts for the compilation of the kernels."""
        most = int(self.of_primitive[:, 1].max(initial=0))
        turning = bool((self.segments["travel"][:, 3] != 0).any())
        return {"HAS_MOTION": int(most > 0), "MOTION_SEGMENTS": min(most, 2), "MOTION_TURNS": int(turning)}

    def places(self, primitive: int) -> Places:
        """Return places that a moving primitive takes, close enough to each other to bound the way between them."""
        first, count = self.of_primitive[primitive]
        parts = [_places(segment) for segment in self.segments[first : first + count]]
        return Places(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _places(segment: np.void) -> tuple[Array, Array, Array]:
    pivot, shift, travel = (segment[name].astype(np.float64)[:3] for name in ("pivot", "shift", "travel"))
    turns = float(segment["travel"][3])
    steps = int(np.clip(np.ceil(abs(turns) * STEPS_PER_TURN), 1, MOST_STEPS))
    shares = np.linspace(0, 1, steps + 1)
    half = np.pi * turns * shares[:, None]
    axis = segment["axis"].astype(np.float64)[:3]
    matrices = np.tile(np.eye(4), (len(shares), 1, 1))
    matrices[:, :3, :3] = _rotations(np.hstack([np.sin(half) * axis, np.cos(half)])) @ _rotations(segment["turn"][None])
    matrices[:, :3, 3] = pivot + shift + shares[:, None] * travel - matrices[:, :3, :3] @ pivot
    bend = min((2 * np.pi * turns / steps) ** 2 / 8, 2.0)
    return matrices, np.tile(pivot, (len(shares), 1)), np.full(len(shares), bend)


def _rotations(quaternions: NDArray[np.floating]) -> Array:
    """Return the matrices (n, 3, 3) of quaternions x, y, z, w."""
    x, y, z, w = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).astype(np.float64).T
    zero = np.zeros_like(x)
    cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    return np.asarray(np.eye(3) + 2 * w[:, None, None] * cross + 2 * cross @ cross)


def pack_movements(scene: Scene, primitives: Sequence[Primitive]) -> Movements:
    """Return the segments of the primitives that move; those of one object share them."""
    of_primitive = np.zeros((max(len(primitives), 1), 2), np.int32)
    segments: list[NDArray[np.void]] = []
    place_of: dict[int, tuple[int, int]] = {}
    count = 0
    for index, primitive in enumerate(primitives):
        if primitive.trajectory is None:
            continue
        if primitive.object not in place_of:
            segments.append(_segments(primitive.trajectory, scene))
            place_of[primitive.object] = count, len(segments[-1])
            count += len(segments[-1])
        of_primitive[index] = place_of[primitive.object]
    return Movements(np.concatenate(segments) if segments else SEGMENT.zeros(1), of_primitive)


def _segments(trajectory: Trajectory, scene: Scene) -> NDArray[np.void]:
    begin, end = scene.shutter.span_s
    times = moments(trajectory.frames, begin, end)
    places = [trajectory.at(time) for time in times]
    unit, rest = scene.metres_per_unit, places[0]
    segments = SEGMENT.zeros(len(times) - 1)
    for segment, (t0, t1), (first, second) in zip(segments, pairwise(times), pairwise(places), strict=True):
        axis, turns = trajectory.turn(t0, t1)
        segment["pivot"] = *(unit * (rest[:3, 3] - scene.camera.eye)), t0 - begin
        segment["shift"] = *(unit * (first[:3, 3] - rest[:3, 3])), 1.0 / (t1 - t0)
        segment["travel"] = *(unit * (second[:3, 3] - first[:3, 3])), turns
        segment["axis"][:3] = axis
        segment["turn"] = quaternion_of(first[:3, :3] @ rest[:3, :3].T)
    return segments
