"""What is said of each configuration: rates, bias and times, with intervals."""

from __future__ import annotations

import math
from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.tradeoff.errors import PairErrors
from rptcam_cl.tradeoff.noise import INDEPENDENT, NoiseLaw, noise_law
from rptcam_cl.tradeoff.statistics import (
    Interval,
    error_over_pairs,
    interval,
    median_over_seeds,
    once,
    over_pairs,
    over_seeds,
    spread_about,
)

Array = NDArray[np.float64]

SURE = 4.0  # standard errors above which a difference counts as certain: the bias of a tile, that of the brightness
LEAST_NOISE = 1e-6  # of the estimate: what draws of the seeds count in which pictures happen to be the same
RARE = 2.0  # times the lower end of the noise's interval that the upper is, where few paths make most of it
SLOW = -0.95  # exponent of the noise over the samples: more would be slower than independent samples
STEPS = 121
TIMES = np.geomspace(1e-4, 1e8, STEPS)  # at which errors are compared [s]
TARGETS = (0.02, 0.01)  # relative errors (root of relMSE) for which times are reported


@dataclass(frozen=True)
class Timings:
    """Times of one configuration, per sample per pixel of the whole picture, one for each seed [s].

    Attributes
    ----------
    undisturbed : (seeds,) array
        With the device to itself: on a processor the CPU time of all threads divided by the cores, else by the clock.
    wall : (seeds,) array
        By the clock.
    """

    undisturbed: Array
    wall: Array


