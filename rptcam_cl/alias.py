"""Picking an item by its weight in constant time: Walker's alias table (1977), built by sums instead of one by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def alias_table(weights: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the share of each cell that it keeps and the index that has the rest.

    Vose (1991) fills light cells from a heavy one until that is light itself, then goes on with the next heavy one.
    Which heavy cell serves a light one follows from running sums of what the light lack and the heavy have too much,
    as Hübschle-Schneider and Sanders, «Parallel weighted random sampling» (2019), observed.
    """
    count = len(weights)
    scaled = weights * (count / weights.sum())
    keep, other = np.ones(count), np.arange(count)
    light, heavy = np.flatnonzero(scaled < 1), np.flatnonzero(scaled >= 1)
    if not len(light) or not len(heavy):  # all the same, but for rounding
        return keep, other
    lack, excess = np.cumsum(1 - scaled[light]), np.cumsum(scaled[heavy] - 1)
    keep[light] = scaled[light]
    server = np.searchsorted(excess, np.concatenate([[0.0], lack[:-1]]), side="right")
    other[light] = heavy[np.minimum(server, len(heavy) - 1)]
    emptied = np.searchsorted(lack, excess, side="right")  # the light cell that takes a heavy one below its share
    light_now = (emptied < len(light)) & (np.arange(len(heavy)) < len(heavy) - 1)
    index = np.flatnonzero(light_now)
    keep[heavy[index]] = np.clip(1 + excess[index] - lack[emptied[index]], 0, 1)
    other[heavy[index]] = heavy[index + 1]
    return keep, other
