"""Exposure and shutter, and keys of a scene that change from frame to frame."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, Self, get_args

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PlainSerializer,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.base import AlsoAccepts, SceneModel, listed, refuse, word_for
from rptcam_cl.scene.camera import Camera, FNumber
from rptcam_cl.scene.placement import MOST_KEYFRAMES, Keyframe, in_order, place_between
from rptcam_cl.scene.quantities import NUMBER, WHOLE_NUMBER, Duration, FilmPoint, Moment, Vectors

# Sequences: keys of a scene that change from frame to frame, by keyframes.

MOST_FRAMES = 1_000_000
_ROUNDING = 1e-9  # of a number between whole ones, which is whole itself then: seeds and counts must be


def _rows_or_plain(value: Any) -> Any:
    """Return an array of numbers as rows that do not change, which compare by their content; others as they are."""
    is_array = isinstance(value, np.ndarray) and value.dtype.kind in "iuf"
    return Vectors(value.astype(np.float64)) if is_array else value


def _plain(value: Any) -> Any:
    return value.plain() if isinstance(value, Vectors) else value


class ValueKeyframe(Keyframe):
    """What a key is at a moment."""

    value: Annotated[Any, BeforeValidator(_rows_or_plain), PlainSerializer(_plain), WithJsonSchema({})]
    """As at the key itself; numbers, lists and rows of them go straight to the next keyframe, others stay until it."""


_ValueKeyframes = Annotated[
    tuple[ValueKeyframe, ...], Field(min_length=1, max_length=MOST_KEYFRAMES), AfterValidator(in_order)
]


class ContinuousFocus(SceneModel):
    """How autofocus follows from frame to frame: as a servo, which predicts where the subject will be."""

    hold: Annotated[float, Field(ge=0, le=1e6), NUMBER] = 0.25
    """How far a subject at rest may be from the focus before it is followed [depths of focus]."""

    lock_s: Annotated[float, Field(ge=0, le=1e6), NUMBER] = 0.25
    """How long another subject must be measured before the focus goes there, so that what crosses the picture is let
    pass, and how long a prediction goes on where nothing is found [s]."""

    delay_s: Annotated[float, Field(ge=0, le=10), NUMBER] = 0.05
    """How long after a measurement it is known [s]."""

    speed: Annotated[float, Field(gt=0, le=1e9), NUMBER] | None = None
    """How fast the focus goes at most [depths of focus per second]; by default as fast as the drive of the lens."""


class FrameSequence(SceneModel):
    """Keys that change from frame to frame; within a frame they stay."""

    frames_per_second: Annotated[float, Field(ge=1e-3, le=1e6), NUMBER] = 24.0
    """Frame 1 opens its shutter at `shutter.open_s`, each next one this much later."""

    keys: Mapping[str, _ValueKeyframes] = {}
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
    """Interpolate keyframes at a moment; the ends hold."""
    index, share = place_between(frames, time_s)
    here = frames[index].value
    value = here if share == 0 else _between(here, frames[index + 1].value, share)
    return value.rows if isinstance(value, Vectors) else value


def _is_even(frames: Sequence[ValueKeyframe]) -> bool:
    """Return whether the values are numbers, or lists of as many numbers, so that they go evenly between keyframes."""
    shapes = {_shape(frame.value) for frame in frames}
    return len(shapes) == 1 and None not in shapes


def _shape(value: Any) -> tuple[int, ...] | None:
    if isinstance(value, Vectors):
        return value.rows.shape
    if isinstance(value, list | tuple):
        parts = {_shape(each) for each in value}
        return None if None in parts or len(parts) != 1 else (len(value), *parts.pop())  # type: ignore[misc]
    return () if _is_number(value) else None


def _between(one: Any, other: Any, share: float) -> Any:
    if _is_number(one) and _is_number(other):
        value = one + share * (other - one)
        if isinstance(one, int) and isinstance(other, int) and abs(value - round(value)) <= _ROUNDING * abs(value):
            return round(value)
        return value
    if isinstance(one, Vectors) and _shape(other) == _shape(one):
        end = np.asarray(other.rows if isinstance(other, Vectors) else other)
        return Vectors(one.rows + share * (end - one.rows))
    if isinstance(one, list | tuple) and isinstance(other, list | tuple) and len(one) == len(other):
        return [_between(a, b, share) for a, b in zip(one, other, strict=True)]
    return one


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


# Exposure and shutter: what a value of 1 on the film stands for, and when light falls on it.

_MOVES_IN_EXPOSURE = ("camera", "materials", "objects", "lights", "environment")
_MOST_STEPS = 4096


class Shutter(SceneModel):
    """The shutter. What moves is smeared over the time that it is open."""

    time_s: Duration = 1 / 60
    """How long it is open [s]: a number, or a fraction such as 1/125."""

    open_s: Moment = 0.0
    """When it opens [s], on the clock of the keyframes."""

    kind: Literal["global", "rolling"] = "global"
    """Whether all of the picture is exposed at once, or row after row."""

    readout_s: Duration | None = None
    """With a rolling shutter: how much later the last row is exposed than the first [s]."""

    direction: Literal["top_down", "bottom_up", "left_right", "right_left"] = "top_down"
    """With a rolling shutter: which way the rows follow each other in the picture."""

    keys: Mapping[str, _ValueKeyframes] = {}
    """Keys that change while it is open, as `camera.focal_length_mm`: keyframes by key path, of numbers."""

    steps: Annotated[int, Field(ge=2, le=_MOST_STEPS), WHOLE_NUMBER] = 32
    """Into how many equal steps the exposure is cut for `keys`, which hold still within each."""

    @field_validator("keys", mode="after")
    @classmethod
    def _check_moving_keys(cls, keys: Mapping[str, _ValueKeyframes]) -> Any:
        for name, frames in keys.items():
            if re.split(r"[.[]", name)[0] not in _MOVES_IN_EXPOSURE:
                raise refuse(
                    "is no key that moves while the shutter is open",
                    got=name,
                    allowed=f"keys of {listed(_MOVES_IN_EXPOSURE)}, as camera.focal_length_mm",
                    path=(name,),
                )
            if not _is_even(frames):
                raise refuse(
                    "does not go evenly",
                    got=name,
                    allowed="numbers, or lists or rows of as many numbers in each keyframe",
                    path=(name,),
                )
        return keys

    @model_validator(mode="after")
    def _check_readout(self) -> Self:
        if self.kind == "rolling" and self.readout_s is None:
            raise refuse(
                "needs readout_s, the time from the first to the last row",
                got=self.kind,
                allowed="readout_s beside it, for instance 1/30",
                path=("kind",),
            )
        if self.kind == "rolling" and self.keys:
            raise refuse(
                "exposes each row at its own time, and keys are the same for all",
                got=self.kind,
                allowed="kind: global beside keys, or keys in sequence.keys, which hold still within a frame",
                path=("kind",),
            )
        if not self.keys and self.steps != type(self).model_fields["steps"].default:
            raise refuse("cuts the exposure for keys", got=self.steps, allowed="keys beside it", path=("steps",))
        for key in ("readout_s", "direction"):
            if self.kind == "global" and getattr(self, key) != type(self).model_fields[key].default:
                raise refuse(
                    "belongs to a rolling shutter",
                    got=getattr(self, key),
                    allowed="kind: rolling beside it",
                    path=(key,),
                )
        return self

    @property
    def span_s(self) -> tuple[float, float]:
        """When the first light falls on the film, and the last [s]."""
        return self.open_s, self.open_s + (self.readout_s or 0.0) + self.time_s


Mode = Literal["relative", "irradiance", "physical", "auto"]
_MODES: tuple[Mode, ...] = get_args(Mode)

LEAST_ISO, MOST_ISO = 1e-6, 1e12
MOST_STOPS = 60
LEAST_CD_M2, MOST_CD_M2 = 1e-12, 1e20

# The keys that only some modes read.
_BELONGS: dict[str, tuple[Mode, ...]] = {
    "iso": ("physical", "auto"),
    "f_number": ("irradiance", "physical", "auto"),
    "target": ("auto",),
    "priority": ("auto",),
    "metering": ("auto",),
    "spot_at": ("auto",),
    "lock_cd_m2": ("auto",),
}


class Exposure(SceneModel):
    """The exposure: the factor from the light on the film to the values of the picture."""

    mode: Mode = "relative"
    """What the value 1 stands for: a field of radiance 1 seen on the axis, an irradiance of 1 W/m², the saturation of
    the sensor of the given ISO, or what metering makes of it."""

    iso: Annotated[float, Field(ge=LEAST_ISO, le=MOST_ISO), NUMBER] = 100.0
    """Sensitivity of the sensor, ISO 12232."""

    ev: Annotated[float, Field(ge=-MOST_STOPS, le=MOST_STOPS), NUMBER] = 0.0
    """Exposure compensation [stops]; +1 doubles the values."""

    neutral_density_stops: Annotated[float, Field(ge=0, le=MOST_STOPS), NUMBER] = 0.0
    """Neutral-density filter before the lens [stops]; 3 let an eighth of the light pass."""

    f_number: FNumber | None = None
    """F-number of the ideal lens that a camera without a lens stands for."""

    target: Annotated[float, Field(ge=1e-6, le=1e6), NUMBER] = 0.18
    """Value that the metered mean is brought to."""

    priority: Literal["aperture", "shutter"] = "aperture"
    """What stays as it is set: the aperture and the ISO, so that the time is chosen, or the aperture and the time, so
    that the ISO is."""

    metering: Literal["average", "centre_weighted", "spot"] = "average"
    """What is metered: the frame evenly, three quarters in a disk in the middle, or a disk of 2 % of the frame."""

    spot_at: FilmPoint = (0.5, 0.5)
    """Middle of the metered spot, as fractions of the frame from its left and top edges."""

    lock_cd_m2: Annotated[float, Field(ge=LEAST_CD_M2, le=MOST_CD_M2), NUMBER] | None = None
    """Metered luminance to go by in place of metering [cd/m²], as `metered_cd_m2` of another picture's metadata."""

    @model_validator(mode="after")
    def _check_keys_of_the_mode(self) -> Self:
        for key, modes in _BELONGS.items():
            if self.says(key) and self.mode not in modes:
                raise refuse(
                    f"means nothing with mode {self.mode}",
                    got=getattr(self, key),
                    allowed=f"mode {' or '.join(modes)} beside it",
                    path=(key,),
                )
        if self.says("spot_at") and self.metering != "spot":
            raise refuse("places a spot", got=list(self.spot_at), allowed="metering: spot beside it", path=("spot_at",))
        return self

    def says(self, key: str) -> bool:
        """Return whether a key has another value than by default."""
        return bool(getattr(self, key) != type(self).model_fields[key].default)

    @property
    def factor(self) -> float:
        """What compensation and filter multiply the light by."""
        return float(2.0 ** (self.ev - self.neutral_density_stops))


