"""Text of a pbrt file, and places in it."""

from __future__ import annotations

import gzip
import zlib
from bisect import bisect_right
from dataclasses import field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, StateError

# What one file may hold, unpacked: far more than the largest published scenes have in one text file.
MAX_BYTES = 1 << 30

LONGEST_MESSAGE = 1000


@dataclass(frozen=True, eq=False)
class Source:
    """The text of one file.

    Attributes
    ----------
    name : str
        File name for messages.
    text : str
    path : Path
        Where it was read from.
    """

    name: str
    text: str = field(repr=False)
    path: Path

    @cached_property
    def _line_starts(self) -> list[int]:
        if self.text.isascii():
            characters: NDArray[Any] = np.frombuffer(self.text.encode("ascii"), np.uint8)
        else:
            characters = np.frombuffer(self.text.encode("utf-32-le"), np.uint32)
        ends = np.flatnonzero(characters == ord("\n"))
        return [0, *(ends + 1).tolist()]

    def line_and_column(self, offset: int) -> tuple[int, int]:
        """Return line and column, from 1, of a character."""
        line = bisect_right(self._line_starts, offset)
        return line, offset - self._line_starts[line - 1] + 1


@dataclass(frozen=True)
class Place:
    """A character of a file."""

    source: Source
    offset: int

    @property
    def line_number(self) -> int:
        """Line, from 1."""
        return self.source.line_and_column(self.offset)[0]

    @property
    def line(self) -> str:
        """``FILE:LINE``."""
        return f"{self.source.name}:{self.line_number}"

    def error(self, problem: str) -> InputError:
        """Return the error of this place: ``FILE:LINE:COL: problem``."""
        line, column = self.source.line_and_column(self.offset)
        return InputError(f"{self.source.name}:{line}:{column}: {one_line(problem)}")


def one_line(message: str) -> str:
    """Return a message fit for one line of a terminal: names of a file may hold anything."""
    shown = message if len(message) <= LONGEST_MESSAGE else message[:LONGEST_MESSAGE] + "…"
    return "".join(mark if mark.isprintable() else f"\\x{ord(mark):02x}" for mark in shown)


def read_source(path: Path, name: str) -> Source:
    """Return the text of a pbrt file; one that ends in .gz is unpacked.

    Raises
    ------
    InputError
        When it is missing, not a regular file, too large or no text.
    StateError
        When it cannot be read.
    """
    raw = read_limited(path, name, MAX_BYTES)
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputError(f"{name}:1:1: is UTF-16 text; save it as UTF-8")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")  # comments of old exporters; names of files stay what the bytes say
    if (index := text.find("\0")) >= 0:
        raise Place(Source(name, text, path), index).error("contains a NUL byte; this is not a text file")
    return Source(name, text.replace("\r\n", "\n").replace("\r", "\n"), path)


def read_limited(path: Path, name: str, limit: int) -> bytes:
    """Return the content of a regular file of at most ``limit`` bytes; a .gz file is unpacked, to no more than that."""
    try:
        if not path.is_file():
            raise InputError(f"{name}: {'is not a regular file' if path.exists() else 'no such file'} (got {path})")
        with gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb") as file:
            raw = file.read(limit + 1)
    except (zlib.error, EOFError, gzip.BadGzipFile) as problem:
        raise InputError(f"{name}: is not a whole gzip file ({problem})") from None
    except OSError as problem:
        raise StateError(one_line(f"{name}: cannot be read ({problem.strerror})")) from None
    except ValueError as problem:  # a NUL byte in the name
        raise InputError(f"{name!r}: is not a usable path ({problem})") from None
    if len(raw) > limit:
        raise InputError(f"{name}: holds more than {limit} bytes")
    return raw
