"""Numbers of a scene, finite and inside float32, and how a validator refuses a value."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from difflib import get_close_matches
from numbers import Real
from typing import Any

import numpy as np
from pydantic_core import PydanticCustomError

REFUSED = "refused"

_UNSET = object()

# Words that mean a name without looking like it, or while looking more like its opposite; and a name that was.
_MEANS = {
    "nearest": "closest",
    "near": "closest",
    "far": "farthest",
    "middle": "centre",
    "median": "weighted",
    "filmic": "aces",
}


def refuse(
    problem: str, *, got: Any = _UNSET, allowed: str = "", path: tuple[str | int, ...] = ()
) -> PydanticCustomError:
    """Return the error to raise for a value that the scene model does not take.

    Parameters
    ----------
    problem : str
        What is wrong, as a sentence without its subject: ``must not be zero``.
    got : optional
        The offending value, when it is not the one that the validator was given.
    allowed : str
        What would be right.
    path : tuple of str or int
        Keys that lead from the validated value to the offending one.
    """
    context: dict[str, Any] = {"problem": problem, "allowed": allowed, "path": path}
    if got is not _UNSET:
        context["got"] = got
    return PydanticCustomError(REFUSED, "{problem}", context)


def near_name(word: object, names: Sequence[str]) -> str:
    """Return ``; did you mean name?`` for the name that means the same as a word or is most like it, or nothing."""
    lower, given = {name.lower(): name for name in names}, str(word).lower()
    same = _MEANS.get(given)
    matches = [same] if same in lower else get_close_matches(given, lower, n=1, cutoff=0.6)
    return f"; did you mean {lower[matches[0]]}?" if matches else ""


def listed(names: Sequence[str], most: int = 24) -> str:
    """Return names separated by commas, cut short when there are many."""
    shown = ", ".join(names[:most])
    return f"{shown}, … ({len(names)} in all)" if len(names) > most else shown


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
