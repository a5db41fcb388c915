"""The tree over few boxes, found on the host: the kernels that build large ones take seconds to compile."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.rendering.trees.binary_tree import binary_tree
from rptcam_cl.rendering.trees.wide_tree import Bvh, max_binary_depth, widen

FEW = 128  # boxes, which take 5 ms; a tenth more cost than large trees at most, that of finding hits less than a 50th
Array = NDArray[np.float64]


def tree_of_few(lower: NDArray[np.float32], upper: NDArray[np.float32], leaf_size: int) -> Bvh:
    """Return the binary tree over boxes whose every node is split at the least cost, area times leaf blocks.

    Parameters
    ----------
    lower, upper
        Corners of one box or more (n, 3), float32.
    leaf_size
        Most boxes of a leaf.
    """
    low, high = lower.astype(np.float64), upper.astype(np.float64)
    order = np.arange(len(low))
    depths = np.zeros(len(low), np.uint8)
    waiting = [(0, len(low), 0)]
    while waiting:
        begin, end, depth = waiting.pop()
        blocks = _blocks(end - begin, leaf_size)
        if blocks > 1:
            part = order[begin:end]
            in_halves = depth + np.ceil(np.log2(blocks)) >= max_binary_depth(2)
            inside, middle = (
                _halves(low[part], high[part], leaf_size) if in_halves else _split(low[part], high[part], leaf_size)
            )
            order[begin:end] = part[inside]
            depths[begin + middle] = depth + 1
            waiting += [(begin, begin + middle, depth + 1), (begin + middle, end, depth + 1)]
    begins = np.concatenate([[0], np.flatnonzero(depths)])
    counts = np.diff(begins, append=len(low))
    places = begins[:, None] + np.arange(leaf_size)
    used = np.arange(leaf_size) < counts[:, None]
    primitives = np.where(used, order[np.minimum(places, len(low) - 1)], -1).astype(np.int32)
    bounds = [np.minimum.reduceat(lower[order], begins), np.maximum.reduceat(upper[order], begins)]
    return widen(binary_tree(depths[begins[1:]], np.concatenate(bounds, axis=1)), primitives, 2)


def _blocks(count: int, leaf_size: int) -> int:
    return -(-count // leaf_size)


def _halves(low: Array, high: Array, leaf_size: int) -> tuple[NDArray[np.intp], int]:
    """Return an order along the longest axis, and where it is cut so that both parts have as many leaves."""
    centres = low + high
    axis = int(np.ptp(centres, axis=0).argmax())
    return np.argsort(centres[:, axis], kind="stable"), (_blocks(len(low), leaf_size) + 1) // 2 * leaf_size


def _split(low: Array, high: Array, leaf_size: int) -> tuple[NDArray[np.intp], int]:
    """Return the order along an axis, and where it is cut, that cost least of all."""
    centres = low + high
    orders = np.argsort(centres, axis=0, kind="stable")
    if not np.ptp(centres, axis=0).any():
        return _halves(low, high, leaf_size)
    columns = orders.T  # (axis, place)
    before = _areas(np.minimum.accumulate(low[columns], axis=1), np.maximum.accumulate(high[columns], axis=1))
    back = columns[:, ::-1]
    after = _areas(np.minimum.accumulate(low[back], axis=1), np.maximum.accumulate(high[back], axis=1))[:, ::-1]
    counts = np.arange(1, len(low))
    costs = before[:, :-1] * -(-counts // leaf_size) + after[:, 1:] * -(-counts[::-1] // leaf_size)
    axis, cut = np.unravel_index(int(costs.argmin()), costs.shape)
    return columns[axis], int(cut) + 1


def _areas(low: Array, high: Array) -> Array:
    x, y, z = np.moveaxis(high - low, -1, 0)
    return np.asarray(x * y + y * z + z * x + 1e-12 * (x + y + z))  # flat boxes have some too
