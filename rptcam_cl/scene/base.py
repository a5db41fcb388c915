"""Base of the scene model: frozen models closed to unknown keys, finite numbers, and how a value is refused."""

from __future__ import annotations

import ast
import inspect
import math
import re
import textwrap
from collections.abc import Sequence
from difflib import get_close_matches
from functools import lru_cache
from itertools import pairwise
from numbers import Real
from typing import Any, ClassVar, NamedTuple, get_args

import numpy as np
from pydantic import BaseModel, ConfigDict, GetJsonSchemaHandler, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError

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
    if not matches:  # the name without its unit, as fov for fov_degrees
        matches = [name for name in lower if given and name.startswith(f"{given}_")][:1]
    return f"; did you mean {lower[matches[0]]}?" if matches else ""


def listed(names: Sequence[str], most: int = 24) -> str:
    """Return names separated by commas, cut short when there are many."""
    shown = ", ".join(names[:most])
    return f"{shown}, … ({len(names)} in all)" if len(names) > most else shown


FLOAT32_MAX = 3.4028234663852886e38
FLOAT32_MIN_NORMAL = 1.1754943508222875e-38

_ALMOST_NUMERIC = re.compile(r"[-+]?[0-9.][0-9_.,:eExXoOa-fA-F+-]*")


def read_number(value: Any) -> float:
    """Return a finite float that float32 can hold."""
    if isinstance(value, str):
        hint = "is text, not a number"
        if _ALMOST_NUMERIC.fullmatch(value):
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


class Alternatives(NamedTuple):
    """Keys of one mapping of which at most one may be set.

    Attributes
    ----------
    keys : tuple of str
        The keys that exclude each other.
    required : bool
        Whether one of them must be there.
    """

    keys: tuple[str, ...]
    required: bool


class AlsoAccepts:
    """Adds to a field's JSON schema a form that its validator turns into the declared one."""

    def __init__(self, form: dict[str, Any]) -> None:
        self.form = form

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Return the JSON schema of either form."""
        return {"anyOf": [self.form, handler(schema)]}


class AlsoAcceptsItem:
    """Adds to the JSON schema of a list that a single item may stand for a list of one."""

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Return the JSON schema of either form."""
        described = handler(schema)
        return {"anyOf": [described["items"], described]}


class SceneModel(BaseModel):
    """A part of a scene. Its fields are the keys of the YAML mapping; instances do not change."""

    # Schemas are built and descriptions read when they are needed: a command starts in two thirds of the time.
    model_config = ConfigDict(frozen=True, extra="forbid", hide_input_in_errors=True, defer_build=True)

    alternatives: ClassVar[tuple[Alternatives, ...]] = ()

    @model_validator(mode="before")
    @classmethod
    def _check_keys(cls, data: Any) -> Any:
        if isinstance(data, SceneModel):
            return data
        names = list(cls.model_fields)
        if not isinstance(data, dict):
            raise refuse("must be a mapping", allowed=f"a mapping with the keys {listed(names)}")
        for key in data:
            if key not in cls.model_fields:
                hint = _owners(cls, key) or near_name(key, names)
                raise refuse(f"unknown key{hint}", got=key, allowed=listed(names), path=(key,))
        for group in cls.alternatives:
            _check_alternatives(group, data)
        return data

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Return the JSON schema with the keys' descriptions and the rule on excluding keys added."""
        described = handler(schema)
        target = handler.resolve_ref_schema(described)
        for name, text in _descriptions(cls).items():
            value = target.get("properties", {}).get(name)
            if value is not None and handler.resolve_ref_schema(value).get("description") != text:
                value["description"] = text
        rules = [_alternatives_schema(group) for group in cls.alternatives]
        if rules:
            target["allOf"] = rules
        return described


@lru_cache(maxsize=256)
def _descriptions(model: type[SceneModel]) -> dict[str, str]:
    """Return the text below each field of a model and of its bases, by the field's name."""
    found: dict[str, str] = {}
    for base in reversed(model.__mro__):
        if not issubclass(base, BaseModel) or base is BaseModel:
            continue
        [body] = ast.parse(textwrap.dedent(inspect.getsource(base))).body
        assert isinstance(body, ast.ClassDef)
        for field, text in pairwise(body.body):
            if not (isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)):
                continue
            if (
                isinstance(text, ast.Expr)
                and isinstance(text.value, ast.Constant)
                and isinstance(text.value.value, str)
            ):
                found[field.target.id] = inspect.cleandoc(text.value.value)
    return found


def _check_alternatives(group: Alternatives, data: dict[str, Any]) -> None:
    present = [key for key in group.keys if data.get(key) is not None]
    choice = " | ".join(group.keys)
    if len(present) > 1:
        raise refuse(
            f"cannot be given together with {present[0]}",
            allowed=f"{'exactly' if group.required else 'at most'} one of {choice}",
            path=(present[-1],),
        )
    if group.required and not present:
        raise refuse(f"needs one of {choice}", allowed=f"exactly one of {choice}")


def _alternatives_schema(group: Alternatives) -> dict[str, Any]:
    """Return the JSON schema rule: one of the keys, or none where that is allowed."""
    one_each: list[dict[str, Any]] = [{"required": [key]} for key in group.keys]
    if not group.required:
        one_each.append({"not": {"anyOf": [{"required": [key]} for key in group.keys]}})
    return {"oneOf": one_each}


def _owners(model: type[SceneModel], key: str) -> str:
    """Return ``; kind a has it`` where a key that one kind of a part does not know belongs to others, or nothing."""
    root = [base for base in model.__mro__ if issubclass(base, SceneModel) and base is not SceneModel][-1]
    kin = [root]
    for each in kin:
        kin += [heir for heir in each.__subclasses__() if heir not in kin]
    kinds = [
        get_args(each.model_fields["kind"].annotation)[0] for each in kin if {key, "kind"} <= set(each.model_fields)
    ]
    if not kinds:
        return ""
    return f"; kind {kinds[0]} has it" if len(kinds) == 1 else f"; kinds {', '.join(kinds)} have it"
