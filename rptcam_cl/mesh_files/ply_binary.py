"""Rows of binary PLY files."""

from __future__ import annotations

from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.errors import InputError
from rptcam_cl.mesh_files.ply_header import Element, Property
from rptcam_cl.mesh_files.ply_rows import Lists, Rows, grouped


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
