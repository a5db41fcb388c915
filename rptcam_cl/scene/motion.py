"""Keyframes, and where a moment lies between two of them."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import Annotated, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from rptcam_cl.scene.base import SceneModel
from rptcam_cl.scene.quantities import Direction, Position
from rptcam_cl.scene.refusal import refuse
from rptcam_cl.scene.shutter import Moment

Vector = NDArray[np.float64]

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


_K = TypeVar("_K", bound=Keyframe)


def _in_order(frames: tuple[_K, ...]) -> tuple[_K, ...]:
    for index in range(1, len(frames)):
        if not frames[index].time_s > frames[index - 1].time_s:
            raise refuse(
                "does not come after the keyframe before it",
                got=frames[index].time_s,
                allowed=f"a time after {frames[index - 1].time_s:g}",
                path=(index, "time_s"),
            )
    return frames


CameraMotion = Annotated[tuple[CameraKeyframe, ...], Field(max_length=MOST_KEYFRAMES), AfterValidator(_in_order)]


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