ExposureOrMode = Annotated[
    Exposure,
    word_for("mode", _MODES, otherwise=f", or a mapping with the keys {listed(list(Exposure.model_fields))}"),
    AlsoAccepts({"enum": list(_MODES), "type": "string"}),
]


def check_exposure(exposure: Exposure, camera: Camera) -> None:
    """Refuse an exposure that says too little about a camera without a lens opening, or too much."""
    if camera.has_opening:
        if exposure.f_number is not None:
            raise refuse(
                f"is for cameras without a lens opening, not for one of kind {camera.kind}",
                got=exposure.f_number,
                allowed="camera.f_number",
                path=("exposure", "f_number"),
            )
    elif exposure.f_number is None:
        if exposure.mode in ("irradiance", "physical"):
            raise refuse(
                f"needs the irradiance of a film, and a camera of kind {camera.kind} without a lens opening has none",
                got=exposure.mode,
                allowed=f"relative or auto; {{mode: {exposure.mode}, f_number: 8}} to have it stand for such a lens",
                path=("exposure",),
            )
        for key in ("iso", "priority", "neutral_density_stops"):
            if exposure.mode == "auto" and exposure.says(key):
                raise refuse(
                    f"means nothing for a camera of kind {camera.kind} without a lens opening",
                    got=getattr(exposure, key),
                    allowed="exposure.f_number beside it",
                    path=("exposure", key),
                )
