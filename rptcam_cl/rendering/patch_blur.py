"""A picture blurred by a kernel that varies over it: each pixel spreads its light by the kernels of the nearest nodes.

Nodes lie on a grid over the whole film. A pixel's kernel is that of the four about it, weighted linearly, and the
weights sum to 1: no light is lost or made. What leaves the picture comes back as if from a mirror at its border, where
a real film receives as much from the scene beside it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def blurred(planes: Array, offset: tuple[int, int], nodes: tuple[Array, Array], kernels: Sequence[Array]) -> Array:
    """Return planes (3, height, width) after each pixel has spread its light.

    Parameters
    ----------
    planes
        In float64, with any dynamic range.
    offset
        Column and row of the first pixel on the whole film.
    nodes
        Columns and rows of the nodes on the whole film, rising.
    kernels
        One (3, k, k) for each node, by rows; k is odd.
    """
    height, width = planes.shape[1:]
    reach = kernels[0].shape[-1] // 2
    wide = np.zeros((3, height + 2 * reach, width + 2 * reach))
    weights = [_hats(axis, start + np.arange(length)) for axis, start, length in
               zip(nodes, offset, (width, height), strict=True)]  # fmt: skip
    for (row, column), kernel in zip(_places(nodes), kernels, strict=True):
        columns, rows = np.flatnonzero(weights[0][column]), np.flatnonzero(weights[1][row])
        if not len(columns) or not len(rows):
            continue
        left, right, top, bottom = columns[0], columns[-1] + 1, rows[0], rows[-1] + 1
        share = weights[1][row, top:bottom, None] * weights[0][column, left:right]
        for plane, part, target in zip(planes, kernel, wide, strict=True):
            spread = _convolved(plane[top:bottom, left:right] * share, part)
            target[top : bottom + 2 * reach, left : right + 2 * reach] += spread
    return _folded(_folded(wide, height, reach, 1), width, reach, 2)


def _places(nodes: tuple[Array, Array]) -> Iterator[tuple[int, int]]:
    for row in range(len(nodes[1])):
        for column in range(len(nodes[0])):
            yield row, column


def _hats(nodes: Array, places: Array) -> Array:
    """Return the weight of each node at each place, (nodes, places); they sum to 1."""
    if len(nodes) == 1:
        return np.ones((1, len(places)))
    return np.array([np.interp(places, nodes, unit) for unit in np.eye(len(nodes))])


def _convolved(plane: Array, kernel: Array) -> Array:
    """Return the full convolution; where nothing is negative before, nothing is after."""
    shape = tuple(quick(a + b - 1) for a, b in zip(plane.shape, kernel.shape, strict=True))
    product = np.fft.rfft2(plane, shape) * np.fft.rfft2(kernel, shape)
    height, width = (a + b - 1 for a, b in zip(plane.shape, kernel.shape, strict=True))
    spread = np.fft.irfft2(product, shape)[:height, :width]
    return np.maximum(spread, 0.0) if plane.min() >= 0 else spread


def quick(length: int) -> int:
    """Return the next length whose only prime factors are 2, 3 and 5, which transforms are fast for."""
    while True:
        rest = length
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return length
        length += 1


def _folded(wide: Array, length: int, reach: int, axis: int) -> Array:
    """Return an axis of planes without its margins, whose light comes back mirrored."""
    places = np.arange(-reach, length + reach) % (2 * length)
    places = np.where(places < length, places, 2 * length - 1 - places)
    moved = np.moveaxis(wide, axis, 0)
    found = np.zeros((length, *moved.shape[1:]))
    for place, line in zip(places, moved, strict=True):
        found[place] += line
    return np.moveaxis(found, 0, axis)
