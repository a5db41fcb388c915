"""Colour filter mosaics: which pixel sees which colour."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.errors import InputError

CHANNELS = {"R": 0, "G": 1, "B": 2}


def is_mosaic(pattern: str) -> bool:
    """Return whether a pattern is one of colours, as RGGB, and not ``none`` or ``monochrome``."""
    return set(pattern) <= CHANNELS.keys()


def check_size(bayer: str, width: int, height: int) -> None:
    """Raise an error when a picture is too small for a mosaic.

    Raises
    ------
    InputError
        It says what would be large enough.
    """
    if is_mosaic(bayer) and min(width, height) < 2:
        raise InputError(
            f"sensor.bayer: a mosaic needs more pixels (got {width} x {height};"
            " allowed: at least 2 x 2, or bayer: none)"
        )


def places(pattern: str) -> Iterator[tuple[int, tuple[slice, slice]]]:
    """Yield the channel of each of the 2 x 2 places of a pattern, and the index of its pixels."""
    for place, colour in enumerate(pattern):
        yield CHANNELS[colour], (slice(place // 2, None, 2), slice(place % 2, None, 2))


def mosaic(values: NDArray[Any], pattern: str) -> NDArray[Any]:
    """Return what the pixels behind a mosaic see (height, width) of values (height, width, 3)."""
    seen = np.empty(values.shape[:2], values.dtype)
    for channel, index in places(pattern):
        seen[index] = values[(*index, channel)]
    return seen
