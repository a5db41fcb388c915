"""Tokens of a pbrt file: words, quoted strings, brackets; comments begin with #."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.importers.pbrt.source import Place, Source

_TOKEN = re.compile(
    r"""(?P<blank>\s+|\#[^\n]*) | (?P<string>"(?:[^"\\\n]|\\.)*") | (?P<bracket>[\[\]]) | (?P<word>[^\s"\[\]#]+)""",
    re.VERBOSE,
)
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_ESCAPES = {"b": "\b", "f": "\f", "n": "\n", "r": "\r", "t": "\t", "\\": "\\", "'": "'", '"': '"'}
LONGEST_SHOWN = 60


@dataclass(frozen=True)
class Token:
    """A token: ``kind`` is string, bracket or word; ``text`` that of a string is without quotes and escapes."""

    kind: str
    text: str
    place: Place

    def shown(self) -> str:
        """Return the token as an error quotes it."""
        text = f'"{self.text}"' if self.kind == "string" else self.text
        return text if len(text) <= LONGEST_SHOWN else text[:LONGEST_SHOWN] + "…"


class Tokens:
    """The tokens of one file, one after another."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self._offset = 0
        self._ahead: Token | None = None

    def peek(self) -> Token | None:
        """Return the next token without taking it; None at the end of the file."""
        if self._ahead is None:
            self._ahead = self._read()
        return self._ahead

    def take(self) -> Token | None:
        """Return the next token; None at the end of the file."""
        token, self._ahead = self.peek(), None
        return token

    def numbers_in_brackets(self) -> NDArray[np.float64] | None:
        """Take a bracketed list that holds nothing but numbers at once; None, taking nothing, when it holds more.

        The long lists of meshes are read here, at the speed of ``str.split``.
        """
        opening = self.peek()
        if opening is None or opening.text != "[" or opening.kind != "bracket":
            return None
        text, start = self.source.text, opening.place.offset + 1
        end = text.find("]", start)
        if end < 0:
            raise opening.place.error("this [ is never closed")
        inside = text[start:end]
        if any(mark in inside for mark in '"#[_') or "n" in inside.lower():
            return None
        try:
            numbers = np.array(inside.split(), np.float64)
        except ValueError:
            return None
        if not np.isfinite(numbers).all():
            return None
        self._ahead, self._offset = None, end + 1
        return numbers

    def _read(self) -> Token | None:
        for match in self._matches():
            place = Place(self.source, match.start())
            if match.lastgroup == "string":
                return Token("string", _unescaped(match[0][1:-1], place), place)
            if match.lastgroup != "blank":
                return Token(str(match.lastgroup), match[0], place)
        return None

    def _matches(self) -> Iterator[re.Match[str]]:
        text = self.source.text
        while self._offset < len(text):
            match = _TOKEN.match(text, self._offset)
            if match is None:  # only a quotation mark begins no token
                raise Place(self.source, self._offset).error('this " has no partner on its line')
            self._offset = match.end()
            yield match


def number_of(token: Token) -> float:
    """Return the number that a word says."""
    if token.kind != "word" or not _NUMBER.fullmatch(token.text):
        raise token.place.error(f"expected a number (got {token.shown()})")
    number = float(token.text)
    if abs(number) == float("inf"):
        raise token.place.error(f"{token.shown()} is beyond the range of numbers (about 1.8e308)")
    return number


def _unescaped(text: str, place: Place) -> str:
    if "\\" not in text:
        return text

    def replaced(match: re.Match[str]) -> str:
        if match[1] not in _ESCAPES:
            known = " ".join(f"\\{mark}" for mark in _ESCAPES)
            raise place.error(f"unknown escape \\{match[1]} in a string (allowed: {known}; folders end in /)")
        return _ESCAPES[match[1]]

    return re.sub(r"\\(.)", replaced, text)
