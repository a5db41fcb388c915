"""Parameter lists of pbrt directives: read, looked up by name; those that were never looked up are reported."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.importers.pbrt.source import Place
from rptcam_cl.importers.pbrt.tokens import Token, Tokens, number_of

Values = NDArray[np.float64] | tuple[str, ...] | tuple[bool, ...]

# Numbers in one value of each type; "" for types whose values are words.
SIZES = {
    "float": 1, "integer": 1, "point": 3, "point2": 2, "point3": 3, "vector": 3, "vector2": 2, "vector3": 3,
    "normal": 3, "normal3": 3, "rgb": 3, "color": 3, "xyz": 3, "blackbody": 1, "spectrum": 1,
}  # fmt: skip
WORDS = ("string", "texture", "spectrum")
TYPES = (*SIZES, "bool", "string", "texture")
_BOOLS = {"true": True, "false": False}


@dataclass(frozen=True, eq=False)
class Parameter:
    """One parameter, such as ``"rgb Kd" [.5 .4 .3]``.

    Attributes
    ----------
    kind : str
        Its type, a key of `SIZES` or one of `WORDS` or ``bool``.
    values : array of float64, or tuple of str or of bool
    place : Place
    """

    kind: str
    name: str
    values: Values
    place: Place


@dataclass(eq=False)
class Parameters:
    """The parameters of one directive.

    Attributes
    ----------
    what : str
        The directive, for messages.
    place : Place
        Where the directive stands.
    items : dict of str to Parameter
        By name; of a name that is given more than once the last.
    used : set of str
        Names that were looked up.
    repeated : list of Parameter
        Those in whose place a later one of the same name came.
    """

    what: str
    place: Place
    items: dict[str, Parameter] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)
    repeated: list[Parameter] = field(default_factory=list)

    def get(self, name: str, *kinds: str) -> Parameter | None:
        """Return a parameter of one of some types, None when there is none of the name."""
        item = self.items.get(name)
        if item is None:
            return None
        self.used.add(name)
        if kinds and item.kind not in kinds:
            raise item.place.error(f'{self.what}: "{name}" is a {item.kind} (allowed: {", ".join(kinds)})')
        return item

    def numbers(self, name: str, *kinds: str) -> NDArray[np.float64] | None:
        """Return the numbers of a parameter, None when it is absent."""
        item = self.get(name, *(kinds or ("float",)))
        return None if item is None else np.asarray(item.values, np.float64)

    def number(self, name: str, default: float, *kinds: str) -> float:
        """Return a single number."""
        values = self.numbers(name, *kinds)
        return default if values is None else float(self._single(name, list(values)))

    def integer(self, name: str, default: int) -> int:
        """Return a single whole number."""
        value = self.number(name, default, "integer", "float")
        if value != int(value):
            raise self.items[name].place.error(f'{self.what}: "{name}" must be a whole number (got {value:g})')
        return int(value)

    def boolean(self, name: str, default: bool) -> bool:
        """Return a truth value; pbrt-v3 writes it as text."""
        item = self.get(name, "bool", "string")
        if item is None:
            return default
        value = self._single(name, list(item.values))
        if isinstance(value, str):
            if value not in _BOOLS:
                raise item.place.error(f'{self.what}: "{name}" must be true or false (got "{value}")')
            return _BOOLS[value]
        return bool(value)

    def text(self, name: str, default: str) -> str:
        """Return a single text."""
        item = self.get(name, "string")
        return default if item is None else str(self._single(name, list(item.values)))

    def vector(self, name: str, default: Sequence[float]) -> NDArray[np.float64]:
        """Return a point, vector or normal, shape (3,)."""
        values = self.numbers(name, "point", "point3", "vector", "vector3", "normal", "normal3")
        if values is None:
            return np.asarray(default, np.float64)
        if len(values) != 3:
            raise self.items[name].place.error(f'{self.what}: "{name}" needs 3 numbers (got {len(values)})')
        return values

    def rows(self, name: str, width: int, *kinds: str) -> NDArray[np.float64] | None:
        """Return a list of points or vectors, shape (n, width)."""
        values = self.numbers(name, *kinds)
        if values is None:
            return None
        if len(values) % width:
            raise self.items[name].place.error(
                f'{self.what}: "{name}" holds {len(values)} numbers, not a multiple of {width}'
            )
        return values.reshape(-1, width)

    def has(self, name: str) -> bool:
        """Return whether there is a parameter of a name; asking does not use it up."""
        return name in self.items

    def skip(self, *names: str) -> None:
        """Use up parameters that change speed, noise or naming only."""
        self.used.update(names)

    def unused(self) -> Iterator[Parameter]:
        """Yield the parameters that were never looked up."""
        return (item for name, item in self.items.items() if name not in self.used)

    def _single(self, name: str, values: list[float] | list[str] | list[bool]) -> float | str | bool:
        if len(values) != 1:
            raise self.items[name].place.error(f'{self.what}: "{name}" needs one value (got {len(values)})')
        return values[0]


def read_parameters(tokens: Tokens, what: str, place: Place) -> Parameters:
    """Take the parameters that follow in a file, up to the next directive."""
    found = Parameters(what, place)
    while (token := tokens.peek()) is not None and token.kind == "string":
        tokens.take()
        kind, name = _declaration(token, what)
        if name in found.items:
            found.repeated.append(found.items.pop(name))
        found.items[name] = Parameter(kind, name, _values(tokens, token, kind), token.place)
    return found


def _declaration(token: Token, what: str) -> tuple[str, str]:
    words = token.text.split()
    if len(words) != 2:
        raise token.place.error(f'{what}: expected a parameter such as "float fov" (got {token.shown()})')
    kind, name = words
    if kind not in TYPES:
        raise token.place.error(f"{what}: unknown type {kind} of parameter {name} (allowed: {', '.join(TYPES)})")
    return kind, name


def _values(tokens: Tokens, declared: Token, kind: str) -> Values:
    values: Values | None = tokens.numbers_in_brackets()
    if values is None:
        values = _of_words(_listed(tokens, declared), declared)
    is_text = isinstance(values, tuple) and all(isinstance(value, str) for value in values)
    name = declared.shown()
    if isinstance(values, tuple) and not is_text and kind != "bool":
        raise declared.place.error(f"{name} must hold numbers or text, not true or false")
    if kind == "bool" and isinstance(values, np.ndarray) and len(values):
        raise declared.place.error(f"{name} must hold true or false")
    if is_text and values and kind not in (*WORDS, "bool"):
        raise declared.place.error(f"{name} must hold numbers, not text")
    if kind in ("string", "texture") and isinstance(values, np.ndarray):
        raise declared.place.error(f"{name} must hold text in quotes")
    if isinstance(values, np.ndarray) and len(values) % SIZES.get(kind, 1):
        raise declared.place.error(f"{name} holds {len(values)} numbers, not a multiple of {SIZES[kind]}")
    return values


def _listed(tokens: Tokens, declared: Token) -> list[Token]:
    """Take the value, or the values in brackets, of a parameter."""
    token = tokens.take()
    if token is None:
        raise declared.place.error(f"{declared.shown()} has no value: the file ends here")
    if token.kind != "bracket":
        return [token]
    if token.text == "]":
        raise token.place.error(f"expected the value of {declared.shown()} (got ])")
    found = []
    while (item := tokens.take()) is not None:
        if item.kind != "bracket":
            found.append(item)
        elif item.text == "]":
            return found
        else:
            raise item.place.error(f"a second [ in the values of {declared.shown()}")
    raise token.place.error("this [ is never closed")


def _of_words(found: list[Token], declared: Token) -> Values:
    if found and found[0].kind == "string":
        for token in found:
            if token.kind != "string":
                raise token.place.error(f"{declared.shown()} mixes text with other values (got {token.shown()})")
        return tuple(token.text for token in found)
    if found and found[0].text in _BOOLS:
        for token in found:
            if token.text not in _BOOLS or token.kind != "word":
                raise token.place.error(f"expected true or false (got {token.shown()})")
        return tuple(_BOOLS[token.text] for token in found)
    if found and re.match(r"[A-Z]", found[0].text):
        raise declared.place.error(f"{declared.shown()} has no value; {found[0].shown()} follows")
    return np.array([number_of(token) for token in found], np.float64)
