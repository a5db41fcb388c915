"""The shutter: how long light falls on the film."""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, WithJsonSchema

from rptcam_cl.scene.base import SceneModel
from rptcam_cl.scene.numbers import read_number
from rptcam_cl.scene.refusal import refuse

SHORTEST_S = 1e-9
LONGEST_S = 1e9

_FRACTION = re.compile(r"\s*([0-9]{1,9}(?:\.[0-9]{1,9})?)\s*/\s*([0-9]{1,9}(?:\.[0-9]{1,9})?)\s*")
_FRACTION_FOR_EDITORS = "^ *[0-9]{1,9}(\\.[0-9]{1,9})? */ *[0-9]{1,9}(\\.[0-9]{1,9})? *$"


def _read_duration(value: Any) -> float:
    """Return a number of seconds, or the value of a fraction as engraved on cameras: 1/125."""
    if not isinstance(value, str):
        return read_number(value)
    match = _FRACTION.fullmatch(value)
    if match is None or float(match[2]) == 0:
        problem = "divides by zero" if match else "is neither a number nor a fraction"
        raise refuse(problem, allowed="seconds, as 0.008 or 1/125")
    return float(match[1]) / float(match[2])


Duration = Annotated[
    float,
    Field(ge=SHORTEST_S, le=LONGEST_S),
    BeforeValidator(_read_duration),
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "number", "minimum": SHORTEST_S, "maximum": LONGEST_S},
                {"type": "string", "pattern": _FRACTION_FOR_EDITORS},
            ]
        }
    ),
]


class Shutter(SceneModel):
    """The shutter."""

    time_s: Duration = 1 / 60
    """How long it is open [s]: a number, or a fraction such as 1/125."""
