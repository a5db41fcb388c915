"""What a scene says about its lens: a name, a file, or the prescription itself."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import BeforeValidator

from rptcam_cl.scene.refusal import refuse

MAX_TEXT = 1000
MAX_DEPTH = 16
MAX_VALUES = 50_000

FORMS = "a name, a file in the scene's folder, or a prescription as a mapping"


def _lens(value: Any) -> str | dict[str, Any]:
    """Return a reference to a lens: short text, or a mapping of plain finite data."""
    if isinstance(value, str):
        if not value.strip() or len(value) > MAX_TEXT or not value.isprintable():
            raise refuse("is not a name or file", allowed=FORMS)
        return value
    if not isinstance(value, dict):
        raise refuse("must be a lens", allowed=FORMS)
    pending: list[tuple[Any, tuple[str | int, ...]]] = [(value, ())]
    for count, (item, path) in enumerate(pending):
        if count > MAX_VALUES or len(path) > MAX_DEPTH:
            raise refuse(f"has more than {MAX_VALUES} values or {MAX_DEPTH} levels", allowed=FORMS)
        pending.extend(_children(item, path))
    return value


def _children(item: Any, path: tuple[str | int, ...]) -> list[tuple[Any, tuple[str | int, ...]]]:
    """Return the values inside a mapping or list, each with its path; refuse what YAML has no form for."""
    if isinstance(item, dict):
        if not all(isinstance(key, (str, int)) for key in item):
            raise refuse("has a key that is neither a word nor a number", path=path)
        return [(child, (*path, key)) for key, child in item.items()]
    if isinstance(item, (list, tuple)):
        return [(child, (*path, index)) for index, child in enumerate(item)]
    if isinstance(item, float) and not math.isfinite(item):
        raise refuse("must be finite", got=item, allowed="a finite number", path=path)
    if item is not None and not isinstance(item, (str, int, float)):
        raise refuse(f"is of a kind that lens files do not have ({type(item).__name__})", got=str(item), path=path)
    return []


LensReference = Annotated[str | dict[str, Any], BeforeValidator(_lens)]
