"""How a validator of the scene model refuses a value: what is wrong, where, and what would be right."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from typing import Any

from pydantic_core import PydanticCustomError

REFUSED = "refused"

_UNSET = object()

# Words that mean a name without looking like it, or while looking more like its opposite.
_MEANS = {"nearest": "closest", "near": "closest", "far": "farthest", "middle": "centre", "median": "weighted"}


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
