"""Values known at nodes all over a film and beside it, and between them by cubics."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NEIGHBOURS = [(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1) if row or column]


class FilmGrid:
    """A square grid of nodes; what is missing is continued from what is there.

    Parameters
    ----------
    values : (n, n, k) array
        At the nodes, rows upwards and columns to the right; nan where unknown.
    reach : float
        Where the outermost nodes are, in half films.
    """

    def __init__(self, values: Array, reach: float) -> None:
        self._values, self._reach = _continued(values), reach
        self._per_side = (len(values) - 1) / (2 * reach)

    def at(self, places: Array) -> Array:
        """Return the values (m, k) at places (m, 2) right and up, to 1 at the edges of the film; nan beyond the nodes.

        Cubics through four nodes each way.
        """
        count, flat = len(self._values), self._values.reshape(-1, self._values.shape[2])
        with np.errstate(invalid="ignore"):
            scaled = (places + self._reach) * self._per_side
            known = np.all((scaled >= -1e-9) & (scaled <= count - 1 + 1e-9), axis=1)
        scaled = np.where(known[:, None], scaled, 1.0)
        first = np.clip(np.floor(scaled).astype(np.int64) - 1, 0, count - 4)
        (across, along), found = (_weights(t) for t in (scaled - first).T), np.zeros((len(places), flat.shape[1]))
        for row in range(4):
            start = (first[:, 1] + row) * count + first[:, 0]
            for column in range(4):
                found += (along[row] * across[column])[:, None] * flat[start + column]
        found[~known] = np.nan
        return found


def _weights(t: Array) -> tuple[Array, Array, Array, Array]:
    """Return the weights of the nodes 0, 1, 2 and 3 at places between them (Lagrange)."""
    a, b, c = t - 1.0, t - 2.0, t - 3.0
    return -a * b * c / 6.0, t * b * c / 2.0, -t * a * c / 2.0, t * a * b / 6.0


def _continued(values: Array) -> Array:
    """Return values (n, n, k) without nan: each missing node goes on straight or in a parabola."""
    values, count = values.copy(), len(values)
    known = np.asarray(np.isfinite(values).all(axis=2))
    while known.any() and not known.all():
        sums, votes = np.zeros_like(values), np.zeros((count, count, 1))
        for row, column in NEIGHBOURS:
            (one, near), (two, far), (three, last) = (_moved(values, known, row * k, column * k) for k in (1, 2, 3))
            bent = near & far & last
            guess = np.where(bent[..., None], 3 * one - 3 * two + three, 2 * one - two)
            usable = (near & far & ~known)[..., None]
            sums += np.where(usable, guess, 0.0)
            votes += usable
        fresh = votes[..., 0] > 0
        if not fresh.any():
            break
        values[fresh] = sums[fresh] / votes[fresh]
        known |= fresh
    return values


def _moved(values: Array, known: NDArray[np.bool_], rows: int, columns: int) -> tuple[Array, NDArray[np.bool_]]:
    """Return what the node so many rows and columns farther holds, and whether it is known."""
    count = len(values)
    index = np.arange(count)
    row, column = np.clip(index + rows, 0, count - 1), np.clip(index + columns, 0, count - 1)
    inside = ((index + rows == row)[:, None]) & ((index + columns == column)[None, :])
    there = np.ix_(row, column)
    return np.nan_to_num(values[there]), known[there] & inside
