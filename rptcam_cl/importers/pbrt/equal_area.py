"""The equal-area map between the sphere and a square, in which pbrt-v4 stores pictures of the sky.

P. Clarberg, "Fast equal-area mapping of the (hemi)sphere using SIMD", Journal of Graphics Tools 13 (3), 2008: the upper
half sphere fills the diamond in the middle of the square, the lower one its corners.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# Samples across and down each pixel of a picture in longitude and latitude.
SAMPLES = 4
TALLEST = 4096  # rows; twice as many columns are half of the pixels that a picture may have


def square_of_angles(z: ArrayLike, longitude: ArrayLike) -> tuple[Array, Array]:
    """Return the coordinates, 0 to 1 from the left and from the top, of directions.

    Parameters
    ----------
    z
        Cosine of the angle from the pole +z, which is the middle of the square.
    longitude
        Angle from +x over +y [rad].
    """
    height = np.asarray(z, np.float64)
    x, y = np.cos(longitude), np.sin(longitude)
    radius = np.sqrt(np.clip(1 - np.abs(height), 0, 1))
    v = radius * (np.arctan2(np.abs(y), np.abs(x)) * (2 / np.pi))
    u = radius - v
    below = height < 0
    u, v = np.where(below, 1 - v, u), np.where(below, 1 - u, v)
    return (np.copysign(u, x) + 1) / 2, (np.copysign(v, y) + 1) / 2


def heights(size: int) -> Array:
    """Return z of the directions of the pixels' centres of a square picture, (size, size)."""
    a = np.abs(2 * (np.arange(size) + 0.5) / size - 1)
    above = 1 - (a[:, None] + a[None, :])
    return np.asarray(np.copysign(1 - (1 - np.abs(above)) ** 2, above))


def in_longitude_and_latitude(square: NDArray[np.float32], *, clockwise: bool) -> NDArray[np.float32]:
    """Return a square picture of the sphere as one in longitude and latitude, twice as wide as high.

    Each pixel is the mean of `SAMPLES` x `SAMPLES` pixels that lie under it, spread evenly in longitude and latitude.

    Parameters
    ----------
    square : (n, n, 3) array
    clockwise
        Whether longitude falls from the left edge to the right one; it is 180 degrees in the middle either way.
    """
    size = len(square)
    rows = min(size, TALLEST)
    longitude = (np.arange(2 * rows * SAMPLES) + 0.5) / (2 * rows * SAMPLES) * (2 * np.pi)
    if clockwise:
        longitude = longitude[::-1]
    found = np.empty((rows, 2 * rows, 3), np.float32)
    for row in range(rows):
        latitude = np.pi * (row + (np.arange(SAMPLES) + 0.5) / SAMPLES) / rows
        u, v = square_of_angles(np.cos(latitude)[:, None], longitude[None, :])
        column = np.minimum((u * size).astype(np.intp), size - 1)
        line = np.minimum((v * size).astype(np.intp), size - 1)
        samples = square[line, column].reshape(SAMPLES, 2 * rows, SAMPLES, 3)
        found[row] = samples.mean(axis=(0, 2), dtype=np.float64)
    return found
