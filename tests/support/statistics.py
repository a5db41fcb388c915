"""Statistics of rendered pictures: equivalence, 8 x 8 tiles, goodness of fit, moments, convergence.

Two kinds of question, never mixed. *Does it have this value?* is answered by equivalence: the interval of the
measurement must lie inside the tolerance, so a noisy measurement fails. *Do two pictures differ?* is answered by
Welch's test on tile means with Šidák's correction: per-pixel tests are blind to a bias of everything, one global mean
is blind to a bias of little.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Z = 3.89  # two-sided 1e-4: about a hundred statistics then raise a false alarm in 1 % of all runs of the suite
ALPHA = 1e-4
TILE = 8


class InconclusiveError(AssertionError):
    """The measurement is too noisy to tell."""


def assert_equivalent(mean, error, expected, tolerance):
    """Fail unless ``mean`` with its standard ``error`` lies within ``tolerance`` of ``expected``, all absolute."""
    given = (np.asarray(value, float) for value in (mean, error, expected, tolerance))
    mean, error, expected, tolerance = np.broadcast_arrays(*given)
    noisy = Z * error > tolerance / 2
    if noisy.any():
        raise InconclusiveError(f"{Z} x standard error {error[noisy]} exceeds half the tolerance {tolerance[noisy]}")
    off = np.abs(mean - expected) + Z * error
    assert (off <= tolerance).all(), f"mean {mean} +- {error}, expected {expected} +- {tolerance}"


@dataclass(frozen=True)
class Sampled:
    """Values with the variances of these values, and the degrees of freedom of the variances."""

    mean: NDArray[np.float64]
    variance: NDArray[np.float64]
    freedom: float


def sampled(pictures) -> Sampled:
    """Return the mean of independent pictures, per pixel, with its variance."""
    stack = np.asarray(pictures, np.float64)
    count = len(stack)
    return Sampled(stack.mean(axis=0), stack.var(axis=0, ddof=1) / count, count - 1)


def tiles(picture: Sampled, size: int = TILE) -> Sampled:
    """Return the means of whole tiles of a picture (rows, columns, channels); what is left at the edges is dropped."""
    rows, columns = picture.mean.shape[0] // size, picture.mean.shape[1] // size

    def sums(values):
        whole = values[: rows * size, : columns * size]
        return whole.reshape(rows, size, columns, size, -1).sum(axis=(1, 3))

    return Sampled(sums(picture.mean) / size**2, sums(picture.variance) / size**4, picture.freedom * size**2)


def overall(picture: Sampled) -> Sampled:
    """Return the mean of the whole picture per channel."""
    pixels = picture.mean.shape[0] * picture.mean.shape[1]
    return Sampled(picture.mean.mean((0, 1)), picture.variance.sum((0, 1)) / pixels**2, picture.freedom * pixels)


def sidak(alpha: float, count: int) -> float:
    """Return the level of each of ``count`` tests that together raise a false alarm with probability ``alpha``."""
    return -np.expm1(np.log1p(-alpha) / count)


def welch(a: Sampled, b: Sampled) -> NDArray[np.float64]:
    """Return the two-sided p-values of equal means.

    Values without variance are equal to 1e-5 or not: that is what summing thousands of equal float32 numbers loses.
    """
    variance = a.variance + b.variance
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (a.mean - b.mean) / np.sqrt(variance)
        freedom = variance**2 / (a.variance**2 / a.freedom + b.variance**2 / b.freedom)
        p = 2 * stats.t.sf(np.abs(t), freedom)
    exact = np.isclose(a.mean, b.mean, rtol=1e-5, atol=1e-12)
    return np.where(variance > 0, p, exact.astype(float))


def assert_same_tiles(a: Sampled, b: Sampled, alpha: float = ALPHA):
    """Fail when two pictures differ in some 8 x 8 tile or in their mean."""
    left, right = tiles(a), tiles(b)
    p = welch(left, right)
    at = np.unravel_index(p.argmin(), p.shape)
    assert p.min() > sidak(alpha, p.size), f"tile {at}: {left.mean[at]} against {right.mean[at]}, p {p.min():.1e}"
    p = welch(overall(a), overall(b))
    assert p.min() > sidak(alpha, p.size), f"means {overall(a).mean} and {overall(b).mean} differ, p {p}"


def chi_squared(observed, expected) -> float:
    """Return the p-value of counts against expected counts.

    Cells that expect fewer than 5 are pooled from the smallest on; a count where nothing can fall fails outright, and
    so does a test with fewer than 10 degrees of freedom, which could prove nothing.
    """
    observed, expected = np.ravel(observed).astype(float), np.ravel(expected).astype(float)
    if (observed[expected == 0] > 0).any():
        return 0.0
    order = np.argsort(expected[expected > 0])
    observed, expected = observed[expected > 0][order], expected[expected > 0][order]
    pooled = int(np.searchsorted(expected, 5.0))
    while 0 < pooled < len(expected) and expected[:pooled].sum() < 5:
        pooled += 1
    if pooled:
        observed = np.concatenate([[observed[:pooled].sum()], observed[pooled:]])
        expected = np.concatenate([[expected[:pooled].sum()], expected[pooled:]])
    freedom = len(expected) - 1
    if freedom < 10:
        raise InconclusiveError(f"{freedom} degrees of freedom are too few")
    return float(stats.chi2.sf((np.square(observed - expected) / expected).sum(), freedom))


def moment_scores(values, expected) -> NDArray[np.float64]:
    """Return the z-scores of the means of columns of ``values``: they see the smooth errors that chi-squared misses."""
    values = np.asarray(values, float)
    error = values.std(axis=0, ddof=1) / np.sqrt(len(values))
    return (values.mean(axis=0) - np.asarray(expected)) / error


def slope(counts, errors) -> float:
    """Return the exponent of ``errors`` against ``counts``: -1/2 for independent samples."""
    return float(np.polyfit(np.log(counts), np.log(errors), 1)[0])
