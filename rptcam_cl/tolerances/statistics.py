"""Shares and percentiles of a sample, each with the interval in which that of all copies lies."""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError

Array = NDArray[np.float64]

CONFIDENCE = 0.95


class Interval(NamedTuple):
    """An estimate and the bounds that hold it with a given confidence."""

    value: float
    low: float
    high: float


def share(hits: int, count: int, confidence: float = CONFIDENCE) -> Interval:
    """Return which share of all copies is good, of how many of a sample are (Wilson, J. Am. Stat. Assoc. 22, 1927)."""
    z = NormalDist().inv_cdf(0.5 + confidence / 2)
    found, weight = hits / count, 1.0 / (1.0 + z * z / count)
    middle = weight * (found + z * z / (2 * count))
    half = weight * z * math.sqrt(found * (1 - found) / count + (z / (2 * count)) ** 2)
    low, high = (0.0 if hits == 0 else middle - half), (1.0 if hits == count else middle + half)
    return Interval(found, low, high)


def rank(percent: float, count: int) -> int:
    """Return the place, from 0, of a percentile among sorted copies: that percent of them are at most as bad.

    Raises
    ------
    InputError
        For a percentile that is not above 0 and at most 100.
    """
    if not 0 < percent <= 100:
        raise InputError(f"a percentile must be above 0 and at most 100 % (got {percent:g} %)")
    return max(math.ceil(percent / 100 * count - 1e-9), 1) - 1


def percentile(ordered: Array, percent: float, confidence: float = CONFIDENCE) -> Interval:
    """Return a percentile of sorted numbers, and the bounds that hold that of all copies, whatever their distribution.

    How many of a sample lie below the true percentile is binomial, so the bounds are two of the sorted numbers (David
    and Nagaraja, Order Statistics, 3rd ed., 7.1); a sample too small for the confidence has its ends.
    """
    count, p = len(ordered), percent / 100
    place = rank(percent, count)
    below = np.cumsum(_binomial(count, p))  # chance that at most k of the sample lie below it
    tail = (1 - confidence) / 2
    low = int(np.searchsorted(below, tail, side="right")) - 1
    high = int(np.searchsorted(below, 1 - tail, side="left"))
    low, high = max(low, 0), min(high, count - 1)
    return Interval(float(ordered[place]), float(ordered[min(low, place)]), float(ordered[max(high, place)]))


def _binomial(count: int, p: float) -> Array:
    """Return the chance of k hits of `count`, for k from 0 to `count`."""
    if p >= 1:
        return np.asarray(np.eye(count + 1)[-1])
    k = np.arange(count + 1)
    factorials = np.concatenate([[0.0], np.cumsum(np.log(np.arange(1, count + 1)))])
    logarithm = factorials[-1] - factorials[k] - factorials[count - k] + k * math.log(p) + (count - k) * math.log1p(-p)
    return np.asarray(np.exp(logarithm))
