"""Numbers of a scene: finite, inside the range of float32, and never text or booleans."""

from __future__ import annotations

import math
import re
from numbers import Real
from typing import Any

import numpy as np
from pydantic_core import PydanticCustomError

from rptcam_cl.scene.refusal import refuse

FLOAT32_MAX = 3.4028234663852886e38
FLOAT32_MIN_NORMAL = 1.1754943508222875e-38

_LOOKS_NUMERIC = re.compile(r"[-+]?[0-9.][0-9_.,:eExXoOa-fA-F+-]*")


def read_number(value: Any) -> float:
    """Return a finite float that float32 can hold."""
    if isinstance(value, str):
        hint = "is text, not a number"
        if _LOOKS_NUMERIC.fullmatch(value):
            hint += " (write plain decimal digits without quotes, colons or underscores)"
        raise refuse(hint, allowed="a number")
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, Real):
        raise refuse("must be a number", allowed="a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise refuse("must be finite", allowed="a finite number")
    if abs(number) > FLOAT32_MAX:
        raise refuse("is beyond the range of float32", allowed=f"at most {FLOAT32_MAX:.3g}")
    if 0 < abs(number) < FLOAT32_MIN_NORMAL:
        raise refuse("is below the range of float32", allowed=f"0, or at least {FLOAT32_MIN_NORMAL:.3g} in size")
    return number


def number_at(value: Any, path: tuple[int, ...]) -> float:
    """Return a finite float that float32 can hold, from the given place inside a value."""
    try:
        return read_number(value)
    except PydanticCustomError as problem:
        context = dict(problem.context or {})
        raise refuse(context["problem"], got=value, allowed=context["allowed"], path=path) from None
