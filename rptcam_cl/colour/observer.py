"""What the eye makes of a spectrum: the CIE 1931 observer, and linear sRGB.

Amounts: a spectrum holds radiance [W/(m² sr nm)], or intensity or irradiance per nm. Y = 1 is what light of 555 nm and
1 W/(m² sr) gives, 683 cd/m², and the luminance of the colour (1, 1, 1).
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.colour.spectrum import Spectrum, columns, table

Array = NDArray[np.float64]

# Chromaticities x, y of the primaries of sRGB (IEC 61966-2-1; those of Rec. 709).
PRIMARIES = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06))


def cie_1931() -> Array:
    """Return the colour matching functions x, y, z of the CIE 1931 observer (401, 3); sums over 1 nm give X, Y, Z."""
    return table("cie_1931")


@cache
def daylight_65() -> Spectrum:
    """Return illuminant D65 of luminance 1 (401,) [1/nm]."""
    spectrum = columns("illuminants")["D65"]
    return np.asarray(spectrum / (cie_1931()[:, 1] @ spectrum))


@cache
def srgb_from_xyz() -> Array:
    """Return the matrix (3, 3) from X, Y, Z to linear sRGB; D65 of luminance 1 becomes exactly (1, 1, 1).

    The standard rounds the white point to four digits; here it is that of the tables, (0.31274, 0.32905).
    """
    primaries = np.array([(x / y, 1.0, (1 - x - y) / y) for x, y in PRIMARIES]).T
    white = xyz_from_spectrum(daylight_65())
    return np.asarray(np.linalg.inv(primaries * np.linalg.solve(primaries, white)))


def xyz_from_spectrum(spectrum: ArrayLike) -> Array:
    """Return X, Y, Z (..., 3) of spectra (..., 401)."""
    return np.asarray(np.asarray(spectrum, np.float64) @ cie_1931())


def srgb_from_spectrum(spectrum: ArrayLike) -> Array:
    """Return linear sRGB (..., 3) of the spectra of lights (..., 401), negative where they lie outside its gamut."""
    return np.asarray(xyz_from_spectrum(spectrum) @ srgb_from_xyz().T)


def srgb_from_reflectance(reflectance: ArrayLike) -> Array:
    """Return linear sRGB (..., 3) of reflectance spectra (..., 401) under D65; 1 everywhere is (1, 1, 1)."""
    return srgb_from_spectrum(np.asarray(reflectance, np.float64) * daylight_65())


def luminance(srgb: ArrayLike) -> Array:
    """Return the luminance Y of linear sRGB colours (..., 3)."""
    return np.asarray(np.asarray(srgb, np.float64) @ np.linalg.inv(srgb_from_xyz())[1])


def within_srgb(srgb: ArrayLike) -> Array:
    """Return linear sRGB colours (..., 3) without negative channels: those become 0, the luminance stays."""
    given = np.asarray(srgb, np.float64)
    kept = np.maximum(given, 0.0)
    bright = luminance(kept)
    factor = np.where(bright > 0, np.maximum(luminance(given), 0.0) / np.where(bright > 0, bright, 1.0), 0.0)
    return np.asarray(kept * factor[..., None])
