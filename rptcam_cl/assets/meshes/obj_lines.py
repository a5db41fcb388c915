"""OBJ files in blocks of many lines, sorted by keyword, and their numbers, without a Python step a line."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError

Line = tuple[int, bytes]


def parsed(text: bytes) -> NDArray[np.float64] | None:
    """Return the numbers in a text, None when something else is in it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return np.fromstring(text, np.float64, sep=" ")
    except (ValueError, DeprecationWarning):
        return None


def numbers_of_lines(lines: Sequence[Line], each: int, what: str, path: Path) -> NDArray[np.float64]:
    """Return the first numbers (n, each) of lines that may have more of them.

    Parameters
    ----------
    lines : sequence of (number, text)
        Lines without their keyword, with their place in the file.
    each : int
        How many numbers a line must have at least.
    what : str
        What an error calls a line.
    path : Path
        The file, for errors.
    """
    if not lines:
        return np.empty((0, each))
    found = parsed(b" ".join(text for _, text in lines))
    width = len(lines[0][1].split())
    if found is not None and width >= each and all(len(text.split()) == width for _, text in lines):
        return found.reshape(-1, width)[:, :each]
    rows = np.empty((len(lines), each))
    for place, (number, text) in enumerate(lines):
        row = parsed(text) if text.strip() else None
        if row is None or len(row) < each:
            got = text.decode("latin-1").strip()[:60]
            raise InputError(f"{path}:{number}: is not {what} (got {got!r}; allowed: {each} numbers)")
        rows[place] = row[:each]
    return rows


BLOCK_BYTES = 1 << 23
KEYWORDS = (b"v", b"vt", b"vn", b"f")
BLANK = 32  # this and all below separate words

_INDENT = re.compile(rb"(?m)^[ \t]+")
_CONTINUED = re.compile(rb"\\\r?\n([^\n]*)(?:\n|$)")


class KeywordLines(NamedTuple):
    """Lines of one block that begin with the same keyword.

    Attributes
    ----------
    numbers : (n,) array
        Their places in the file, from 1.
    words : (n,) array
        Words in each, the keyword left out.
    text : bytes
        The lines without their keyword.
    """

    numbers: NDArray[np.int64]
    words: NDArray[np.int64]
    text: bytes

    def part(self, start: int, end: int) -> KeywordLines:
        """Return some of the lines."""
        if (start, end) == (0, len(self.numbers)):
            return self
        places = np.flatnonzero(np.frombuffer(self.text, np.uint8) == ord("\n")) + 1
        bounds = np.concatenate([[0], places])
        text = self.text[int(bounds[start]) : int(bounds[end])]
        return KeywordLines(self.numbers[start:end], self.words[start:end], text)

    def singly(self) -> list[Line]:
        """Return each line with its place, without a comment at its end."""
        lines = self.text.split(b"\n")
        return [(int(number), line.partition(b"#")[0]) for number, line in zip(self.numbers, lines, strict=False)]


class Block:
    """Whole lines of a file.

    Parameters
    ----------
    content : bytes
        Ends with the end of a line.
    first : int
        Place of the first line in the file.
    """

    def __init__(self, content: bytes, first: int) -> None:
        while (
            b"\\\n" in content or b"\\\r\n" in content
        ):  # a line that goes on: the next one moves up, an empty one follows
            content = _CONTINUED.sub(rb" \1\n\n", content)
        if content[:1] in (b" ", b"\t") or b"\n " in content or b"\n\t" in content:
            content = _INDENT.sub(b"", content)
        self._octets = np.frombuffer(content, np.uint8)
        ends = np.flatnonzero(self._octets == ord("\n"))
        self._starts = np.concatenate([[0], ends[:-1] + 1])
        self._lengths = ends + 1 - self._starts
        self._first = first
        self._keywords = self._keyword_of_each()
        self.lines = len(ends)

    def _keyword_of_each(self) -> NDArray[np.int8]:
        """Return the place of each line's keyword in `KEYWORDS`, -1 for others."""
        padded = np.concatenate([self._octets, np.full(3, BLANK, np.uint8)])
        one, two, three = (padded[self._starts + place] for place in range(3))
        found = np.full(len(self._starts), -1, np.int8)
        found[(one == ord("v")) & (two <= BLANK)] = 0
        found[(one == ord("v")) & (two == ord("t")) & (three <= BLANK)] = 1
        found[(one == ord("v")) & (two == ord("n")) & (three <= BLANK)] = 2
        found[(one == ord("f")) & (two <= BLANK)] = 3
        return found

    def of(self, keyword: bytes) -> KeywordLines:
        """Return the lines of one of the `KEYWORDS`."""
        chosen = np.flatnonzero(self._keywords == KEYWORDS.index(keyword))
        if not len(chosen):
            return KeywordLines(chosen, chosen, b"")
        if len(chosen) == len(self._starts):
            octets = self._octets.copy()
            starts = self._starts
        else:
            inside = np.repeat(self._keywords == KEYWORDS.index(keyword), self._lengths)
            octets = self._octets[inside]
            starts = np.cumsum(self._lengths[chosen]) - self._lengths[chosen]
        for place in range(len(keyword)):
            octets[starts + place] = BLANK
        begins = np.flatnonzero(begins_word(octets))
        words = np.diff(np.searchsorted(begins, starts), append=len(begins))
        return KeywordLines(self._first + chosen, words, octets.tobytes())

    def before(self, keyword: bytes, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return how many lines of a keyword the block has before those of given places in the file."""
        total = np.cumsum(self._keywords == KEYWORDS.index(keyword))
        return np.asarray(total[numbers - self._first])

    def others(self) -> Iterator[tuple[int, bytes]]:
        """Yield all other lines that are not empty, with their places."""
        for index in np.flatnonzero((self._keywords < 0) & (self._lengths > 1)).tolist():
            start = int(self._starts[index])
            yield self._first + index, self._octets[start : start + int(self._lengths[index])].tobytes()


def begins_word(octets: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return for each byte whether a word begins there."""
    inside = octets > BLANK
    result = inside.copy()
    result[1:] &= ~inside[:-1]
    return result


def blocks(file: BinaryIO) -> Iterator[Block]:
    """Yield the whole of a file."""
    rest, first = b"", 1
    while True:
        piece = file.read(BLOCK_BYTES)
        content = rest + piece
        if piece:
            end = _last_end(content)
            content, rest = content[:end], content[end:]
        elif content and not content.endswith(b"\n"):
            content += b"\n"
        if content:
            block = Block(content, first)
            first += block.lines
            yield block
        if not piece:
            return


def _last_end(content: bytes) -> int:
    """Return the place after the last line that does not go on in the next one, 0 without one."""
    end = content.rfind(b"\n")
    while end >= 0 and content[max(0, end - 2) : end].rstrip(b"\r").endswith(b"\\"):
        end = content.rfind(b"\n", 0, end)
    return end + 1
