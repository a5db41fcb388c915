"""The shutter: when and how long light falls on the film."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from rptcam_cl.scene.base import SceneModel
from rptcam_cl.scene.values import read_number, refuse

SHORTEST_S = 1e-9
LONGEST_S = 1e9

_FRACTION = re.compile(r"\s*([0-9]{1,9}(?:\.[0-9]{1,9})?)\s*/\s*([0-9]{1,9}(?:\.[0-9]{1,9})?)\s*")
_FRACTION_FOR_EDITORS = "[0-9]{1,9}(\\.[0-9]{1,9})? */ *[0-9]{1,9}(\\.[0-9]{1,9})? *$"


def _read_duration(value: Any) -> float:
    """Return a number of seconds, or the value of a fraction as engraved on cameras: 1/125."""
    if not isinstance(value, str):
        return read_number(value)
    match = _FRACTION.fullmatch(value)
    if match is None or float(match[2]) == 0:
        problem = "divides by zero" if match else "is neither a number nor a fraction"
        raise refuse(problem, allowed="seconds, as 0.008 or 1/125")
    return float(match[1]) / float(match[2])


def _read_moment(value: Any) -> float:
    """Return a number of seconds or the value of a fraction, which may be negative: -1/125."""
    if isinstance(value, str) and value.strip().startswith("-"):
        return -_read_duration(value.strip()[1:])
    return _read_duration(value)


def _seconds_schema(least: float, sign: str = "") -> WithJsonSchema:
    number = {"type": "number", "minimum": least, "maximum": LONGEST_S}
    return WithJsonSchema({"anyOf": [number, {"type": "string", "pattern": f"^ *{sign}{_FRACTION_FOR_EDITORS}"}]})


Duration = Annotated[
    float, Field(ge=SHORTEST_S, le=LONGEST_S), BeforeValidator(_read_duration), _seconds_schema(SHORTEST_S)
]
Moment = Annotated[
    float, Field(ge=-LONGEST_S, le=LONGEST_S), BeforeValidator(_read_moment), _seconds_schema(-LONGEST_S, "-?")
]


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

    @model_validator(mode="after")
    def _check_readout(self) -> Self:
        if self.kind == "rolling" and self.readout_s is None:
            raise refuse(
                "needs readout_s, the time from the first to the last row",
                got=self.kind,
                allowed="readout_s beside it, for instance 1/30",
                path=("kind",),
            )
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