@dataclass(frozen=True)
class Measurement:
    """One configuration. Times are for the whole picture on an idle device, unless stated otherwise.

    Attributes
    ----------
    name, knob : str
        As in `ladder.Configuration`.
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

    @property
    def sure_bias(self) -> float:
        """The upper end of the interval of the bias, as relMSE; 0 where there can be none."""
        return 0.0 if self.unbiased or not self.knob else max(self.bias.high, 0.0)

    @property
    def likely_bias(self) -> float:
        """The measured bias, as relMSE; 0 where there can be none."""
        return 0.0 if self.unbiased or not self.knob else max(self.bias.value, 0.0)

    @property
    def has_rare_paths(self) -> bool:
        """Whether the noise comes from paths so rare that its size is uncertain."""
        return self.noise[1].high > RARE * self.noise[1].low or self.slope.low > SLOW

    def error_after(self, seconds: float, bias: float | None = None) -> float:
        """Return the relative error (root of relMSE) after a time, with a bias or the most that it may be.

        Infinite where the time is not enough for a sample in every pixel.
        """
        if seconds < self.sample_s.value:
            return math.inf
        return math.sqrt((self.sure_bias if bias is None else bias) + self.noise_after(seconds))

    def errors_after(self, seconds: float) -> tuple[float, float]:
        """Return the least and the largest relative error after a time that the intervals of noise and bias allow."""
        least = 0.0 if self.unbiased or not self.knob else max(self.bias.low, 0.0)
        samples = seconds / self.sample_s.value
        low, high = float(self.law("low").least(samples)), float(self.law("high").most(samples))
        return math.sqrt(least + low), math.sqrt(self.sure_bias + high)

    def noise_after(self, seconds: float) -> float:
        """Return the noise after a time as relMSE."""
        return float(self.law().after(seconds / self.sample_s.value))

    def law(self, end: str = "value") -> NoiseLaw:
        """Return how the noise falls, or with all of it at one end of its interval."""
        first, last, before, beyond = (getattr(x, end) for x in (*self.noise, self.before, self.beyond))
        return NoiseLaw(self.samples, (first, last), before, beyond)

    def seconds_until(self, error: float, bias: float | None = None) -> float:
        """Return the time to a relative error [s], with a bias or the most that it may be; infinite means never."""
        left = error**2 - (self.sure_bias if bias is None else bias)
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
    timings: list[Timings],
    samples: tuple[int, int, int],
    counts: NDArray[np.int64],
) -> list[Measurement]:
    """Return the measurement of every configuration, the reference first.

    Parameters
    ----------
    named
        The first seven attributes of each.
    errors, timings
        What was measured.
    samples
        Numbers of samples per pixel of the pictures, and of the long ones.
    counts
        Draws of the seeds, by `statistics.draws`.
    """
    seeds = counts.shape[1]
    counts = np.concatenate([once(seeds), counts])  # the first row gives the estimates
    sources = []
    for names, error, times in zip(named, errors, timings, strict=True):
        law = noise_law(samples, _noise(error, counts), error.fall, _slope(error, samples, counts))
        exact = names["unbiased"] or not names["knob"]
        bias = np.zeros(len(counts)) if exact else _bias(error, errors[0], counts)
        sample_s = median_over_seeds(times.undisturbed, counts)
        sources.append(_Replicates(sample_s, law, bias))
    found = []
    for names, error, times, own in zip(named, errors, timings, sources, strict=True):
        values = {
            "sample_s": own.sample_s,
            "wall_sample_s": median_over_seeds(times.wall, counts),
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
        reached = {target: _time_to(own, target) for target in TARGETS}
        to: dict[float, Interval] = {target: interval(rows[0], rows[1:], seeds) for target, rows in reached.items()}
        tiles: dict[str, Any] = {"bias_of_tiles": error.by_tile, "noise_of_tiles": error.noise_of_tiles}
        tiles["odds"] = (_gains(own, sources[0])[:, 1:] > 0).mean(axis=1)
        found.append(Measurement(**names, **intervals, **tiles, samples=samples[1:], noise=noise, seconds_to=to))
    return found


def _bias(error: PairErrors, reference: PairErrors, counts: NDArray[np.int64]) -> Array:
    """Return the bias; a certain difference in the brightness of the whole picture is its lower limit.

    Light that few paths bring, each to a pixel of its own, is missing in no pixel of two pictures, but in their means.
    """
    found = over_pairs(error.bias, counts)
    own = math.sqrt(error_over_pairs(error.bias) ** 2 + error.weight_variances["bias"])
    found = spread_about(found[0], found, max(own, error.tile_errors["bias"]))
    energy = _energy(error, reference, counts)
    if abs(energy[0]) <= SURE * float(energy.std()):
        return found
    return np.maximum(found, reference.evenness * energy**2)


def _noise(error: PairErrors, counts: NDArray[np.int64]) -> Array:
    """Return the noise of a picture, spread by its logarithm, as it is above 0; nothing where pictures are the same."""
    found = over_pairs(error.noise[-1], counts)
    if not found[0] > 0:
        return np.zeros_like(found)
    found = np.maximum(found, LEAST_NOISE * found[0])
    own = math.sqrt(float(found.var()) + error.weight_variances["noise"])
    spread = max(own, error.tile_errors["noise"]) / found[0]
    return np.asarray(found[0] * np.exp(spread_about(0.0, np.log(found / found[0]), spread)))


def _energy(error: PairErrors, reference: PairErrors, counts: NDArray[np.int64]) -> Array:
    found = over_seeds(error.brightness, counts) / over_seeds(reference.brightness, counts) - 1
    return spread_about(found[0], found, max(float(found.std()), error.tile_errors["energy"]))


def _slope(error: PairErrors, samples: tuple[int, ...], counts: NDArray[np.int64]) -> Array:
    first, last = over_pairs(error.noise[0], counts), over_pairs(error.noise[-1], counts)
    with np.errstate(divide="ignore", invalid="ignore"):
        found = np.log(last / first) / np.log(samples[1] / samples[0])
    return np.where(np.isfinite(found), found, INDEPENDENT)


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
    last = STEPS - 1 - better[::-1].argmax(axis=0)
    after = np.minimum(last + 1, STEPS - 1)
    place = np.arange(gains.shape[1])
    here, there = gains[last, place], gains[after, place]
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = times[last] * (times[1] / times[0]) ** (here / (here - there))
    found = np.where(last == STEPS - 1, np.inf, crossing)
    return np.where(better.any(axis=0), found, 0.0)
