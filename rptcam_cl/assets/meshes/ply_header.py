"""The header of a PLY file (Turk 1994): which elements follow, how many, and how their rows are laid out."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO, Literal

import numpy as np

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError

MOST_HEADER_BYTES = 1 << 16
MOST_ROWS = 2**31 - 1

TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
FORMATS: dict[str, Literal["", "<", ">"]] = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True)
class Property:
    """One value of a row, or a list of values with its length before it.

    Attributes
    ----------
    name : str
    type : numpy dtype
        Of the value or of each entry of the list.
    length : numpy dtype or None
        Of the length; None when it is no list.
    """

    name: str
    type: np.dtype[np.generic]
    length: np.dtype[np.generic] | None = None


@dataclass(frozen=True)
class Element:
    """Rows of one kind."""

    name: str
    count: int
    properties: tuple[Property, ...]

    @property
    def has_lists(self) -> bool:
        """Whether rows differ in size."""
        return any(item.length is not None for item in self.properties)

    def smallest_row(self, text: bool) -> int:
        """Return the bytes of a row whose lists are empty; in text a digit and a space for each value."""
        if text:
            return 2 * max(1, len(self.properties))
        return sum((item.length or item.type).itemsize for item in self.properties)


@dataclass(frozen=True)
class Header:
    """What a PLY file holds; `order` is the byte order as numpy writes it, empty for text."""

    order: Literal["", "<", ">"]
    elements: tuple[Element, ...]
    lines: int


def read_header(file: BinaryIO, path: Path) -> Header:
    """Return the header of a file that is open at its start, and leave it at the first row."""
    lines = _lines(file, path)
    if lines[0].strip() != "ply":
        raise InputError(f"{path}: is not a PLY file (allowed: a first line 'ply')")
    order: Literal["", "<", ">"] | None = None
    elements: list[Element] = []
    for number, line in enumerate(lines[1:-1], start=2):
        place = f"{path}:{number}"
        words = line.split()
        match words:
            case [] | ["comment" | "obj_info", *_]:
                continue
            case ["format", name, "1.0"] if name in FORMATS:
                order = FORMATS[name]
            case ["element", name, count] if count.isascii() and count.isdigit() and len(count) < 20:
                elements.append(Element(name, int(count), ()))
            case ["property", *form] if elements:
                last = elements[-1]
                elements[-1] = Element(last.name, last.count, (*last.properties, _property(form, order or "<", place)))
            case _:
                raise InputError(f"{place}: is not a line of a PLY header (got {line.strip()[:60]!r})")
    if order is None:
        raise InputError(f"{path}: has no line 'format' in its header (allowed: {', '.join(FORMATS)})")
    for element in elements:
        names = [item.name for item in element.properties]
        if len(set(names)) < len(names) or [other.name for other in elements].count(element.name) > 1:
            raise InputError(f"{path}: names element {element.name}, or one of its properties, twice")
        if element.count > MOST_ROWS:
            raise InputError(
                f"{path}: claims {element.count} rows of {element.name} (allowed: at most {MOST_ROWS}, and no "
                "more than the file has bytes for)"
            )
    return Header(order, tuple(elements), len(lines))


def _lines(file: BinaryIO, path: Path) -> list[str]:
    lines: list[str] = []
    size = 0
    while size < MOST_HEADER_BYTES:
        line = file.readline(MOST_HEADER_BYTES - size)
        size += len(line)
        lines.append(line.decode("latin-1"))
        if not line or (len(lines) == 1 and line.strip() != b"ply"):
            break
        if line.strip() == b"end_header":
            return lines
    raise InputError(f"{path}: is not a PLY file (allowed: a header from 'ply' to 'end_header')")


def _property(form: list[str], order: str, place: str) -> Property:
    match form:
        case [type_name, name] if type_name in TYPES:
            return Property(name, np.dtype(order + TYPES[type_name]))
        case ["list", length, type_name, name] if TYPES.get(length, "f")[0] in "iu" and type_name in TYPES:
            return Property(name, np.dtype(order + TYPES[type_name]), np.dtype(order + TYPES[length]))
    got, types = " ".join(form)[:60], ", ".join(TYPES)
    raise InputError(f"{place}: is not a property (got {got!r}; allowed: [list LENGTH] TYPE NAME, of {types})")
