"""Zones from a text file, in the form of the CS348b assignment of 2015: four columns, left, right, top and bottom."""

from __future__ import annotations

import math
import re
from pathlib import Path

from rptcam_cl.errors import InputError, StateError
from rptcam_cl.scene.autofocus import ZoneFractions

LARGEST = 1 << 20  # bytes
MOST_ZONES = 1000
COLUMNS = 4
_WORD = re.compile("[A-Za-z_]+")


def read_zones(source: Path | bytes, name: str) -> tuple[ZoneFractions, ...]:
    """Return the zones of a file.

    A line holds xleft, xright, ytop and ybottom as fractions of the picture from its top left corner, separated by
    blanks, tabs or commas. What follows a # is a comment; empty lines and a heading of four words are left out.

    Parameters
    ----------
    source
        The file, or its content.
    name
        What errors call it.

    Raises
    ------
    InputError
        ``NAME:LINE: ...`` when a line is not a zone, or there is none.
    StateError
        When the file cannot be read.
    """
    try:
        data = source if isinstance(source, bytes) else _start_of(source)
    except OSError as problem:
        raise StateError(f"{name}: cannot be read ({problem.strerror})") from None
    try:
        text = data[:LARGEST].decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{name}: is not a text file (allowed: lines of xleft xright ytop ybottom)") from None
    zones: list[ZoneFractions] = []
    heading = False
    for number, line in enumerate(text.splitlines(), start=1):
        words = re.split(r"[\s,;]+", line.partition("#")[0].strip(" \t,;"))
        if words == [""]:
            continue
        if not (zones or heading) and len(words) == COLUMNS and all(map(_WORD.fullmatch, words)):
            heading = True
            continue
        zones.append(_zone(words, f"{name}:{number}"))
    if not zones:
        raise InputError(f"{name}: holds no zones (allowed: a line each of xleft xright ytop ybottom)")
    if len(zones) > MOST_ZONES or len(data) > LARGEST:
        raise InputError(f"{name}: is too long (allowed: up to {MOST_ZONES} zones)")
    return tuple(zones)


def _start_of(file: Path) -> bytes:
    """Return as much of a file as may be read, and a byte more where it is longer."""
    with file.open("rb") as stream:
        return stream.read(LARGEST + 1)


def _zone(words: list[str], place: str) -> ZoneFractions:
    try:
        left, right, top, bottom = (float(word) for word in words)
    except ValueError:
        raise InputError(
            f"{place}: is not a zone (got {' '.join(words)[:80]}; allowed: four numbers xleft xright ytop ybottom)"
        ) from None
    if not (0 <= left < right <= 1 and 0 <= top < bottom <= 1 and math.isfinite(left + right + top + bottom)):
        raise InputError(
            f"{place}: is not inside the picture (got {' '.join(words)};"
            " allowed: 0 <= xleft < xright <= 1 and 0 <= ytop < ybottom <= 1)"
        )
    return left, right, top, bottom
