"""Turns what the scene model refuses into one line each: place, key path, problem, what was given, what is allowed."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple, get_args

from pydantic import ValidationError
from pydantic_core import PydanticCustomError

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.strict_yaml import KeyPath, dotted
from rptcam_cl.scene.base import REFUSED, SceneModel, listed, near_name
from rptcam_cl.scene.lens_settings import IN_WORDS, LAYERED
from rptcam_cl.scene.metal import MEASURED, WRITTEN_OUT
from rptcam_cl.scene.quantities import SPECTRUM
from rptcam_cl.scene.real_lens import DESIGN, REAL
from rptcam_cl.scene.texture import CONSTANT

MAX_REPORTED = 5
SECTIONS = ("camera", "film", "exposure", "shutter", "sequence", "sensor", "spectrum", "render", "picture")

# Names of forms that a value without a kind may have; no keys.
FORMS = (CONSTANT, SPECTRUM, MEASURED, DESIGN, REAL, IN_WORDS, LAYERED)

Where = Callable[[KeyPath, bool], str]

_QUOTED = re.compile(r"'([^']*)'")
_COMPARISONS = {
    "greater_than": ("gt", "more than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}
_WRONG_TYPE = {
    "bool_type": "true or false",
    "string_type": "text",
    "tuple_type": "a list",
    "mapping_type": "a mapping",
    "dict_type": "a mapping",
    "model_attributes_type": "a mapping",
}
_TOO_LONG = {"too_long": "entries", "string_too_long": "letters"}


class _Finding(NamedTuple):
    """What an error says: the problem, what was given, what is allowed, and whether to point at the key itself."""

    problem: str
    got: str = ""
    allowed: str = ""
    at_key: bool = False


def input_error(error: ValidationError, data: Any, where: Where) -> InputError:
    """Return the error to show to the user.

    Parameters
    ----------
    error : ValidationError
        What the model found.
    data : mapping
        The data that the model was given.
    where : callable
        Returns the place of a key path, ``FILE:LINE:COL: `` or the like; the flag: that of the key, not of its value.
    """
    lines = [_line(item, data, where) for item in error.errors(include_url=False)[:MAX_REPORTED]]
    if error.error_count() > MAX_REPORTED:
        lines.append(f"and {error.error_count() - MAX_REPORTED} more problems")
    return InputError("\n".join(lines))


def _line(item: Any, data: Any, where: Where) -> str:
    context = item.get("ctx", {})
    location = item["loc"]
    path, value = _follow(location, data)
    if location[-1:] == ("[key]",):
        path, value = path[:-2], location[-2]
    for key in context.get("path", ()):
        path, value = (*path, key), _child(value, key)
    if item["type"] in ("union_tag_invalid", "union_tag_not_found"):
        path, value = (*path, _tag_key(context["discriminator"])), context.get("tag")
    found = _explain(item["type"], item["msg"], context, value)
    if found.problem == "unknown key" and isinstance(data, Mapping) and "camera" in data:  # of a scene
        found = found._replace(problem=found.problem + _elsewhere(str(path[-1])))
    details = "; ".join(part for part in (found.got, found.allowed and f"allowed: {found.allowed}") if part)
    subject = f"{dotted(path)}: " if path else ""
    return f"{where(path, found.at_key)}{subject}{found.problem}" + (f" ({details})" if details else "")


def _tag_key(discriminator: str) -> str:
    """Return the key that says which form a mapping has; textures are distinguished by a function."""
    return "shape" if "shape" in discriminator else "kind"


def _follow(location: tuple[Any, ...], data: Any) -> tuple[KeyPath, Any]:
    """Return the key path and value of a pydantic location, without the names of union members in it.

    No field is called like the kind or shape of its model, so a part of that name is always a union member.
    """
    path: KeyPath = ()
    value = data
    passed_tag = False
    for key in location:
        if isinstance(value, Mapping):
            if not passed_tag and key in (value.get("kind"), value.get("shape"), WRITTEN_OUT):
                passed_tag = True
                continue
            if key not in value and (isinstance(key, int) or key in FORMS):
                continue
        elif not (isinstance(value, (list, tuple)) and isinstance(key, int)):
            continue
        path, value, passed_tag = (*path, key), _child(value, key), False
    return path, value


def _child(value: Any, key: str | int) -> Any:
    """Return what a key leads to, None when nothing is there."""
    if isinstance(value, Mapping):
        return value.get(key)
    if isinstance(value, (list, tuple)) and isinstance(key, int) and key < len(value):
        return value[key]
    return None


def _explain(kind: str, message: str, context: dict[str, Any], value: Any) -> _Finding:
    """Return what to say of an error of pydantic's."""
    got = f"got {shown(context.get('got', value))}"
    if kind == REFUSED:
        problem = context["problem"]
        return _Finding(problem, got, context["allowed"], at_key=problem.startswith("unknown key"))
    if kind in _COMPARISONS:
        name, words = _COMPARISONS[kind]
        return _Finding("is out of range", got, f"{words} {shown(context[name])}")
    if kind in ("missing", "union_tag_not_found"):
        return _Finding("is required but missing", at_key=True)
    if kind in ("literal_error", "union_tag_invalid"):
        expected = str(context.get("expected", context.get("expected_tags")))
        names = _QUOTED.findall(expected) or re.findall(r"\d+", expected)
        choices = [name for name in names if name != CONSTANT]
        return _Finding(f"is not a known choice{near_name(value, choices)}", got, listed(choices))
    if kind in _TOO_LONG:
        return _Finding("is too long", got, f"at most {context['max_length']} {_TOO_LONG[kind]}")
    if kind in _WRONG_TYPE:
        return _Finding(f"must be {_WRONG_TYPE[kind]}", got)
    return _Finding(message[:1].lower() + message[1:], got)


def _elsewhere(key: str) -> str:
    """Return ``; did you mean section.key?`` for a key that a section of the scene has, or nothing."""
    from rptcam_cl.scene.scene import Scene

    for name in SECTIONS:
        if any(key in model.model_fields for model in _models(Scene.model_fields[name].annotation)):
            return f"; did you mean {name}.{key}?"
    return ""


def _models(annotation: Any) -> Iterator[type[SceneModel]]:
    """Yield the models that a type is made of."""
    if isinstance(annotation, type) and issubclass(annotation, SceneModel):
        yield annotation
    for part in get_args(annotation):
        yield from _models(part)


def refusal_text(refusal: PydanticCustomError) -> str:
    """Return what a refusal outside the model's own validation says."""
    context = dict(refusal.context or {})
    return f"{context['problem']} (got {shown(context['got'])}; allowed: {context['allowed']})"


def shown(value: Any) -> str:
    """Return a value as it would stand in YAML, cut short."""
    if isinstance(value, Mapping):
        return f"a mapping with {listed([str(key) for key in value], most=6)}" if value else "an empty mapping"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(shown(item) for item in value[:6]) + (", …]" if len(value) > 6 else "]")
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.6g}" if math.isfinite(value) else f".{value!r}".replace(".-", "-.")
    text = str(value) if not isinstance(value, int) or abs(value) < 10**40 else "an integer of more than 40 digits"
    text = repr(text) if isinstance(value, str) else text
    return text if len(text) <= 60 else text[:57] + "…"
