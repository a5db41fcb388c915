"""Constants of light and colour: each is written here and nowhere else."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear sRGB, ITU-R BT.709-6
LUMENS_PER_WATT = 683.0  # SI: the luminous efficacy of light of 540 THz
LINE_F_NM, LINE_D_NM, LINE_C_NM = 486.1327, 587.5618, 656.2725  # Fraunhofer lines of n_d and V_d


def colour_luminance(colour: ArrayLike) -> float:
    """Return the luminance of a linear colour."""
    return float(LUMINANCE @ np.asarray(colour, dtype=np.float64))
