"""Rows of one element of a PLY file, binary or text."""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes.obj_lines import parsed
from rptcam_cl.assets.meshes.ply_header import Element, Property
from rptcam_cl.core.errors import InputError

Lists = list[tuple[NDArray[Any], NDArray[Any]]]


class Rows(NamedTuple):
    """Rows of one element.

    Attributes
    ----------
    values : dict
        Per property that is no list: an array (n,).
    lists : dict
        Per list property: for each length k that occurs, the numbers of the rows (m,) and their entries (m, k).
    """

    values: dict[str, NDArray[Any]]
    lists: dict[str, Lists]


def grouped(lengths: NDArray[Any], starts: NDArray[np.intp], entries: NDArray[Any]) -> Lists:
    """Return lists by their length.

    Parameters
    ----------
    lengths : (n,) int
        Length of each row's list.
    starts : (n,) int
        Place of each row's first entry.
    entries : (e,) array
        All entries.
    """
    found: Lists = []
    for length in np.unique(lengths):
        numbers = np.flatnonzero(lengths == length)
        found.append((numbers, entries[starts[numbers, None] + np.arange(length)]))
    return found


def joined(parts: list[Rows]) -> Rows:
    """Return the rows of several parts as one."""
    if len(parts) == 1:
        return parts[0]
    values = {name: np.concatenate([part.values[name] for part in parts]) for name in parts[0].values}
    lists: dict[str, Lists] = {}
    for name in parts[0].lists:
        by_length: dict[int, Lists] = {}
        for part in parts:
            for group in part.lists[name]:
                by_length.setdefault(group[1].shape[1], []).append(group)
        lists[name] = [
            (np.concatenate([numbers for numbers, _ in groups]), np.concatenate([entries for _, entries in groups]))
            for _, groups in sorted(by_length.items())
        ]
    return Rows(values, lists)


def read_binary(file: BinaryIO, element: Element, path: Path) -> Rows:
    """Return the rows of an element that a file is open at, and leave it after them."""
    start = file.tell()
    size = path.stat().st_size
    row = _row_like_the_first(file, element, size)
    file.seek(start)
    if row is not None and start + element.count * row.itemsize <= size:
        rows = np.fromfile(file, row, element.count)
        if all((rows[f"length of {item.name}"] == _length(row, item)).all() for item in _lists(element)):
            return _uniform(element, rows)
        file.seek(start)
    elif not element.has_lists:
        raise _cut_short(path, element.name, (size - start) // max(1, element.smallest_row(False)))
    return _varied(file, element, path)


def _lists(element: Element) -> list[Property]:
    return [item for item in element.properties if item.length is not None]


def _length(row: np.dtype[Any], item: Property) -> int:
    return int(row[item.name].shape[0])


def _cut_short(path: Path, name: str, number: int) -> InputError:
    return InputError(f"{path}: is cut short: ends inside {name} {number}")


def _row_like_the_first(file: BinaryIO, element: Element, size: int) -> np.dtype[Any] | None:
    """Return the layout of a row whose lists are as long as those of the first; None when the file does not hold it."""
    fields: list[tuple[Any, ...]] = []
    for item in element.properties:
        if item.length is None:
            fields.append((item.name, item.type))
            file.seek(item.type.itemsize, 1)
            continue
        head = file.read(item.length.itemsize)
        if not element.count or len(head) < item.length.itemsize:
            return None
        length = int(np.frombuffer(head, item.length)[0])
        if not 0 <= length * item.type.itemsize <= size:
            return None
        fields += [(f"length of {item.name}", item.length), (item.name, item.type, (length,))]
        file.seek(length * item.type.itemsize, 1)
    return np.dtype(fields)


def _uniform(element: Element, rows: NDArray[Any]) -> Rows:
    values = {item.name: rows[item.name] for item in element.properties if item.length is None}
    numbers = np.arange(len(rows))
    return Rows(values, {item.name: [(numbers, np.ascontiguousarray(rows[item.name]))] for item in _lists(element)})


def _varied(file: BinaryIO, element: Element, path: Path) -> Rows:
    """Return rows whose lists differ in length: one walk finds where each row's parts begin."""
    data = file.read()
    begun = {item.name: np.empty(element.count, np.int64) for item in element.properties}
    lengths = {item.name: np.empty(element.count, np.int64) for item in _lists(element)}
    place = 0
    for number in range(element.count):
        for item in element.properties:
            size = item.type.itemsize
            if item.length is not None:
                width = item.length.itemsize
                length = _whole(data[place : place + width], item.length)
                if length < 0:
                    raise InputError(f"{path}: {element.name} {number} has a list of {length} entries")
                lengths[item.name][number] = length
                place += width
                size *= length
            begun[item.name][number] = place
            place += size
        if place > len(data):
            raise _cut_short(path, element.name, number)
    file.seek(place - len(data), 1)
    values: dict[str, NDArray[Any]] = {}
    lists: dict[str, Lists] = {}
    octets = np.frombuffer(data, np.uint8)
    for item in element.properties:
        if item.length is None:
            spots = begun[item.name][:, None] + np.arange(item.type.itemsize)
            values[item.name] = octets[spots].view(item.type)[:, 0]
        else:
            by_length = grouped(lengths[item.name] * item.type.itemsize, begun[item.name], octets)
            lists[item.name] = [(numbers, _typed(entries, item)) for numbers, entries in by_length]
    return Rows(values, lists)


def _typed(entries: NDArray[np.uint8], item: Property) -> NDArray[Any]:
    if not entries.shape[1]:
        return np.empty(entries.shape, item.type)
    return np.ascontiguousarray(entries).view(item.type)


def _whole(octets: bytes, type_: np.dtype[Any]) -> int:
    return int.from_bytes(octets, "big" if type_.byteorder == ">" else "little", signed=type_.kind == "i")


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
        numbers = parsed(b" ".join(lines))
        try:
            if numbers is None:
                raise ValueError
            return _taken_apart(element, numbers, len(lines), first)
        except ValueError:
            raise self._wrong_row(lines, element) from None

    def _wrong_row(self, lines: list[bytes], element: Element) -> InputError:
        """Return the error for the first line that is wrong."""
        for number, line in enumerate(lines, start=self._line + 1):
            place = f"{self._path}:{number}"
            shown = line.decode("latin-1").strip()[:60]
            try:
                _taken_apart(element, np.array([float(word) for word in line.split()]), 1, 0)
            except ValueError:
                names = " ".join(_form(item) for item in element.properties)
                return InputError(f"{place}: is not a row of {element.name} (got {shown!r}; allowed: numbers {names})")
        return InputError(f"{self._path}:{self._line + 1}: holds rows of {element.name} that cannot be read")


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
            lists[item.name] = [(rows + first, _whole_of_text(group) if whole else group) for rows, group in groups]
    return Rows(values, lists)


def _whole_of_text(numbers: NDArray[np.float64]) -> NDArray[np.int64]:
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
