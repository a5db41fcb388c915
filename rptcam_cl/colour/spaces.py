"""CIE XYZ and linear sRGB: of spectra, of one another, and under another white; and the luminance of colours.

Amounts: a spectrum holds radiance [W/(m² sr nm)], or intensity or irradiance per nm. Y = 1 is what light of 555 nm and
1 W/(m² sr) gives, 683 cd/m², and the luminance of the colour (1, 1, 1).

The standard rounds the white point to four digits. Spectra have that of the tables, (0.31274, 0.32905), so that D65 is
exactly (1, 1, 1); what is done to finished pictures goes by the standard.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from rptcam_cl.colour.illuminants import daylight_65
from rptcam_cl.colour.spectrum import cie_1931

Array = NDArray[np.float64]
Matrix = NDArray[np.float64]
Chromaticity = tuple[float, float]

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear sRGB, ITU-R BT.709-6
SRGB_PRIMARIES: tuple[Chromaticity, ...] = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06))  # ITU-R BT.709-6
SRGB_WHITE: Chromaticity = (0.3127, 0.3290)  # D65 as IEC 61966-2-1 rounds it

# Cone-like responses of the Bradford transform (K. M. Lam, dissertation, Bradford 1985), in its linear form as in
# ISO 15076-1 (ICC profiles), annex E.
BRADFORD: Matrix = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


def xyz_of(chromaticity: Chromaticity) -> Array:
    """Return the tristimulus values X, Y, Z of luminance 1."""
    x, y = chromaticity
    return np.array([x / y, 1.0, (1.0 - x - y) / y])


def _xyz_from_rgb(white: Array) -> Matrix:
    """Return the matrix whose columns are the primaries, scaled so that their sum is the white (SMPTE RP 177)."""
    columns = np.array([xyz_of(primary) for primary in SRGB_PRIMARIES]).T
    return np.asarray(columns * np.linalg.solve(columns, white))


XYZ_FROM_RGB = _xyz_from_rgb(xyz_of(SRGB_WHITE))
RGB_FROM_XYZ: Matrix = np.asarray(np.linalg.inv(XYZ_FROM_RGB))


@cache
def srgb_from_xyz() -> Matrix:
    """Return the matrix (3, 3) from X, Y, Z to linear sRGB; D65 of luminance 1 becomes exactly (1, 1, 1)."""
    return np.asarray(np.linalg.inv(_xyz_from_rgb(xyz_from_spectrum(daylight_65()))))


def xyz_from_spectrum(spectrum: ArrayLike) -> Array:
    """Return X, Y, Z (..., 3) of spectra (..., 401)."""
    return np.asarray(np.asarray(spectrum, np.float64) @ cie_1931())


def srgb_from_spectrum(spectrum: ArrayLike) -> Array:
    """Return linear sRGB (..., 3) of the spectra of lights (..., 401), negative where they lie outside its gamut."""
    return np.asarray(xyz_from_spectrum(spectrum) @ srgb_from_xyz().T)


def srgb_from_reflectance(reflectance: ArrayLike) -> Array:
    """Return linear sRGB (..., 3) of reflectance spectra (..., 401) under D65; 1 everywhere is (1, 1, 1)."""
    return srgb_from_spectrum(np.asarray(reflectance, np.float64) * daylight_65())


def within_srgb(srgb: ArrayLike) -> Array:
    """Return linear sRGB colours (..., 3) without negative channels: those become 0, the luminance stays."""
    given = np.asarray(srgb, np.float64)
    kept = np.maximum(given, 0.0)
    bright = exact_luminance(kept)
    factor = np.where(bright > 0, np.maximum(exact_luminance(given), 0.0) / np.where(bright > 0, bright, 1.0), 0.0)
    return np.asarray(kept * factor[..., None])


def exact_luminance(srgb: ArrayLike) -> Array:
    """Return the luminance Y (...) of linear sRGB colours (..., 3) by the tables, as `srgb_from_xyz` has it."""
    return np.asarray(np.asarray(srgb, np.float64) @ np.linalg.inv(srgb_from_xyz())[1])


def luminance(colours: ArrayLike, dtype: DTypeLike = np.float64) -> Any:
    """Return the luminance (...) of linear sRGB colours (..., 3) by the standard, computed in a given precision.

    It is a sum and no product of matrices: those of a large film wake the threads of numpy's linear algebra, which then
    wait for more with the processor on, while a device on that processor goes on with the picture.
    """
    red, green, blue = np.moveaxis(np.asarray(colours, dtype), -1, 0)
    of_red, of_green, of_blue = LUMINANCE.astype(dtype)
    return of_red * red + of_green * green + of_blue * blue


def adaptation(source: Array, target: Array) -> Matrix:
    """Return the Bradford matrix that turns XYZ seen under a white into XYZ seen under another.

    Parameters
    ----------
    source, target
        XYZ of the two whites; their Bradford responses are above 0.
    """
    responses = BRADFORD @ target / (BRADFORD @ source)
    return np.linalg.inv(BRADFORD) @ (responses[:, None] * BRADFORD)
