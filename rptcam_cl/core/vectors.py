"""Vectors of three numbers, for which numpy's functions for arrays of them take ten times as long."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def cross(first: ArrayLike, second: ArrayLike) -> NDArray[np.float64]:
    """Return the cross product of two vectors, as `numpy.cross` does bit by bit."""
    ax, ay, az = np.asarray(first, dtype=np.float64).tolist()
    bx, by, bz = np.asarray(second, dtype=np.float64).tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
