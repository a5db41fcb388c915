"""Colours of other spaces, of chromaticities and of spectra as linear sRGB (ITU-R BT.709 primaries, white D65)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

D65 = (0.3127, 0.3290)
ACES_WHITE = (0.32168, 0.33767)
# Primaries and white as CIE x, y: BT.709, BT.2020, SMPTE RP 431-2 with D65 as pbrt has it, SMPTE ST 2065-1.
_PRIMARIES = {
    "srgb": ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), D65),
    "rec2020": ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), D65),
    "dci-p3": ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), D65),
    "aces2065-1": ((0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.077), ACES_WHITE),
}


def xyz_of(xy: ArrayLike) -> Array:
    """Return X, Y = 1, Z of a chromaticity."""
    x, y = np.asarray(xy, np.float64)
    return np.array([x / y, 1.0, (1 - x - y) / y])


def _xyz_from_rgb(space: str) -> Array:
    *primaries, white = _PRIMARIES[space]
    columns = np.stack([xyz_of(xy) if xy[1] else np.array([1.0, 0.0, 0.0]) for xy in primaries], axis=1)
    return np.asarray(columns * np.linalg.solve(columns, xyz_of(white)))


XYZ_FROM_SRGB = _xyz_from_rgb("srgb")
SRGB_FROM_XYZ = np.linalg.inv(XYZ_FROM_SRGB)


def srgb_from(space: str, rgb: ArrayLike) -> Array:
    """Return linear sRGB of the colour (…, 3) of a space; white stays white, as in the space's own light."""
    values = np.asarray(rgb, np.float64)
    if space == "srgb":
        return values
    matrix = SRGB_FROM_XYZ @ _xyz_from_rgb(space)
    # scaled per channel so that (1, 1, 1) stays so, also where the whites differ
    return np.asarray(values @ (matrix / (matrix @ np.ones(3))[:, None]).T)


def srgb_of_white(xy: ArrayLike) -> Array:
    """Return linear sRGB of a light of some chromaticity and of luminance 1."""
    return np.asarray(SRGB_FROM_XYZ @ xyz_of(xy))
