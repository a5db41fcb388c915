"""The random numbers of a tolerance run, each keyed by seed, tolerance and copy.

A copy is therefore the same however many are made, and a tolerance added at the end of a specification leaves what the
others draw as it was.
"""

from __future__ import annotations

from collections.abc import Sequence
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.tolerances.limits import Limit

Array = NDArray[np.float64]

_NORMAL = np.vectorize(NormalDist().inv_cdf, otypes=[np.float64])


def drawn(limits: Sequence[Limit], copies: int, seed: int) -> Array:
    """Return values (copies, limits, 2) of all that may be off.

    A single number lies within ± its size: evenly, by a normal distribution cut off there, or at one of the two ends. A
    pair lies in the disc of that radius: evenly over its area, by the normal distribution of both cut off at its rim,
    or on the rim.
    """
    values = np.zeros((copies, len(limits), 2))
    for number, limit in enumerate(limits):
        key = np.random.SeedSequence([seed, *limit.key])
        chances = np.random.Generator(np.random.Philox(key)).random((copies, 2))
        values[:, number] = _pairs(limit, chances) if limit.deviation.is_pair else _numbers(limit, chances)
    return values


def _numbers(limit: Limit, chances: Array) -> Array:
    chance = chances[:, 0]
    match limit.distribution:
        case "uniform":
            share = 2.0 * chance - 1.0
        case "end_point":
            share = np.where(chance < 0.5, -1.0, 1.0)
        case "normal":
            outside = NormalDist().cdf(-limit.sigmas)
            share = np.clip(_NORMAL(outside + chance * (1.0 - 2.0 * outside)) / limit.sigmas, -1.0, 1.0)
    return np.stack([limit.size * share, np.zeros_like(share)], axis=1)


def _pairs(limit: Limit, chances: Array) -> Array:
    chance, angle = chances[:, 0], 2.0 * np.pi * chances[:, 1]
    match limit.distribution:
        case "uniform":
            share = np.sqrt(chance)
        case "end_point":
            share = np.ones_like(chance)
        case "normal":  # the distance from the middle has the distribution of Rayleigh
            inside = -np.expm1(-0.5 * limit.sigmas**2)
            share = np.sqrt(-2.0 * np.log1p(-chance * inside)) / limit.sigmas
    return np.asarray((limit.size * share)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))
