"""Spectra for colours: the basis of Mallett and Yuksel 2019.

I. Mallett and C. Yuksel, "Spectral Primary Decomposition for Rendering with sRGB Reflectance", EGSR 2019. The table is
solved by `benchmarks/rgb_basis.py`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.spectra.tables import table


def rgb_basis() -> NDArray[np.float64]:
    """Return the reflectance spectra of linear sRGB's red, green and blue (401, 3).

    They are not negative, sum to 1 at every wavelength, and give back their colour under D65; so do all mixtures. The
    reflectance of a colour c is ``rgb_basis() @ c``; light of colour c has that times D65 of luminance 1.
    """
    return table("rgb_basis")


def reflectance_from_srgb(srgb: ArrayLike) -> NDArray[np.float64]:
    """Return reflectance spectra (..., 401) of linear sRGB colours (..., 3)."""
    return np.asarray(np.asarray(srgb, np.float64) @ rgb_basis().T)
