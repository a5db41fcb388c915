"""The JSON of a glTF file, read key by key; what is not as it must be is refused with its place."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from rptcam_cl.core.errors import InputError


class JsonNode:
    """A mapping of the JSON and where it stands.

    Parameters
    ----------
    value : dict
        Plain data.
    place : str
        ``bunny.glb: materials[2]``, for errors.
    """

    def __init__(self, value: Any, place: str) -> None:
        if not isinstance(value, dict):
            raise InputError(f"{place}: must be a mapping (got {_shown(value)})")
        self._value = value
        self.place = place

    def wrong(self, key: str, problem: str, allowed: str) -> InputError:
        """Return the error for a key's value."""
        return InputError(f"{self.place}.{key}: {problem} (got {_shown(self._value.get(key))}; allowed: {allowed})")

    def has(self, key: str) -> bool:
        """Return whether a key is there."""
        return key in self._value

    def names(self) -> list[str]:
        """Return the keys."""
        return list(self._value)

    def part(self, key: str) -> JsonNode:
        """Return the mapping of a key, an empty one when there is none."""
        return JsonNode(self._value.get(key, {}), f"{self.place}.{key}")

    def parts(self, key: str) -> list[JsonNode]:
        """Return the mappings in the list of a key."""
        return [JsonNode(value, f"{self.place}.{key}[{index}]") for index, value in enumerate(self._list(key))]

    def _list(self, key: str) -> list[Any]:
        value = self._value.get(key, [])
        if not isinstance(value, list):
            raise self.wrong(key, "must be a list", "a list")
        return value

    def text(self, key: str, default: str = "") -> str:
        """Return the text of a key."""
        value = self._value.get(key, default)
        if not isinstance(value, str):
            raise self.wrong(key, "must be text", "text")
        return value

    def flag(self, key: str) -> bool:
        """Return whether a key is true."""
        return self._value.get(key, False) is True

    def number(self, key: str, default: float, low: float = -math.inf, high: float = math.inf) -> float:
        """Return the finite number of a key, inside its span; without the key the default, which may be infinite."""
        if key not in self._value:
            return default
        value = self._value[key]
        if not _is_number(value) or not low <= value <= high:
            raise self.wrong(key, "must be a number in its range", f"{low:g} to {high:g}")
        return float(value)

    def whole(self, key: str, default: int | None = None, below: int = 2**53) -> int:
        """Return the whole number of a key, 0 or more and below a limit; without a default it must be there."""
        value: Any = self._value.get(key, default)
        if not _is_number(value) or value != int(value) or not 0 <= value < below:
            raise self.wrong(key, "must be a whole number in its range", f"0 to {below - 1}" if below else "none")
        return int(value)

    def wholes(self, key: str, below: int) -> list[int]:
        """Return the whole numbers in the list of a key."""
        values = self._list(key)
        if not all(_is_number(value) and value == int(value) and 0 <= value < below for value in values):
            raise self.wrong(key, "must be a list of whole numbers in their range", f"0 to {below - 1}")
        return [int(value) for value in values]

    def numbers(self, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """Return as many finite numbers as the default has."""
        values = self._value.get(key, default)
        if not isinstance(values, (list, tuple)) or len(values) != len(default) or not all(map(_is_number, values)):
            raise self.wrong(key, f"must be {len(default)} finite numbers", f"a list of {len(default)} numbers")
        return tuple(float(value) for value in values)

    def texts(self, key: str) -> list[str]:
        """Return the texts in the list of a key."""
        values = self._list(key)
        if not all(isinstance(value, str) for value in values):
            raise self.wrong(key, "must be a list of texts", "a list of texts")
        return values

    def extensions(self, *names: str) -> Iterator[JsonNode]:
        """Yield those of the extensions that are there."""
        extensions = self.part("extensions")
        for name in names:
            if extensions.has(name):
                yield extensions.part(name)


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    return abs(value) < 1e300 if isinstance(value, int) else math.isfinite(value)


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "…"
