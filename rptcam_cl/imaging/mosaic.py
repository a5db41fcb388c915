"""Colour filter mosaics: which pixel sees which colour, and the colours that are missing."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError

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


Array = NDArray[np.float64]

# H. Malvar, L. He and R. Cutler, "High-quality linear interpolation for demosaicing of Bayer-patterned color images",
# ICASSP 2004, figure 2: eighths of the pixels round the one whose colour is missing.
_GREEN = np.array([[0, 0, -1, 0, 0], [0, 0, 2, 0, 0], [-1, 2, 4, 2, -1], [0, 0, 2, 0, 0], [0, 0, -1, 0, 0]]) / 8
_ALONG_ROW = np.array(
    [[0, 0, 0.5, 0, 0], [0, -1, 0, -1, 0], [-1, 4, 5, 4, -1], [0, -1, 0, -1, 0], [0, 0, 0.5, 0, 0]]
) / 8  # fmt: skip
_ACROSS = np.array(
    [[0, 0, -1.5, 0, 0], [0, 2, 0, 2, 0], [-1.5, 0, 6, 0, -1.5], [0, 2, 0, 2, 0], [0, 0, -1.5, 0, 0]]
) / 8  # fmt: skip

# Means of the nearest pixels that have the colour.
_NEAREST_GREEN = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]]) / 4
_NEAREST_IN_ROW = np.array([[0, 0, 0], [1, 0, 1], [0, 0, 0]]) / 2
_NEAREST_DIAGONAL = np.array([[1, 0, 1], [0, 0, 0], [1, 0, 1]]) / 4

KERNELS = {"malvar": (_GREEN, _ALONG_ROW, _ACROSS), "bilinear": (_NEAREST_GREEN, _NEAREST_IN_ROW, _NEAREST_DIAGONAL)}


def _filtered(values: Array, kernel: Array) -> Array:
    """Return the sum of the pixels round each, weighted; values go on mirrored, which keeps the mosaic in step."""
    reach = kernel.shape[0] // 2
    height, width = values.shape
    wide = np.pad(values, reach, mode="reflect")
    total = np.zeros_like(values)
    for (row, column), weight in np.ndenumerate(kernel):
        if weight:
            total += weight * wide[row : row + height, column : column + width]
    return total


def demosaiced(values: NDArray[np.floating], pattern: str, method: str = "malvar") -> Array:
    """Return all three colours of every pixel (height, width, 3).

    Parameters
    ----------
    values : (height, width) array
        What the pixels saw, white balanced; at least 2 x 2.
    pattern : str
        Colours of the upper left 2 x 2 pixels by rows, as ``RGGB``.
    method : str
        ``malvar`` (gradient-corrected, Malvar 2004) or ``bilinear``.
    """
    seen = np.asarray(values, np.float64)
    green, along, across = KERNELS[method]
    filtered = {"green": _filtered(seen, green), "row": _filtered(seen, along)}
    filtered |= {"column": _filtered(seen, along.T), "across": _filtered(seen, across)}
    colours = np.empty((*seen.shape, 3))
    found = list(places(pattern))
    for place, (channel, index) in enumerate(found):
        beside = found[place ^ 1][0]  # the other colour of the row
        for wanted in range(3):
            if wanted == channel:
                source = seen
            elif wanted == 1:
                source = filtered["green"]
            elif channel == 1:
                source = filtered["row" if wanted == beside else "column"]
            else:
                source = filtered["across"]
            colours[(*index, wanted)] = source[index]
    return colours
