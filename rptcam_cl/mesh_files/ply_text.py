"""Rows of text PLY files."""

from __future__ import annotations

import warnings
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.errors import InputError
from rptcam_cl.mesh_files.ply_header import Element, Property
from rptcam_cl.mesh_files.ply_rows import Lists, Rows, grouped, joined

# Lines read together.
CHUNK_LINES = 1 << 15


class TextRows:
    """Reads the rows of one element after the other.

    Parameters
    ----------
    file : binary file
        Open at the first row.
    path : Path
    lines : int
        Lines of the header.
    """

    def __init__(self, file: BinaryIO, path: Path, lines: int) -> None:
        self._file = file
        self._path = path
        self._line = lines

    def read(self, element: Element) -> Rows:
        """Return the rows of the next element, one a line."""
        parts: list[Rows] = []
        done = 0
        while done < element.count or not parts:
            lines = list(islice(self._file, min(element.count - done, CHUNK_LINES)))
            if element.count and not lines:
                raise InputError(f"{self._path}: is cut short: ends after {done} rows of {element.name}")
            parts.append(self._rows(lines, element, done))
            done += len(lines)
            self._line += len(lines)
        return joined(parts)

    def _rows(self, lines: list[bytes], element: Element, first: int) -> Rows:
        """Return the rows of some lines, the first of which has a number, after checking that each line has its own."""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                numbers = np.fromstring(b" ".join(lines), np.float64, sep=" ")
            return _taken_apart(element, numbers, len(lines), first)
        except (ValueError, DeprecationWarning):
            self._refuse(lines, element)
            raise

    def _refuse(self, lines: list[bytes], element: Element) -> None:
        """Find the first line that is wrong, and say so."""
        for number, line in enumerate(lines, start=self._line + 1):
            place = f"{self._path}:{number}"
            shown = line.decode("latin-1").strip()[:60]
            try:
                _taken_apart(element, np.array([float(word) for word in line.split()]), 1, 0)
            except ValueError:
                names = " ".join(_form(item) for item in element.properties)
                raise InputError(
                    f"{place}: is not a row of {element.name} (got {shown!r}; allowed: numbers {names})"
                ) from None
        raise InputError(f"{self._path}:{self._line + 1}: holds rows of {element.name} that cannot be read")


def _form(item: Property) -> str:
    return item.name if item.length is None else f"COUNT {item.name}…"


def _taken_apart(element: Element, numbers: NDArray[np.float64], count: int, first: int) -> Rows:
    """Return rows, the first of which has a number; a ValueError when the numbers are not so many whole rows."""
    if not element.has_lists:
        table = numbers.reshape(count, len(element.properties))
        return Rows({item.name: table[:, place] for place, item in enumerate(element.properties)}, {})
    begun = _walk(element, numbers, count)
    values: dict[str, NDArray[Any]] = {}
    lists: dict[str, Lists] = {}
    for item in element.properties:
        places = np.array(begun[item.name], np.intp)
        if item.length is None:
            values[item.name] = numbers[places]
        else:
            whole = item.type.kind in "iu"
            groups = grouped(numbers[places].astype(np.int64), places + 1, numbers)
            lists[item.name] = [(rows + first, _whole(group) if whole else group) for rows, group in groups]
    return Rows(values, lists)


def _whole(numbers: NDArray[np.float64]) -> NDArray[np.int64]:
    if not (np.abs(numbers) < 2**53).all() or not (numbers == np.floor(numbers)).all():
        raise ValueError("not whole")
    return numbers.astype(np.int64)


def _walk(element: Element, numbers: NDArray[np.float64], count: int) -> dict[str, list[int]]:
    """Return, per property, where each row's part begins (for a list, its length)."""
    begun: dict[str, list[int]] = {item.name: [] for item in element.properties}
    parts = [(item.length is not None, begun[item.name].append) for item in element.properties]
    plain = numbers.tolist()
    place = 0
    for _ in range(count):
        for is_list, note in parts:
            note(place)
            if is_list and place < len(plain):
                length = plain[place]
                if not 0 <= length <= len(plain) or length != int(length):
                    raise ValueError("no length of a list")
                place += int(length)
            place += 1
    if place != len(plain):
        raise ValueError("not so many numbers")
    return begun
