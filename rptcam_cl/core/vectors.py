"""Constants of physics, vectors of three numbers, and the running sums that kernels pick cells by."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Numbers of physics that need no array: each is written here and nowhere else.

LUMENS_PER_WATT = 683.0  # SI: the luminous efficacy of light of 540 THz
LINE_F_NM, LINE_D_NM, LINE_C_NM = 486.1327, 587.5618, 656.2725  # Fraunhofer lines of n_d and V_d
PLANCK, LIGHT_SPEED, BOLTZMANN = 6.62607015e-34, 299792458.0, 1.380649e-23  # [J s], [m/s], [J/K], exact in the SI


# Vectors of three numbers, for which numpy's functions for arrays of them take ten times as long.


def cross(first: ArrayLike, second: ArrayLike) -> NDArray[np.float64]:
    """Return the cross product of two vectors, as `numpy.cross` does bit by bit."""
    ax, ay, az = np.asarray(first, dtype=np.float64).tolist()
    bx, by, bz = np.asarray(second, dtype=np.float64).tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


#
# Curves that ``kernels/common/curve.h`` picks cells by: running sums of shares, each with a guide into it.
#
# Their inverse takes evenly spread numbers to evenly spread cells. The alias method does not: with 256 samples of a
# lattice per pixel it was measured to make the light of a sky a hundred times noisier.


def curves(shares: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Return the curves of rows of shares, shape (rows, 2 (cells + 1)), and the probability of each cell.

    Probabilities are those of the sums as float32 has them. A row without shares has even ones.
    """
    cells = shares.shape[1]
    given = np.where(shares.sum(axis=1, keepdims=True) > 0, shares, 1.0)
    sums = np.concatenate([np.zeros((len(shares), 1)), np.cumsum(given, axis=1)], axis=1)
    sums_32 = (sums / sums[:, -1:]).astype(np.float32)
    steps = np.arange(cells) / cells
    guides = np.array([np.searchsorted(row, steps, side="right") - 1 for row in sums_32]).clip(0, cells - 1)
    pairs = np.zeros((len(shares), cells + 1, 2), np.float32)
    pairs[..., 0], pairs[:, :-1, 1] = sums_32, guides
    return pairs.reshape(len(shares), -1), np.diff(sums_32.astype(np.float64), axis=1)
