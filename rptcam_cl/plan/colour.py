"""How bright a colour is."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # Rec. 709


def luminance(colour: ArrayLike) -> float:
    """Return the luminance of a linear colour."""
    return float(LUMINANCE @ np.asarray(colour, dtype=np.float64))
