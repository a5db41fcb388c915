"""Rows of one element of a PLY file, taken apart."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Lists = list[tuple[NDArray[Any], NDArray[Any]]]


class Rows(NamedTuple):
    """Rows of one element.

    Attributes
    ----------
    values : dict
        Per property that is no list: an array (n,).
    lists : dict
        Per list property: for each length k that occurs, the numbers of the rows (m,) and their entries (m, k).
    """

    values: dict[str, NDArray[Any]]
    lists: dict[str, Lists]


def grouped(lengths: NDArray[Any], starts: NDArray[np.intp], entries: NDArray[Any]) -> Lists:
    """Return lists by their length.

    Parameters
    ----------
    lengths : (n,) int
        Length of each row's list.
    starts : (n,) int
        Place of each row's first entry.
    entries : (e,) array
        All entries.
    """
    found: Lists = []
    for length in np.unique(lengths):
        numbers = np.flatnonzero(lengths == length)
        found.append((numbers, entries[starts[numbers, None] + np.arange(length)]))
    return found


def joined(parts: list[Rows]) -> Rows:
    """Return the rows of several parts as one."""
    if len(parts) == 1:
        return parts[0]
    values = {name: np.concatenate([part.values[name] for part in parts]) for name in parts[0].values}
    lists: dict[str, Lists] = {}
    for name in parts[0].lists:
        by_length: dict[int, Lists] = {}
        for part in parts:
            for group in part.lists[name]:
                by_length.setdefault(group[1].shape[1], []).append(group)
        lists[name] = [
            (np.concatenate([numbers for numbers, _ in groups]), np.concatenate([entries for _, entries in groups]))
            for _, groups in sorted(by_length.items())
        ]
    return Rows(values, lists)
