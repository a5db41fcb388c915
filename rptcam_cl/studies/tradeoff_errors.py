"""Short renders of configurations, how they differ by pairs of seeds, and what is said of each: noise, bias, times."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import field
from functools import cache
from itertools import combinations
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.rendering.tolerance_run import CONFIDENCE, Interval

Array = NDArray[np.float64]

# What is measured: short renders of every configuration, tile by tile.

REFERENCE = "full"  # name of the most accurate configuration
AS_IT_IS = "as the scene says"


@dataclass(frozen=True)
class SpreadTiles:
    """One tile in each cell of a grid over the film.

    Attributes
    ----------
    tiles : (n,) array
        Numbers of the tiles, row by row of the grid.
    shape : (rows, columns)
        Of the grid.
    pixels : (p,) array
        Where their pixels lie in the film's buffer.
    cell : (p,) array
        Which tile of `tiles` a pixel is in.
    weights : (p,) array
        Share of the picture that a pixel stands for; 1 in all.
    all : int
        Tiles that the picture has.
    """

    tiles: NDArray[np.uint32]
    shape: tuple[int, int]
    pixels: NDArray[np.int64]
    cell: NDArray[np.int64]
    weights: NDArray[np.float64]
    all: int

    def some(self, chosen: NDArray[np.int64]) -> SpreadTiles:
        """Return a few of the tiles, by their places in `tiles`; each pixel stands for what it did."""
        of_cell = np.full(len(self.tiles), -1)
        of_cell[chosen] = np.arange(len(chosen))
        cell = of_cell[self.cell]
        kept = cell >= 0
        shape = (1, len(chosen))
        return SpreadTiles(self.tiles[chosen], shape, self.pixels[kept], cell[kept], self.weights[kept], self.all)


@dataclass(frozen=True)
class LongPictures:
    """Pictures of a few of the tiles with many samples, which tell how noise falls.

    Attributes
    ----------
    samples : int
        Samples per pixel.
    chosen : (m,) array
        Which of the tiles.
    pixels : list
        For each configuration, pixels (seeds, p, 3).
    """

    samples: int
    chosen: NDArray[np.int64]
    pixels: list[NDArray[np.float32]]


_Timings = tuple[Array, Array]
"""Times of one configuration, per sample per pixel of the whole picture, one for each seed [s].

