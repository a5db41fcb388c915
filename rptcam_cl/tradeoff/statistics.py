"""Intervals of what is measured by a few independent repetitions: bootstrap over the seeds.

The error of a picture is a mean over pairs of different seeds (a U-statistic), which is free of the noise of either:
two independent pictures are never wrong in the same way by chance. Seeds are drawn anew, with all that was measured
under them together; pairs of a seed with itself never count. With few seeds the percentiles of the bootstrap lie too
close together, and are widened as those of a normal distribution would have to be to match Student's (T. C. Hesterberg,
«What teachers should know about the bootstrap», The American Statistician 69, 2015).
"""

from __future__ import annotations

import math
from functools import cache
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass

Array = NDArray[np.float64]

REPLICATES = 2000
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Interval:
    """An estimate and the ends of its interval of confidence; each may be infinite."""

    value: float
    low: float
    high: float


def draws(seeds: int, rng: np.random.Generator, replicates: int = REPLICATES) -> NDArray[np.int64]:
    """Return how often each seed is drawn, shape (replicates, seeds); at least two different ones each time."""
    counts: NDArray[np.int64] = rng.multinomial(seeds, np.full(seeds, 1 / seeds), size=replicates)
    several: NDArray[np.int64] = counts[(counts > 0).sum(axis=1) > 1]
    return several


def once(seeds: int) -> NDArray[np.int64]:
    """Return the draw that holds every seed once, shape (1, seeds): what estimates follow from."""
    return np.ones((1, seeds), np.int64)


def over_pairs(matrix: Array, counts: NDArray[np.int64]) -> Array:
    """Return the mean of a symmetric matrix (seeds, seeds) over pairs of different seeds, for each draw."""
    different = matrix - np.diag(np.diag(matrix))
    sums = np.einsum("bs,st,bt->b", counts, different, counts)
    pairs = counts.sum(axis=1) ** 2 - (counts**2).sum(axis=1)
    return np.asarray(sums / pairs)


def error_over_pairs(matrix: Array) -> float:
    """Return the standard error of the mean over pairs of different seeds.

    Products of pairs that share no seed tell the square of what is estimated without the error of the estimate. Where
    that leaves less than if all pairs were independent, which they are where nothing but noise is measured, the latter
    counts. There the bootstrap alone would give intervals half as wide again as they need be.
    """
    first, second = np.triu_indices(len(matrix), 1)
    values = matrix[first, second]
    apart = (first[:, None] != first) & (first[:, None] != second) & (second[:, None] != first)
    apart &= second[:, None] != second
    mean = values.mean()
    spread = mean**2 - float(values @ apart @ values) / apart.sum()
    return math.sqrt(max(spread, float(np.mean((values - mean) ** 2)) / len(values)))


def spread_about(value: float, replicates: Array, error: float) -> Array:
    """Return replicates moved away from an estimate, or towards it, so that their standard deviation is its error."""
    spread = float(replicates.std())
    return np.asarray(value + (replicates - value) * (error / spread if spread > 0 else 0.0))


def over_seeds(values: Array, counts: NDArray[np.int64]) -> Array:
    """Return the mean of one value per seed, for each draw."""
    return np.asarray(counts @ values / counts.sum(axis=1))


def median_over_seeds(values: Array, counts: NDArray[np.int64]) -> Array:
    """Return the median of one value per seed, for each draw; the mean of the middle two where there are two."""
    order = np.argsort(values)
    below = np.cumsum(counts[:, order], axis=1)
    half = counts.sum(axis=1, keepdims=True) / 2
    lower, upper = (below >= half).argmax(axis=1), (below > half).argmax(axis=1)
    return np.asarray((values[order][lower] + values[order][upper]) / 2)


def interval(value: float, replicates: Array, seeds: int, confidence: float = CONFIDENCE) -> Interval:
    """Return an estimate with the percentiles of its replicates, widened for few seeds."""
    tail = NormalDist().cdf(-math.sqrt(seeds / (seeds - 1)) * student_quantile((1 + confidence) / 2, seeds - 1))
    low, high = np.quantile(replicates, [tail, 1 - tail], method="inverted_cdf")  # which may be infinite
    return Interval(float(value), float(low), float(high))


@cache
def student_quantile(probability: float, freedom: int) -> float:
    """Return a quantile above the median of Student's distribution, by summing its density."""
    x = np.linspace(0.0, 100.0, 200_001)
    log_scale = math.lgamma((freedom + 1) / 2) - math.lgamma(freedom / 2) - 0.5 * math.log(freedom * math.pi)
    density = np.exp(log_scale - (freedom + 1) / 2 * np.log1p(x**2 / freedom))
    shares = 0.5 + np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2 * np.diff(x))])
    return float(np.interp(probability, shares, x))
