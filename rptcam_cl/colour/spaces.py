"""Linear sRGB and CIE XYZ, and what adapting from one white to another does to colours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour.constants import LUMINANCE

Matrix = NDArray[np.float64]
Chromaticity = tuple[float, float]

SRGB_PRIMARIES: tuple[Chromaticity, ...] = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06))  # ITU-R BT.709-6
SRGB_WHITE: Chromaticity = (0.3127, 0.3290)  # D65 as IEC 61966-2-1 rounds it
_LUMINANCE_32 = LUMINANCE.astype(np.float32)

# Cone-like responses of the Bradford transform (K. M. Lam, dissertation, Bradford 1985), in its linear form as in
# ISO 15076-1 (ICC profiles), annex E.
BRADFORD: Matrix = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


def xyz_of(chromaticity: Chromaticity) -> NDArray[np.float64]:
    """Return the tristimulus values X, Y, Z of luminance 1."""
    x, y = chromaticity
    return np.array([x / y, 1.0, (1.0 - x - y) / y])


def _xyz_from_rgb() -> Matrix:
    """Return the matrix whose columns are the primaries, scaled so that their sum is the white (SMPTE RP 177)."""
    columns = np.array([xyz_of(primary) for primary in SRGB_PRIMARIES]).T
    return columns * np.linalg.solve(columns, xyz_of(SRGB_WHITE))


XYZ_FROM_RGB = _xyz_from_rgb()
RGB_FROM_XYZ: Matrix = np.asarray(np.linalg.inv(XYZ_FROM_RGB))


def adaptation(source: NDArray[np.float64], target: NDArray[np.float64]) -> Matrix:
    """Return the Bradford matrix that turns XYZ seen under a white into XYZ seen under another.

    Parameters
    ----------
    source, target
        XYZ of the two whites; their Bradford responses are above 0.
    """
    responses = BRADFORD @ target / (BRADFORD @ source)
    return np.linalg.inv(BRADFORD) @ (responses[:, None] * BRADFORD)


def pixel_luminance(linear: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the luminance (…, 1) of linear colours (…, 3)."""
    brightness: NDArray[np.float32] = (linear @ _LUMINANCE_32)[..., None]
    return brightness
