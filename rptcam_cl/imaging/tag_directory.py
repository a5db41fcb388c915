"""Directories of tagged values, as TIFF files and EXIF data hold them (TIFF revision 6.0, section 2)."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import NamedTuple

HEADER = b"II*\0" + struct.pack("<I", 8)  # the first directory follows at once
_ASCII, _SHORT, _LONG, _RATIONAL, _UNDEFINED = 2, 3, 4, 5, 7
_LARGEST = 2**32 - 1


class TagField(NamedTuple):
    """A value: its type in TIFF, the number of items, and their bytes."""

    kind: int
    number: int
    data: bytes


Directory = Mapping[int, "TagField | Directory"]


def ascii_text(text: str) -> TagField:
    """Return text, which beyond ASCII is UTF-8 (Metadata Working Group, guidelines 2.0)."""
    data = text.replace("\0", " ").encode() + b"\0"
    return TagField(_ASCII, len(data), data)


def short(*values: int) -> TagField:
    """Return integers of 16 bits."""
    return TagField(_SHORT, len(values), struct.pack(f"<{len(values)}H", *values))


def long(values: Sequence[int]) -> TagField:
    """Return integers of 32 bits."""
    return TagField(_LONG, len(values), struct.pack(f"<{len(values)}I", *values))


def rational(value: float) -> TagField:
    """Return a fraction near a number above 0; infinity has the largest numerator, as EXIF says of distances."""
    return TagField(_RATIONAL, 1, struct.pack("<2I", *_fraction(value)))


def undefined(data: bytes) -> TagField:
    """Return bytes whose meaning follows from the tag alone."""
    return TagField(_UNDEFINED, len(data), data)


def directory_bytes(fields: Directory, offset: int) -> bytes:
    """Return a directory, and those inside it, as they are stored from an offset in the file on."""
    entries, beyond = [], b""
    after = offset + 2 + 12 * len(fields) + 4
    for tag, field in sorted(fields.items()):
        place = after + len(beyond)
        if not isinstance(field, TagField):
            beyond += directory_bytes(field, place)
            field = long([place])
        value = field.data
        if len(value) > 4:
            beyond += value + b"\0" * (len(value) % 2)
            value = struct.pack("<I", place)
        entries.append(struct.pack("<HHI4s", tag, field.kind, field.number, value))
    return struct.pack("<H", len(entries)) + b"".join(entries) + struct.pack("<I", 0) + beyond


def _fraction(value: float) -> tuple[int, int]:
    if value >= _LARGEST or math.isinf(value):
        return _LARGEST, 1
    if value < 1:
        upper, lower = _fraction(min(1 / value, _LARGEST - 1.0))
        return lower, upper
    near = Fraction(value).limit_denominator(max(1, min(1_000_000, int(_LARGEST / value) - 1)))
    return near.numerator, near.denominator
