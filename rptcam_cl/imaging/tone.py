"""From linear film values to the 8-bit picture that a screen shows."""

import numpy as np
from numpy.typing import NDArray


def srgb_from_linear(linear: NDArray[np.floating]) -> NDArray[np.float32]:
    """sRGB-encoded values of linear ones, both in 0..1 (IEC 61966-2-1).

    Values outside 0..1 are clipped; not-a-number becomes 0.
    """
    clipped: NDArray[np.float32] = np.clip(np.nan_to_num(linear, nan=0.0), 0.0, 1.0).astype(np.float32, copy=False)
    foot = clipped * np.float32(12.92)
    curve = np.float32(1.055) * clipped ** np.float32(1 / 2.4) - np.float32(0.055)
    return np.where(clipped <= np.float32(0.0031308), foot, curve)


def tone_mapped(pixels: NDArray[np.floating], ev: float = 0.0) -> NDArray[np.uint8]:
    """8-bit sRGB picture of linear film values.

    Parameters
    ----------
    pixels
        Linear values; 1 is the white of the screen at ``ev`` 0.
    ev
        Exposure compensation [stops]; +1 doubles the values.
    """
    with np.errstate(over="ignore"):  # beyond float32 is white all the same
        exposed = np.asarray(pixels, np.float32) * np.float32(2.0**ev)
    nearest = srgb_from_linear(exposed) * np.float32(255.0) + np.float32(0.5)
    return nearest.astype(np.uint8)
