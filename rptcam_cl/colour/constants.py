"""Luminance of linear sRGB; its weights are written here and nowhere else."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear sRGB, ITU-R BT.709-6


def colour_luminance(colour: ArrayLike) -> float:
    """Return the luminance of a linear colour."""
    return float(LUMINANCE @ np.asarray(colour, dtype=np.float64))
