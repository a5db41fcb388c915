"""Checked access to the mappings of a lens file: every problem names the file, the key and what would be right."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Any

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.strict_yaml import Document, KeyPath, dotted

# What a key of a lens file is: its meaning and the JSON schema of its value.


@dataclass(frozen=True)
class Key:
    """A key: its meaning in one line, and the JSON schema of its value."""

    text: str
    schema: Mapping[str, Any]


def numbers(least: int, most: int | None = None) -> dict[str, Any]:
    """Return the schema of a list of numbers."""
    return {"type": "array", "items": NUMBER, "minItems": least} | ({} if most is None else {"maxItems": most})


def by_number(value: Mapping[str, Any], **more: Any) -> dict[str, Any]:
    """Return the schema of a mapping whose keys are whole numbers."""
    return {"type": "object", "patternProperties": {r"^[0-9]+$": value}, "additionalProperties": False, **more}


NUMBER = {"type": "number"}
POSITIVE = {"type": "number", "exclusiveMinimum": 0}
TEXT = {"type": "string"}


def mapping(keys: Mapping[str, Key], required: tuple[str, ...] = (), **more: Any) -> dict[str, Any]:
    """Return the schema of a mapping with these keys and no others."""
    properties = {name: {"description": key.text, **key.schema} for name, key in keys.items()}
    entry: dict[str, Any] = {"type": "object", "additionalProperties": False, "properties": properties}
    return entry | ({"required": list(required)} if required else {}) | more


class FieldError(InputError):
    """A value of a lens file that cannot be used: ``FILE:LINE:COL: key.path: text (got ...)``.

    Attributes
    ----------
    path : tuple of str or int
        Keys that lead to the value.
    text : str
        What is wrong, or what would be right.
    """

    def __init__(self, where: str, path: KeyPath, text: str, got: Any = None) -> None:
        shown = "" if got is None else f" (got {_short(got)})"
        key = f"{dotted(path)}: " if path else ""
        super().__init__(f"{where}: {key}{text}{shown}")
        self.path = path
        self.text = text


class Fields:
    """One mapping of a lens file, whose keys are taken one by one."""

    def __init__(self, document: Document, path: KeyPath, allowed: Iterable[str]) -> None:
        self.document = document
        self.path = path
        value = value_at(document, path)
        if not isinstance(value, dict):
            raise problem(document, path, "expected a mapping of keys to values", value)
        self.value: Mapping[Any, Any] = value
        names = sorted(allowed)
        for key in value:
            if key not in names:
                near = difflib.get_close_matches(str(key), names, n=1)
                hint = f"did you mean {near[0]}?" if near else f"allowed: {', '.join(names)}"
                line, column = document.key_mark((*path, key))
                raise FieldError(f"{document.name}:{line}:{column}", (*path, key), f"unknown key ({hint})")

    def __contains__(self, key: str) -> bool:
        return key in self.value

    def get(self, key: str) -> Any:
        """Return the raw value of a key, None when absent."""
        return self.value.get(key)

    def fail(self, key: str | None, text: str) -> FieldError:
        """Return the error for a key, or for the mapping itself."""
        path = self.path if key is None else (*self.path, key)
        return problem(self.document, path, text, self.value.get(key) if key is not None else None)

    def text(self, key: str, default: str = "") -> str:
        """Return a string."""
        value = self.value.get(key, default)
        if not isinstance(value, str):
            raise self.fail(key, "expected text")
        return value

    def flag(self, key: str) -> bool:
        """Return a truth value, False when absent."""
        value = self.value.get(key, False)
        if not isinstance(value, bool):
            raise self.fail(key, "expected true or false")
        return value

    def number(self, key: str, default: float | None = None, infinite: bool = False) -> float:
        """Return a number; without a default the key is required."""
        if key not in self.value:
            if default is None:
                raise self.fail(None, f"{key} is missing")
            return default
        return as_number(self.document, (*self.path, key), infinite)

    def positive(self, key: str, default: float | None = None) -> float:
        """Return a number above 0."""
        value = self.number(key, default)
        if not value > 0:
            raise self.fail(key, "must be above 0")
        return value

    def numbers(self, key: str) -> tuple[float, ...]:
        """Return a list of numbers."""
        value = self.value.get(key)
        if not isinstance(value, list) or not value:
            raise self.fail(key, "expected a list of numbers")
        return tuple(as_number(self.document, (*self.path, key, i)) for i in range(len(value)))

    def span(self, key: str, count: int) -> tuple[int, int]:
        """Return the first and last of neighbours, counted from 0, of which there are `count`."""
        span = self.numbers(key)
        if len(span) != 2 or any(part % 1 for part in span) or not 0 <= span[0] <= span[1] < count:
            raise self.fail(key, f"expected [first, last], two numbers from 0 to {count - 1}")
        return int(span[0]), int(span[1])

    def paths_by_number(self, key: str, least: int, most: int, fault: str) -> list[tuple[int, KeyPath]]:
        """Return the keys of a mapping, whole numbers from least to most, and the paths of their values."""
        numbers = []
        for name in self.value[key]:
            number = int(name) if isinstance(name, int) or (isinstance(name, str) and name.isdigit()) else least - 1
            path = (*self.path, key, name)
            if isinstance(name, bool) or not least <= number <= most:
                raise problem(self.document, path, fault, name)
            numbers.append((number, path))
        return numbers

    def inner(self, key: str, allowed: Iterable[str]) -> Fields:
        """Return the mapping that a key leads to."""
        return Fields(self.document, (*self.path, key), allowed)

    def rows(self, key: str, allowed: Iterable[str], example: str) -> list[Fields]:
        """Return the mappings of a list, none when it is absent."""
        rows = self.value.get(key) or []
        if not isinstance(rows, list):
            raise self.fail(key, f"expected a list such as {example}")
        return [Fields(self.document, (*self.path, key, i), allowed) for i in range(len(rows))]


def as_number(document: Document, path: KeyPath, infinite: bool = False) -> float:
    """Return the number at a key path."""
    value = value_at(document, path)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise problem(document, path, "expected a number", value)
    if not math.isfinite(value) and not (infinite and math.isinf(value)):
        raise problem(document, path, "must be finite", value)
    return float(value)


def problem(document: Document, path: KeyPath, text: str, got: Any = None) -> FieldError:
    """Return the error for the value at a key path."""
    return FieldError(document.where(path), path, text, got)


def value_at(document: Document, path: KeyPath) -> Any:
    """Return the value at a key path."""
    value = document.data
    for part in path:
        value = value[part]
    return value


def rises(wavelengths: tuple[float, ...]) -> bool:
    """Return whether wavelengths are above 0, each longer than the one before."""
    return wavelengths[0] > 0 and all(a < b for a, b in pairwise(wavelengths))


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."
