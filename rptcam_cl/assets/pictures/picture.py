"""A picture that was read: texels in rows from the top, as stored or as linear floats."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError

LARGEST_PIXELS = 1 << 26  # 64 million: an equirectangular picture of 8192 x 8192, or 256 MB in 8 bits
SLIGHTLY_NEGATIVE = -1e-3  # what resampling leaves beside bright edges; taken as zero


@dataclass(frozen=True)
class Negative:
    """How many texels had a clearly negative channel, and the least value."""

    count: int
    least: float


NO_NEGATIVE = Negative(0, 0.0)


@dataclass(frozen=True, eq=False)
class Picture:
    """Texels of a picture.

    Attributes
    ----------
    texels : (height, width, 4) array
        Red, green, blue, alpha, top row first: uint8 as stored (0 to 255), or float32 from 0 up.
    has_alpha : bool
        Whether the file has an alpha channel; otherwise alpha is opaque.
    encoded : bool
        Whether a file of this kind normally holds sRGB-encoded colours and not linear ones.
    negative : Negative
        Texels below zero in the file, which are black here.
    """

    texels: NDArray[np.uint8] | NDArray[np.float32]
    has_alpha: bool
    encoded: bool
    negative: Negative = NO_NEGATIVE

    @property
    def height(self) -> int:
        """Number of rows."""
        return int(self.texels.shape[0])

    @property
    def width(self) -> int:
        """Number of columns."""
        return int(self.texels.shape[1])


def check_size(width: int, height: int) -> None:
    """Refuse a size before anything of that size is allocated.

    Raises
    ------
    InputError
        When a side is empty, or there are more than `LARGEST_PIXELS` pixels.
    """
    if width < 1 or height < 1:
        raise InputError(f"has no pixels (got {width} x {height})")
    if width * height > LARGEST_PIXELS:
        raise InputError(f"is too large (got {width} x {height} pixels; allowed: at most {LARGEST_PIXELS})")


def checked_floats(texels: NDArray[np.float32]) -> tuple[NDArray[np.float32], Negative]:
    """Return texels (height, width, channels) with negative ones made zero, and how many were clearly negative.

    Raises
    ------
    InputError
        When some are not finite: how many, and where the first is.
    """
    wrong = ~np.isfinite(texels)
    if wrong.any():
        row, column, _ = np.argwhere(wrong)[0]
        raise InputError(
            f"{int(wrong.any(axis=2).sum())} pixels are not finite, the first in column {column} of row {row}"
            f" (got {', '.join(f'{value:g}' for value in texels[row, column])}; allowed: finite numbers)"
        )
    least = float(texels.min(initial=0.0))
    below = int((texels < SLIGHTLY_NEGATIVE).any(axis=2).sum()) if least < SLIGHTLY_NEGATIVE else 0
    return np.maximum(texels, np.float32(0)), Negative(below, least) if below else NO_NEGATIVE
