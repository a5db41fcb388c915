"""Picking an item by its weight in constant time: Walker's alias table, built as Vose (1991) does."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def alias_table(weights: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the share of each cell that it keeps and the index that has the rest (Vose 1991)."""
    count = len(weights)
    scaled = weights * (count / weights.sum())
    keep, other = np.ones(count), np.arange(count)
    small = [i for i in range(count) if scaled[i] < 1]
    large = [i for i in range(count) if scaled[i] >= 1]
    while small and large:
        low, high = small.pop(), large[-1]
        keep[low], other[low] = scaled[low], high
        scaled[high] -= 1 - scaled[low]
        if scaled[high] < 1:
            small.append(large.pop())
    return keep, other
