"""The equal-area map between the sphere and a square, as pbrt-v4 stores pictures of the sky.

P. Clarberg, "Fast equal-area mapping of the (hemi)sphere using SIMD", Journal of Graphics Tools 13 (3), 2008: the upper
half sphere fills the diamond in the middle of the square, the lower one its corners.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def square_of_direction(directions: ArrayLike) -> Array:
    """Return the points (…, 2) in [0, 1]^2 of unit directions (…, 3), +z being the middle of the square."""
    x, y, z = np.moveaxis(np.asarray(directions, np.float64), -1, 0)
    radius = np.sqrt(np.clip(1 - np.abs(z), 0, 1))
    turn = np.arctan2(np.abs(y), np.abs(x)) * (2 / np.pi)  # of a quarter
    v = radius * turn
    u = radius - v
    below = z < 0
    u, v = np.where(below, 1 - v, u), np.where(below, 1 - u, v)
    return np.stack([np.copysign(u, x) + 1, np.copysign(v, y) + 1], axis=-1) / 2


def direction_of_square(points: ArrayLike) -> Array:
    """Return the unit directions (…, 3) of points (…, 2) in [0, 1]^2."""
    u, v = np.moveaxis(2 * np.asarray(points, np.float64) - 1, -1, 0)
    a, b = np.abs(u), np.abs(v)
    above = 1 - (a + b)  # positive inside the diamond
    radius = 1 - np.abs(above)
    turn = np.where(radius > 0, (b - a) / np.where(radius > 0, radius, 1) + 1, 1) * (np.pi / 4)
    z = np.copysign(1 - radius**2, above)
    ring = radius * np.sqrt(np.clip(2 - radius**2, 0, None))
    return np.stack([np.copysign(np.cos(turn), u) * ring, np.copysign(np.sin(turn), v) * ring, z], axis=-1)
