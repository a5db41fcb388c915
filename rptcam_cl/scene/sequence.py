"""Sequences: keys of a scene that change from frame to frame, by keyframes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from pydantic import AfterValidator, Field, field_validator

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.base import SceneModel, refuse
from rptcam_cl.scene.motion import MOST_KEYFRAMES, Keyframe, in_order, place_between
from rptcam_cl.scene.quantities import NUMBER

MOST_FRAMES = 1_000_000
ROUNDING = 1e-9  # of a number between whole ones, which is whole itself then: seeds and counts must be


class ValueKeyframe(Keyframe):
    """What a key is at a moment."""

    value: Any
    """As at the key itself; numbers and lists of numbers go straight to the next keyframe, others stay until it."""


ValueKeyframes = Annotated[
    tuple[ValueKeyframe, ...], Field(min_length=1, max_length=MOST_KEYFRAMES), AfterValidator(in_order)
]


class ContinuousFocus(SceneModel):
    """How autofocus follows from frame to frame, so that it does not pump."""

    hold: Annotated[float, Field(ge=0, le=1e6), NUMBER] = 1.0
    """How far the focus may be off what is measured before it goes there [depths of focus]."""

    lock_s: Annotated[float, Field(ge=0, le=1e6), NUMBER] = 0.25
    """How long it waits before, so that what crosses the picture is let pass [s]."""

    speed: Annotated[float, Field(gt=0, le=1e9), NUMBER] = 50.0
    """How fast it goes at most [depths of focus per second]."""


class FrameSequence(SceneModel):
    """Keys that change from frame to frame; within a frame they stay."""

    frames_per_second: Annotated[float, Field(ge=1e-3, le=1e6), NUMBER] = 24.0
    """Frame 1 opens its shutter at `shutter.open_s`, each next one this much later."""

    keys: Mapping[str, ValueKeyframes] = {}
    """Keyframes by key path, as `camera.focus.distance_m`; times count as those of moving objects do."""

    continuous_focus: ContinuousFocus | None = None
    """How `camera.focus: {auto: …}` follows from frame to frame; by default each frame is focused for itself."""

    exposure_time_constant_s: Annotated[float, Field(gt=0, le=1e6), NUMBER] | None = None
    """How slowly `exposure: auto` follows the light: 63 % of a change are done after this time [s]; by default at once,
    each frame by itself."""

    @field_validator("keys", mode="after")
    @classmethod
    def _check_names(cls, keys: Mapping[str, tuple[ValueKeyframe, ...]]) -> Any:
        for name in keys:
            if name.partition(".")[0] == "sequence" or name == "shutter.open_s":
                raise refuse("is no key that may change", got=name, allowed="as camera.f_number", path=(name,))
        return keys

    def open_s(self, first_s: float, frame: int) -> float:
        """Return when the shutter of a frame opens [s]."""
        return first_s + (frame - 1) / self.frames_per_second

    def changes(self, first_s: float, frame: int) -> dict[str, Any]:
        """Return the keys of a scene in a frame, by key path, for `set_keys`.

        Raises
        ------
        InputError
            For a frame that there cannot be.
        """
        if not 1 <= frame <= MOST_FRAMES:
            raise InputError(f"frame: is out of range (got {frame}; allowed: 1 to {MOST_FRAMES})")
        time_s = self.open_s(first_s, frame)
        values = {name: value_at(frames, time_s) for name, frames in self.keys.items()}
        return {"sequence": None, "shutter.open_s": time_s, **values}

    def timecode(self, frame: int) -> str:
        """Return hours, minutes, seconds and frames since the first frame, without dropped numbers."""
        rate = max(round(self.frames_per_second), 1)
        seconds, number = divmod(frame - 1, rate)
        return f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}:{number:02d}"


def value_at(frames: Sequence[ValueKeyframe], time_s: float) -> Any:
    """Return what keyframes say at a moment; the ends hold."""
    index, share = place_between(frames, time_s)
    here = frames[index].value
    return here if share == 0 else _between(here, frames[index + 1].value, share)


def is_even(frames: Sequence[ValueKeyframe]) -> bool:
    """Return whether the values are numbers, or lists of as many numbers, so that they go evenly between keyframes."""
    shapes = {_shape(frame.value) for frame in frames}
    return len(shapes) == 1 and None not in shapes


def _shape(value: Any) -> int | None:
    if isinstance(value, list | tuple):
        return len(value) if all(map(_is_number, value)) else None
    return 0 if _is_number(value) else None


def _between(one: Any, other: Any, share: float) -> Any:
    if _is_number(one) and _is_number(other):
        found = one + share * (other - one)
        if isinstance(one, int) and isinstance(other, int) and abs(found - round(found)) <= ROUNDING * abs(found):
            return round(found)
        return found
    if isinstance(one, list | tuple) and isinstance(other, list | tuple) and len(one) == len(other):
        return [_between(a, b, share) for a, b in zip(one, other, strict=True)]
    return one


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
