"""Square markers: the bits of OpenCV's predefined dictionaries."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError

SIZES = (50, 100, 250, 1000)
APRILTAG = "DICT_APRILTAG_36h11"
APRILTAGS = 587
# Name of each dictionary, with the row of the table that begins with it and how many markers it has.
DICTIONARIES: dict[str, tuple[str, int]] = {
    f"DICT_{side}X{side}_{count}": (f"{side}X{side}", count) for side in (4, 5, 6, 7) for count in SIZES
} | {APRILTAG: ("APRILTAG_36h11", APRILTAGS)}


@cache
def _table() -> dict[str, str]:
    found: dict[str, str] = json.loads(files(__package__).joinpath("dictionaries.json").read_text("utf-8"))
    return found


def marker_bits(dictionary: str, number: int) -> NDArray[np.bool_]:
    """Return which cells (side, side) of a marker are light, rows from the top, without its dark border.

    Raises
    ------
    InputError
        When there is no such dictionary or marker.
    """
    if dictionary not in DICTIONARIES:
        raise InputError(f"dictionary: is not known (got {dictionary}; allowed: {', '.join(DICTIONARIES)})")
    row, count = DICTIONARIES[dictionary]
    if not 0 <= number < count:
        raise InputError(f"{dictionary}: has no marker {number} (allowed: 0 to {count - 1})")
    side = 6 if row == "APRILTAG_36h11" else int(row[0])
    digits = -(-side * side // 4)
    value = int(_table()[row][digits * number : digits * (number + 1)], 16)
    return np.array([value >> bit & 1 for bit in range(side * side - 1, -1, -1)], np.bool_).reshape(side, side)