With the device to itself: on a processor the CPU time of all threads divided by the cores, else by the clock. Then the
time by the clock.
"""


@dataclass(frozen=True)
class Pictures:
    """All short renders.

    Attributes
    ----------
    tiles : SpreadTiles
    samples : (int, int)
        Samples per pixel of the pictures of each seed.
    seeds : int
    pixels : list
        For each configuration and number of samples, pixels (seeds, p, 3).
    long : LongPictures
    timings : list of Timings
    by_cpu : bool
        Whether the undisturbed times are CPU times divided by the cores.
    """

    tiles: SpreadTiles
    samples: tuple[int, int]
    seeds: int
    pixels: list[list[NDArray[np.float32]]]
    long: LongPictures
    timings: list[_Timings]
    by_cpu: bool


#
# Intervals of what is measured by a few independent repetitions: bootstrap over the seeds.
#
# The error of a picture is a mean over pairs of different seeds (a U-statistic), which is free of the noise of
# either: two independent pictures are never wrong in the same way by chance. Seeds are drawn anew, with all that was
# measured under them together; pairs of a seed with itself never count. With few seeds the percentiles of the
# bootstrap lie too close together, and are widened as those of a normal distribution would have to be to match
# Student's (T. C. Hesterberg, «What teachers should know about the bootstrap», The American Statistician 69, 2015).

_REPLICATES = 2000


def draws(seeds: int, rng: np.random.Generator, replicates: int = _REPLICATES) -> NDArray[np.int64]:
    """Return how often each seed is drawn, shape (replicates, seeds); at least two different ones each time."""
    counts: NDArray[np.int64] = rng.multinomial(seeds, np.full(seeds, 1 / seeds), size=replicates)
    several: NDArray[np.int64] = counts[(counts > 0).sum(axis=1) > 1]
    return several


def every_seed_once(seeds: int) -> NDArray[np.int64]:
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


def _over_seeds(values: Array, counts: NDArray[np.int64]) -> Array:
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


#
# How noise falls with the samples of a pixel: on a lattice faster than 1 / n, and not evenly.
#
# 2^k samples of an extensible lattice are a lattice themselves, and even. Any other number is made of such blocks, as
# 212 of 128, 64, 16 and 4. If their errors had nothing to do with each other, its noise would be the sum of theirs,
# each weighted by the square of its share of the samples; they balance each other in part, and halfway (in
# logarithms) to the line through the powers of two is where noise was found. Independent samples are no exception:
# both are the same.

INDEPENDENT = -1.0  # exponent for independent samples
SMOOTH = -1.5  # of lattices where nothing is rare
STEEPEST, FLATTEST = -2.5, -0.5  # exponents beyond which what was seen is chance
_UNEVENNESS = 0.3  # of the noise, for an exponent that is by 1 steeper than of independent samples
LEAST = 2.0**-20  # of a sample: what is left of a number that is taken apart
BLOCKS = 4  # that a number of samples is taken apart into, beside the rest
_HALVINGS = 8  # of a step, to find the fewest samples
STEPS = np.linspace(1.0, 2.0, 9)  # between powers of two, numbers of samples that are looked at


@dataclass(frozen=True)
class NoiseLaw:
    """relMSE of the noise over samples per pixel: where these are powers of two, exponentials that meet at two numbers.

    Attributes
    ----------
    samples : (float, float)
        Powers of two.
    noise : (value, value)
        At these; numbers, or arrays with a value for each replicate.
    before, beyond : value
        Exponents of the samples below the first number and above the second.
    """

    samples: tuple[float, float]
    noise: tuple[Any, Any]
    before: Any
    beyond: Any

    @property
    def between(self) -> Any:
        """Exponent of the samples between the two numbers."""
        first, last = self.noise
        with np.errstate(divide="ignore", invalid="ignore"):
            exponent = np.log(np.divide(last, first)) / np.log(self.samples[1] / self.samples[0])
        return np.clip(np.where(np.isfinite(exponent), exponent, INDEPENDENT), STEEPEST, FLATTEST)

    def after(self, samples: Any) -> Any:
        """Return the noise after any number of samples per pixel."""
        return np.sqrt(self.even(samples) * self.blocks(samples))

    def least(self, samples: Any) -> Any:
        """The least noise there may be, if blocks balance each other."""
        return np.minimum(self.even(samples), self.blocks(samples)) / self._unevenness

    def most(self, samples: Any) -> Any:
        """The most noise there may be, if they do not."""
        return np.maximum(self.even(samples), self.blocks(samples)) * self._unevenness

    @property
    def _unevenness(self) -> Any:
        """How much lattices of several sizes differ from the line through two of them, as a factor."""
        return 1 + _UNEVENNESS * np.maximum(INDEPENDENT - self.between, 0.0)

    @property
    def doubt(self) -> Any:
        """By what factor the noise may be off after a number of samples that was not rendered.

        Lattices of other sizes lie off the line through two of them, and numbers between powers of two halfway from it
        to what independent blocks would give, or on it. In 200 measurements of one scene intervals of the time to an
        error held the truth in 76 % without this.
        """
        steep = 2.0 + self.between
        between_powers = (2 / 3) ** steep + (1 / 3) ** steep  # of a number that is a block and its half
        return self._unevenness * np.sqrt(np.maximum(between_powers, 1.0))

    def blocks(self, samples: Any) -> Any:
        """Return the noise after any number of samples per pixel, if its blocks err independently."""
        rest = np.asarray(samples, np.float64)
        sum_of_blocks: Any = 0.0
        for _ in range(BLOCKS):
            block = np.exp2(np.floor(np.log2(np.maximum(rest, LEAST))))
            sum_of_blocks = sum_of_blocks + np.where(rest > LEAST, block**2 * self.even(block), 0.0)
            rest = np.maximum(rest - block, 0.0)
        sum_of_blocks = sum_of_blocks + np.where(rest > LEAST, rest**2 * self.even(np.maximum(rest, LEAST)), 0.0)
        return sum_of_blocks / np.square(samples)

    def even(self, samples: Any) -> Any:
        """Return the noise after a power of two of samples per pixel, or what lies on the line between them."""
        at, last = self.samples
        middle = self.noise[0] * (samples / at) ** np.where(samples < at, self.before, self.between)
        return np.where(samples > last, self.noise[1] * (samples / last) ** self.beyond, middle)

    def until(self, noise: Any) -> Any:
        """Return the samples per pixel after which the noise is what is given, above 0; 0 where there is none."""
        at, last = self.samples
        with np.errstate(divide="ignore", invalid="ignore"):
            middle = at * np.divide(noise, self.noise[0]) ** (
                1 / np.where(noise > self.noise[0], self.before, self.between)
            )
            even = np.where(noise < self.noise[1], last * np.divide(noise, self.noise[1]) ** (1 / self.beyond), middle)
            below = np.exp2(np.floor(np.log2(np.maximum(even, LEAST))))
        enough_samples = 2 * below
        for step in STEPS[-2::-1]:
            enough_samples = np.where(self.after(step * below) <= noise, step * below, enough_samples)
        short = enough_samples - (STEPS[1] - STEPS[0]) * below
        for _ in range(_HALVINGS):
            middle = (short + enough_samples) / 2
            enough = self.after(middle) <= noise
            short, enough_samples = np.where(enough, short, middle), np.where(enough, middle, enough_samples)
        return np.where((even > 0) & np.isfinite(even), enough_samples, even)


def noise_law(samples: tuple[int, int, int], noise: Array, fall: Array, before: Array) -> NoiseLaw:
    """Return the law of noise for each replicate, the first of which is the estimate.

    Beyond the most samples that were rendered noise may go on as it fell last, or as that of independent samples: the
    estimate is halfway. It may also begin to fall as on smooth pictures, where a lattice becomes fine enough to find
    what few samples met: the replicates lie all over. Those of different configurations have the same tiles and
    share, so that they can be compared.

    Parameters
    ----------
    samples
        Numbers of samples that were rendered, rising.
    noise
        After the middle one.
    fall : (2, tiles) array
        What it is in some tiles after the middle and after the last one.
    before
        Exponent between the first two.
    """
    rng = np.random.default_rng(len(noise))
    share = rng.random(len(noise))
    steepness = np.log(samples[2] / samples[1])
    left = np.clip(_remaining_noise(fall, len(noise), rng), np.exp(STEEPEST * steepness), np.exp(FLATTEST * steepness))
    law = NoiseLaw(samples[1:], (noise, noise * left), np.clip(before, STEEPEST, FLATTEST), INDEPENDENT)
    beyond = INDEPENDENT + share * (np.minimum(law.between, SMOOTH) - INDEPENDENT)
    beyond[0] = (INDEPENDENT + law.between[0]) / 2
    return NoiseLaw(law.samples, law.noise, law.before, beyond)


def _remaining_noise(fall: Array, replicates: int, rng: np.random.Generator) -> Array:
    """The share of the noise that is left: bootstrap over tiles, which counts both their noise and the choice of them.

    It is widened for few tiles, as `interval` does for few seeds.
    """
    tiles = fall.shape[1]
    if tiles < 2 or not fall.sum(axis=1).all():
        return np.ones(replicates)
    counts = rng.multinomial(tiles, np.full(tiles, 1 / tiles), size=replicates)
    counts[0] = 1
    before, after = counts @ fall[0], counts @ fall[1]
    least = LEAST * before[0], LEAST * after[0]  # where the tiles that were drawn have no noise
    left = np.maximum(after, least[1]) / np.maximum(before, least[0])
    wider = student_quantile(0.975, tiles - 1) / NormalDist().inv_cdf(0.975) * math.sqrt(tiles / (tiles - 1))
    return np.asarray(left[0] * (left / left[0]) ** wider)


#
# How pictures of one way to render differ from each other and from those of another, by pairs of seeds.
#
# The measure is relMSE, the mean over the picture of |x - r|^2 / (|r|^2 + (0.01 mean r)^2), with vectors of the three
# channels and |r|^2 averaged over the tile of 8 x 8 pixels: a pixel's own, known from few samples, would add as much
# noise as all that is measured. It comes from pictures of the reference under other seeds than the pair's.

EDGE = 0.01  # of the mean: what keeps dark pixels from counting beyond measure


@dataclass(frozen=True)
class PairErrors:
    """The results of every pair of seeds for one configuration; matrices (seeds, seeds) with nothing on the diagonal.

    Attributes
    ----------
    bias : array
        Products of differences from the reference: their mean is the square of the bias, as relMSE.
    noise : tuple of array
        Half the squared difference of two pictures, for each number of samples: its mean is the noise of one.
    brightness : (seeds,) array
        Mean of the picture.
    by_tile : (tiles,) array
        The mean of `bias` in each tile.
    noise_of_tiles : (tiles,) array
        Standard error of `by_tile`, as it is where nothing but noise is measured.
    evenness : float
        Square of the picture's mean over the mean of what squares are relative to: what relMSE a picture has at least
        that is too bright by one on the whole (Cauchy and Schwarz).
    weight_variances : dict
        Variances that the means of `bias` and of the last of `noise` have besides, because the reference that they are
        relative to is known from few seeds itself.
    fall : (2, m) array
        Noise in some of the tiles: with the most samples that all were rendered with, and with many.
    tile_errors : dict
        Standard errors of the means of `bias`, of the last of `noise`, and of `brightness` relative to the reference's,
        that come from rendering some of the tiles only. Cells of a grid are taken for a random sample, which makes them
        too large rather than too small.
    """

    bias: Array
    noise: tuple[Array, ...]
    brightness: Array
    by_tile: Array
    noise_of_tiles: Array
    evenness: float
    weight_variances: dict[str, float]
    tile_errors: dict[str, float]
    fall: Array


class _Scales:
    """What squared differences in each tile are divided by, from the pictures of the reference under some seeds."""

    def __init__(self, reference: Array, tiles: SpreadTiles) -> None:
        self.seeds, self._tiles = len(reference), tiles
        self.shares = _sums(np.ones(len(tiles.pixels)), tiles)
        self._pictures, self._total = reference, reference.sum(axis=0)
        self._squares = np.mean(reference**2, axis=2)
        self._all_squares = self._squares.sum(axis=0)
        self._edge = EDGE * float(tiles.weights @ self._total.mean(axis=1)) / self.seeds

    def without(self, *left_out: int) -> Array:
        """Return |r|^2 + (0.01 mean r)^2 of each tile from the other seeds: over pairs, without the noise of either."""
        total, squares, count = self._total, self._all_squares, self.seeds - len(left_out)
        for seed in left_out:
            total, squares = total - self._pictures[seed], squares - self._squares[seed]
        squares_of_mean = (np.mean(total**2, axis=1) - squares) / (count * (count - 1))
        return np.asarray(np.maximum(_sums(squares_of_mean, self._tiles) / self.shares, 0.0) + self._edge**2)


def pair_errors(
    pictures: list[list[NDArray[np.float32]]], samples: tuple[int, ...], tiles: SpreadTiles, long: LongPictures
) -> list[PairErrors]:
    """Return the errors of every configuration; the first is the reference.

    Parameters
    ----------
    pictures
        For each configuration and number of samples, pixels (seeds, p, 3).
    samples
        The numbers of samples per pixel.
    tiles
        Where the pixels are.
    long
        Pictures of more samples.
    """
    part = np.array(samples) / sum(samples)
    means = [
        np.asarray(np.sum([share * stack for share, stack in zip(part, own, strict=True)], axis=0, dtype=np.float64))
        for own in pictures
    ]
    scales = _Scales(means[0], tiles)
    light = [_sums(mean.mean(axis=(0, 2)), tiles) for mean in means]
    few = tiles.some(long.chosen)
    errors_of_all = []
    for own, more, mean, lit in zip(pictures, long.pixels, means, light, strict=True):
        away = _by_pair(mean - means[0], tiles, _product)
        noises = [_by_pair(stack, tiles, _half_square) for stack in own]
        bias, last = _over_tiles(away, scales), _over_tiles(noises[-1], scales)
        by_tile = {"bias": _mean_of_pairs(away, scales), "noise": _mean_of_pairs(noises[-1], scales)}
        errors = {name: _sampling_error(sums, scales.shares, tiles.all) for name, sums in by_tile.items()}
        errors_of_all.append(
            PairErrors(
                bias=bias,
                noise=(*(_over_tiles(noise, scales) for noise in noises[:-1]), last),
                brightness=mean.mean(axis=2) @ tiles.weights,
                by_tile=by_tile["bias"] / scales.shares,
                noise_of_tiles=_noise_of_tiles(away, scales) / scales.shares,
                evenness=float(lit.sum()) ** 2 / float(scales.shares @ scales.without()),
                weight_variances={
                    "bias": _weight_variance(away, bias, scales),
                    "noise": _weight_variance(noises[-1], last, scales),
                },
                tile_errors=errors | {"energy": _ratio_error(lit, light[0], scales.shares, tiles.all)},
                fall=_fall(by_tile["noise"][long.chosen], _by_pair(more, few, _half_square), scales, long.chosen),
            )
        )
    return errors_of_all


def _fall(noise: Array, sums: Array, scales: _Scales, chosen: NDArray[np.int64]) -> Array:
    """Return the noise of some tiles beside that in pictures of more samples."""
    seeds = len(sums)
    return np.stack([noise, sums.sum(axis=(0, 1)) / (seeds * (seeds - 1)) / scales.without()[chosen]])


def _product(first: Array, second: Array) -> Array:
    return np.asarray(np.mean(first * second, axis=1))


def _half_square(first: Array, second: Array) -> Array:
    return np.asarray(np.mean(np.square(first.astype(np.float64) - second), axis=1) / 2)


def _by_pair(values: Any, tiles: SpreadTiles, together: Callable[[Array, Array], Array]) -> Array:
    """Return sums over each tile, shape (seeds, seeds, tiles), of what two pictures of different seeds give."""
    seeds = len(values)
    sums = np.zeros((seeds, seeds, len(tiles.tiles)))
    for s, t in combinations(range(seeds), 2):
        sums[s, t] = sums[t, s] = _sums(together(values[s], values[t]), tiles)
    return sums


def _over_tiles(sums: Array, scales: _Scales) -> Array:
    """Return the matrix (seeds, seeds) of sums over tiles, relative to the reference under other seeds."""
    matrix = np.zeros((scales.seeds, scales.seeds))
    for s, t in combinations(range(scales.seeds), 2):
        matrix[s, t] = matrix[t, s] = float(np.sum(sums[s, t] / scales.without(s, t)))
    return matrix


def _mean_of_pairs(sums: Array, scales: _Scales) -> Array:
    """Return the mean over pairs in each tile, relative to the reference under all seeds."""
    return np.asarray(sums.sum(axis=(0, 1)) / (scales.seeds * (scales.seeds - 1)) / scales.without())


def _noise_of_tiles(sums: Array, scales: _Scales) -> Array:
    """Return the standard error of `_mean_of_pairs`, all pairs being independent, as of pure noise they are."""
    first, second = np.triu_indices(scales.seeds, 1)
    return np.asarray(sums[first, second].std(axis=0) / math.sqrt(len(first)) / scales.without())


def _weight_variance(sums: Array, matrix: Array, scales: _Scales) -> float:
    """Return by how much the variance (jackknife over seeds) grows when what tiles are divided by is found anew."""
    seeds = scales.seeds
    pairs = (seeds - 1) * (seeds - 2)
    all_sums, all_pairs = sums.sum(axis=(0, 1)), matrix.sum()
    anew = [float(np.sum((all_sums - 2 * sums[s].sum(axis=0)) / scales.without(s))) / pairs for s in range(seeds)]
    kept = [(all_pairs - 2 * matrix[s].sum()) / pairs for s in range(seeds)]
    return float(max(np.var(anew) - np.var(kept), 0.0) * (seeds - 1))


def _sums(values: Array, tiles: SpreadTiles) -> Array:
    """Return the weighted sums of pixels (p,) in each tile."""
    return np.asarray(np.bincount(tiles.cell, tiles.weights * values, len(tiles.tiles)), np.float64)


def _sampling_error(sums: Array, shares: Array, all_tiles: int) -> float:
    """Return the standard error of the sum over tiles that are some of all, each of a share of the picture."""
    n = len(sums)
    if n < 2:
        return 0.0
    apart = sums - shares * sums.sum()
    return float(np.sqrt((1 - n / all_tiles) * n / (n - 1) * (apart @ apart)))


def _ratio_error(sums: Array, reference: Array, shares: Array, all_tiles: int) -> float:
    """Return the standard error of the ratio of two sums over tiles."""
    whole = float(reference.sum())
    ratio = float(sums.sum()) / whole
    return _sampling_error(sums - ratio * reference, shares, all_tiles) / abs(whole)


# What is said of each configuration: rates, bias and times, with intervals.

SURE = 4.0  # standard errors above which a difference counts as certain: the bias of a tile, that of the brightness
_LEAST_NOISE = 1e-6  # of the estimate: what draws of the seeds count in which pictures happen to be the same
RARE = 2.0  # times the lower end of the noise's interval that the upper is, where few paths make most of it
SLOW = -0.95  # exponent of the noise over the samples: more would be slower than independent samples
_QUANTILE_STEPS = 121
TIMES = np.geomspace(1e-4, 1e8, _QUANTILE_STEPS)  # at which errors are compared [s]
TARGETS = (0.02, 0.01)  # relative errors (root of relMSE) for which times are reported


@dataclass(frozen=True)
class MeasuredVariant:
    """One configuration. Times are for the whole picture on an idle device, unless stated otherwise.

    Attributes
    ----------
    name, knob : str
        As in `Variant`.
    same_as, settings : tuple of str
    tier : str
    unbiased : bool
    start_s : float
        From the scene to the first ray [s].
    sample_s, wall_sample_s : Interval
        Time of one sample per pixel [s], and that by the clock.
    samples : (int, int)
        Numbers of samples per pixel that the noise was measured with.
    noise : (Interval, Interval)
        relMSE of the noise after these.
    before, slope, beyond : Interval
        Exponents of the noise over the samples: below the first number, between them, and what may be beyond the
        second; -1 for independent samples.
    rate : Interval
        relMSE of the noise after a second.
    bias : Interval
        The relMSE that no time removes, against the most accurate configuration.
    energy : Interval
        Relative error of the mean of the picture.
    seconds_to : dict
        Time to each of `TARGETS` [s], at least that of one sample per pixel; infinite where the bias forbids it.
    better_until : Interval
        Time until which it errs less than the most accurate configuration [s]; 0 never, infinite always.
    gain : Interval
        How many times its noise (relMSE) the most accurate configuration has after a second, found by the same seeds.
    bias_of_tiles : (tiles,) array
        relMSE of the bias in each rendered tile.
    noise_of_tiles : (tiles,) array
        Standard error that noise alone gives it.
    odds : (times,) array
        Share of the draws of the seeds by which it errs less than the most accurate configuration, after each of
        `TIMES`; empty where that was not drawn.
    """

    name: str
    knob: str
    same_as: tuple[str, ...]
    settings: tuple[str, ...]
    tier: str
    unbiased: bool
    start_s: float
    sample_s: Interval
    wall_sample_s: Interval
    samples: tuple[int, int]
    noise: tuple[Interval, Interval]
    before: Interval
    slope: Interval
    beyond: Interval
    rate: Interval
    bias: Interval
    energy: Interval
    seconds_to: dict[float, Interval]
    better_until: Interval
    gain: Interval
    bias_of_tiles: Array
    noise_of_tiles: Array
    odds: Array = field(default_factory=lambda: np.empty(0))

    def odds_after(self, seconds: float) -> float | None:
        """Return how probable it is that it errs less than the most accurate configuration after a time [s]."""
        return float(np.interp(np.log(seconds), np.log(TIMES), self.odds)) if len(self.odds) else None

    @property
    def sure_bias_of_tiles(self) -> Array:
        """The bias of tiles where it is larger than noise explains, and 0 elsewhere."""
        return np.where(self.bias_of_tiles > SURE * self.noise_of_tiles, self.bias_of_tiles, 0.0)

    def bias_at(self, end: str) -> float:
        """Return the bias as relMSE, ``low``, ``value`` or ``high`` of its interval; 0 where there can be none."""
        return 0.0 if self.unbiased or not self.knob else max(float(getattr(self.bias, end)), 0.0)

    @property
    def has_rare_paths(self) -> bool:
        """Whether the noise comes from paths so rare that its size is uncertain."""
        return self.noise[1].high > RARE * self.noise[1].low or self.slope.low > SLOW

    def error_after(self, seconds: float, end: str = "high") -> float:
        """Return the relative error (root of relMSE) after a time, with the bias at an end of its interval.

        Infinite where the time is not enough for a sample in every pixel.
        """
        if seconds < self.sample_s.value:
            return math.inf
        return math.sqrt(self.bias_at(end) + self.noise_after(seconds))

    def errors_after(self, seconds: float) -> tuple[float, float]:
        """Return the least and the largest relative error after a time that the intervals of noise and bias allow."""
        samples = seconds / self.sample_s.value
        low, high = float(self.law("low").least(samples)), float(self.law("high").most(samples))
        return math.sqrt(self.bias_at("low") + low), math.sqrt(self.bias_at("high") + high)

    def noise_after(self, seconds: float) -> float:
        """Return the noise after a time as relMSE."""
        return float(self.law().after(seconds / self.sample_s.value))

    def law(self, end: str = "value") -> NoiseLaw:
        """Return how the noise falls, or with all of it at one end of its interval."""
        first, last, before, beyond = (getattr(x, end) for x in (*self.noise, self.before, self.beyond))
        return NoiseLaw(self.samples, (first, last), before, beyond)

    def seconds_until(self, error: float, end: str = "high") -> float:
        """Return the time to a relative error [s], with the bias at an end of its interval; infinite means never."""
        left = error**2 - self.bias_at(end)
        return max(float(self.law().until(left)), 1.0) * self.sample_s.value if left > 0 else math.inf


@dataclass(frozen=True)
class _Replicates:
    """Cost and error of one configuration for each draw of the seeds; the first draw has each seed once."""

    sample_s: Array
    law: NoiseLaw
    bias: Array

    @property
    def rate(self) -> Array:
        return np.asarray(self.law.after(1.0 / self.sample_s))

    def even_after(self, seconds: Any) -> Array:
        return np.asarray(self.law.even(seconds / self.sample_s))


def measurements(
    named: list[dict[str, Any]],
    errors: list[PairErrors],
    timings: list[_Timings],
    samples: tuple[int, int, int],
    counts: NDArray[np.int64],
) -> list[MeasuredVariant]:
    """Return the measurement of every configuration, the reference first.

    Parameters
    ----------
    named
        Attributes of each that are not measured, by their names.
    errors, timings
        What was measured.
    samples
        Numbers of samples per pixel of the pictures, and of the long ones.
    counts
        Draws of the seeds, by `draws`.
    """
    seeds = counts.shape[1]
    counts = np.concatenate([every_seed_once(seeds), counts])  # the first row gives the estimates
    sources = []
    for names, error, times in zip(named, errors, timings, strict=True):
        law = noise_law(samples, _noise(error, counts), error.fall, _slope(error, samples, counts))
        exact = names["unbiased"] or not names["knob"]
        bias = np.zeros(len(counts)) if exact else _bias(error, errors[0], counts)
        sample_s = median_over_seeds(times[0], counts)
        sources.append(_Replicates(sample_s, law, bias))
    results = []
    for names, error, times, own in zip(named, errors, timings, sources, strict=True):
        values = {
            "sample_s": own.sample_s,
            "wall_sample_s": median_over_seeds(times[1], counts),
            "first": own.law.noise[0],
            "last": own.law.noise[1],
            "before": own.law.before,
            "slope": own.law.between,
            "beyond": own.law.beyond,
            "rate": own.rate,
            "bias": _bias(error, errors[0], counts),
            "energy": _energy(error, errors[0], counts),
            "better_until": _better_until(own, sources[0]),
            "gain": _gain(own, sources[0]),
        }
        intervals: dict[str, Any] = {name: interval(rows[0], rows[1:], seeds) for name, rows in values.items()}
        noise = (intervals.pop("first"), intervals.pop("last"))
        reached = ((target, _time_to(own, target)) for target in TARGETS)
        to = {target: interval(rows[0], rows[1:], seeds) for target, rows in reached}
        tiles: dict[str, Any] = {"bias_of_tiles": error.by_tile, "noise_of_tiles": error.noise_of_tiles}
        tiles["odds"] = (_gains(own, sources[0])[:, 1:] > 0).mean(axis=1)
        results.append(MeasuredVariant(**names, **intervals, **tiles, samples=samples[1:], noise=noise, seconds_to=to))
    return results


def _bias(error: PairErrors, reference: PairErrors, counts: NDArray[np.int64]) -> Array:
    """Return the bias; a certain difference in the brightness of the whole picture is its lower limit.

    Light that few paths bring, each to a pixel of its own, is missing in no pixel of two pictures, but in their means.
    """
    values = over_pairs(error.bias, counts)
    own = math.sqrt(error_over_pairs(error.bias) ** 2 + error.weight_variances["bias"])
    values = spread_about(values[0], values, max(own, error.tile_errors["bias"]))
    energy = _energy(error, reference, counts)
    if abs(energy[0]) <= SURE * float(energy.std()):
        return values
    return np.maximum(values, reference.evenness * energy**2)


def _noise(error: PairErrors, counts: NDArray[np.int64]) -> Array:
    """Return the noise of a picture, spread by its logarithm, as it is above 0; nothing where pictures are the same."""
    values = over_pairs(error.noise[-1], counts)
    if not values[0] > 0:
        return np.zeros_like(values)
    values = np.maximum(values, _LEAST_NOISE * values[0])
    own = math.sqrt(float(values.var()) + error.weight_variances["noise"])
    spread = max(own, error.tile_errors["noise"]) / values[0]
    return np.asarray(values[0] * np.exp(spread_about(0.0, np.log(values / values[0]), spread)))


def _energy(error: PairErrors, reference: PairErrors, counts: NDArray[np.int64]) -> Array:
    values = _over_seeds(error.brightness, counts) / _over_seeds(reference.brightness, counts) - 1
    return spread_about(values[0], values, max(float(values.std()), error.tile_errors["energy"]))


def _slope(error: PairErrors, samples: tuple[int, ...], counts: NDArray[np.int64]) -> Array:
    first, last = (
        over_pairs(error.noise[0], counts),
        over_pairs(error.noise[-1], counts),
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        exponents = np.log(last / first) / np.log(samples[1] / samples[0])
    return np.where(np.isfinite(exponents), exponents, INDEPENDENT)


def _time_to(own: _Replicates, target: float) -> Array:
    left = target**2 - np.maximum(own.bias, 0.0)
    off = np.random.default_rng(len(left)).uniform(-1.0, 1.0, len(left))
    off[0] = 0.0  # the estimate
    samples = own.law.until(np.where(left > 0, left * own.law.doubt**off, np.inf))
    return np.where(left > 0, np.maximum(samples, 1.0) * own.sample_s, np.inf)


def _gain(own: _Replicates, reference: _Replicates) -> Array:
    """Return how many times its noise the reference has; how many times its time of a sample where neither has any."""
    even = np.where(reference.rate > 0, np.inf, reference.sample_s / own.sample_s)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(own.rate > 0, reference.rate / own.rate, even)


def _gains(own: _Replicates, reference: _Replicates) -> Array:
    """Return the logarithm of how many times its error (relMSE) the reference has: a row for each of `TIMES`."""
    bias, times = np.maximum(own.bias, 0.0), TIMES[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.log(reference.even_after(times) / (own.even_after(times) + bias)))


def _better_until(own: _Replicates, reference: _Replicates) -> Array:
    """Return the last time at which it errs less than the reference: 0 for never, infinite for always."""
    gains, times = _gains(own, reference), TIMES
    better = gains > 0
    last = _QUANTILE_STEPS - 1 - better[::-1].argmax(axis=0)
    after = np.minimum(last + 1, _QUANTILE_STEPS - 1)
    place = np.arange(gains.shape[1])
    here, there = gains[last, place], gains[after, place]
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = times[last] * (times[1] / times[0]) ** (here / (here - there))
    last_times = np.where(last == _QUANTILE_STEPS - 1, np.inf, crossing)
    return np.where(better.any(axis=0), last_times, 0.0)
