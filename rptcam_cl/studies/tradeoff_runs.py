"""Short renders of every configuration by turns, how many fit the time, and what is said of each."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import DeviceError, InputError
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.account import truncation
from rptcam_cl.rendering.film import TILE_PIXELS, FilmLayout
from rptcam_cl.rendering.highlights import aimed_plan
from rptcam_cl.rendering.passes import check_precision
from rptcam_cl.rendering.plan.plan import Plan, make_plan
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.film import RenderSettings
from rptcam_cl.studies import tradeoff_errors

# What is said of each configuration: rates, bias and times, with intervals.

Array = NDArray[np.float64]

SURE = 4.0  # standard errors above which a difference counts as certain: the bias of a tile, that of the brightness
LEAST_NOISE = 1e-6  # of the estimate: what draws of the seeds count in which pictures happen to be the same
RARE = 2.0  # times the lower end of the noise's interval that the upper is, where few paths make most of it
SLOW = -0.95  # exponent of the noise over the samples: more would be slower than independent samples
QUANTILE_STEPS = 121
TIMES = np.geomspace(1e-4, 1e8, QUANTILE_STEPS)  # at which errors are compared [s]
TARGETS = (0.02, 0.01)  # relative errors (root of relMSE) for which times are reported


Timings = tuple[Array, Array]
"""Times of one configuration, per sample per pixel of the whole picture, one for each seed [s].

With the device to itself: on a processor the CPU time of all threads divided by the cores, else by the clock. Then the
time by the clock.
"""


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
    sample_s: tradeoff_errors.Interval
    wall_sample_s: tradeoff_errors.Interval
    samples: tuple[int, int]
    noise: tuple[tradeoff_errors.Interval, tradeoff_errors.Interval]
    before: tradeoff_errors.Interval
    slope: tradeoff_errors.Interval
    beyond: tradeoff_errors.Interval
    rate: tradeoff_errors.Interval
    bias: tradeoff_errors.Interval
    energy: tradeoff_errors.Interval
    seconds_to: dict[float, tradeoff_errors.Interval]
    better_until: tradeoff_errors.Interval
    gain: tradeoff_errors.Interval
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

    def law(self, end: str = "value") -> tradeoff_errors.NoiseLaw:
        """Return how the noise falls, or with all of it at one end of its interval."""
        first, last, before, beyond = (getattr(x, end) for x in (*self.noise, self.before, self.beyond))
        return tradeoff_errors.NoiseLaw(self.samples, (first, last), before, beyond)

    def seconds_until(self, error: float, end: str = "high") -> float:
        """Return the time to a relative error [s], with the bias at an end of its interval; infinite means never."""
        left = error**2 - self.bias_at(end)
        return max(float(self.law().until(left)), 1.0) * self.sample_s.value if left > 0 else math.inf


@dataclass(frozen=True)
class _Replicates:
    """Cost and error of one configuration for each draw of the seeds; the first draw has each seed once."""

    sample_s: Array
    law: tradeoff_errors.NoiseLaw
    bias: Array

    @property
    def rate(self) -> Array:
        return np.asarray(self.law.after(1.0 / self.sample_s))

    def even_after(self, seconds: Any) -> Array:
        return np.asarray(self.law.even(seconds / self.sample_s))


def measurements(
    named: list[dict[str, Any]],
    errors: list[tradeoff_errors.PairErrors],
    timings: list[Timings],
    samples: tuple[int, int, int],
    counts: NDArray[np.int64],
) -> list[Measurement]:
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
        Draws of the seeds, by `statistics.draws`.
    """
    seeds = counts.shape[1]
    counts = np.concatenate([tradeoff_errors.every_seed_once(seeds), counts])  # the first row gives the estimates
    sources = []
    for names, error, times in zip(named, errors, timings, strict=True):
        law = tradeoff_errors.noise_law(samples, _noise(error, counts), error.fall, _slope(error, samples, counts))
        exact = names["unbiased"] or not names["knob"]
        bias = np.zeros(len(counts)) if exact else _bias(error, errors[0], counts)
        sample_s = tradeoff_errors.median_over_seeds(times[0], counts)
        sources.append(_Replicates(sample_s, law, bias))
    results = []
    for names, error, times, own in zip(named, errors, timings, sources, strict=True):
        values = {
            "sample_s": own.sample_s,
            "wall_sample_s": tradeoff_errors.median_over_seeds(times[1], counts),
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
        intervals: dict[str, Any] = {
            name: tradeoff_errors.interval(rows[0], rows[1:], seeds) for name, rows in values.items()
        }
        noise = (intervals.pop("first"), intervals.pop("last"))
        reached = {target: _time_to(own, target) for target in TARGETS}
        to: dict[float, tradeoff_errors.Interval] = {
            target: tradeoff_errors.interval(rows[0], rows[1:], seeds) for target, rows in reached.items()
        }
        tiles: dict[str, Any] = {"bias_of_tiles": error.by_tile, "noise_of_tiles": error.noise_of_tiles}
        tiles["odds"] = (_gains(own, sources[0])[:, 1:] > 0).mean(axis=1)
        results.append(Measurement(**names, **intervals, **tiles, samples=samples[1:], noise=noise, seconds_to=to))
    return results


def _bias(error: tradeoff_errors.PairErrors, reference: tradeoff_errors.PairErrors, counts: NDArray[np.int64]) -> Array:
    """Return the bias; a certain difference in the brightness of the whole picture is its lower limit.

    Light that few paths bring, each to a pixel of its own, is missing in no pixel of two pictures, but in their means.
    """
    values = tradeoff_errors.over_pairs(error.bias, counts)
    own = math.sqrt(tradeoff_errors.error_over_pairs(error.bias) ** 2 + error.weight_variances["bias"])
    values = tradeoff_errors.spread_about(values[0], values, max(own, error.tile_errors["bias"]))
    energy = _energy(error, reference, counts)
    if abs(energy[0]) <= SURE * float(energy.std()):
        return values
    return np.maximum(values, reference.evenness * energy**2)


def _noise(error: tradeoff_errors.PairErrors, counts: NDArray[np.int64]) -> Array:
    """Return the noise of a picture, spread by its logarithm, as it is above 0; nothing where pictures are the same."""
    values = tradeoff_errors.over_pairs(error.noise[-1], counts)
    if not values[0] > 0:
        return np.zeros_like(values)
    values = np.maximum(values, LEAST_NOISE * values[0])
    own = math.sqrt(float(values.var()) + error.weight_variances["noise"])
    spread = max(own, error.tile_errors["noise"]) / values[0]
    return np.asarray(values[0] * np.exp(tradeoff_errors.spread_about(0.0, np.log(values / values[0]), spread)))


def _energy(
    error: tradeoff_errors.PairErrors, reference: tradeoff_errors.PairErrors, counts: NDArray[np.int64]
) -> Array:
    values = (
        tradeoff_errors.over_seeds(error.brightness, counts) / tradeoff_errors.over_seeds(reference.brightness, counts)
        - 1
    )
    return tradeoff_errors.spread_about(values[0], values, max(float(values.std()), error.tile_errors["energy"]))


def _slope(error: tradeoff_errors.PairErrors, samples: tuple[int, ...], counts: NDArray[np.int64]) -> Array:
    first, last = (
        tradeoff_errors.over_pairs(error.noise[0], counts),
        tradeoff_errors.over_pairs(error.noise[-1], counts),
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        exponents = np.log(last / first) / np.log(samples[1] / samples[0])
    return np.where(np.isfinite(exponents), exponents, tradeoff_errors.INDEPENDENT)


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
    last = QUANTILE_STEPS - 1 - better[::-1].argmax(axis=0)
    after = np.minimum(last + 1, QUANTILE_STEPS - 1)
    place = np.arange(gains.shape[1])
    here, there = gains[last, place], gains[after, place]
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = times[last] * (times[1] / times[0]) ** (here / (here - there))
    last_times = np.where(last == QUANTILE_STEPS - 1, np.inf, crossing)
    return np.where(better.any(axis=0), last_times, 0.0)


# Short renders of every configuration by turns, with what each took of the clock and of the processor.


@dataclass(frozen=True)
class Ready:
    """A configuration that is compiled.

    Attributes
    ----------
    configuration : Variant
    wavefront : Wavefront
    start_s : float
        Time from the scene to the first ray [s]; programs shared with an earlier configuration are there already.
    facts : dict
        What a picture's metadata would say of camera and spectrum.
    truncation : dict
        Bound on the light of longer paths, from `rendering.truncation`.
    """

    configuration: tradeoff_errors.Variant
    wavefront: Wavefront
    start_s: float
    facts: dict[str, Any]
    truncation: dict[str, Any]


def prepare(
    configurations: Sequence[tradeoff_errors.Variant], session: Session, on_step: Callable[[str, int], Any]
) -> tuple[list[Ready], dict[str, str]]:
    """Return the configurations that differ, compiled, and why others of them cannot be rendered, by name.

    Raises
    ------
    InputError
        When the first, which all others are measured against, cannot be.
    """
    seen: dict[bytes, int] = {}
    ready: list[Ready] = []
    skipped: dict[str, str] = {}
    for done, configuration in enumerate(configurations):
        on_step(configuration.name, done)
        begun = time.perf_counter()
        try:
            plan = make_plan(configuration.scene)
            check_precision(session, plan.camera)
        except (InputError, DeviceError) as problem:
            if not ready:
                raise
            skipped[configuration.name] = str(problem)
            continue
        known_as = mark(plan, configuration.scene.render)
        if known_as in seen:
            same = ready[seen[known_as]]
            known = same.configuration.with_name_of(configuration)
            ready[seen[known_as]] = replace(same, configuration=known)
            continue
        seen[known_as] = len(ready)
        layout, settings = FilmLayout.of(configuration.scene.film), configuration.scene.render
        plan, buffers = aimed_plan(plan, session, settings.layers)
        wavefront = Wavefront(session, plan, layout, settings, buffers=buffers)
        wavefront.warm_up()
        facts = plan.camera.metadata | plan.spectrum.metadata
        rest = truncation(plan.albedo, configuration.scene.render.max_depth)
        ready.append(Ready(configuration, wavefront, time.perf_counter() - begun, facts, rest))
    return ready, skipped


def mark(plan: Plan, settings: RenderSettings) -> bytes:
    """Identify the picture that a configuration renders: two with the same mark render the same."""
    camera = plan.camera
    arrays = (camera.record, camera.tables, camera.surfaces, camera.stop, plan.spectrum.table)
    words = (camera.kernel, sorted(camera.facts.items()), sorted(plan.facts.items()), settings.max_depth)
    return repr((words, settings.roulette_depth)).encode() + b"".join(array.tobytes() for array in arrays)


def run(
    ready: Ready, tiles: tradeoff_errors.SpreadTiles, samples: int, seed: int
) -> tuple[NDArray[np.float32], float, float]:
    """Render the tiles once.

    Returns
    -------
    pixels : (p, 3) array
    wall_s, cpu_s : float
        Time of the clock, and of all threads of the process [s].
    """
    wavefront = ready.wavefront
    wavefront.choose_tiles(tiles.tiles)
    wavefront.clear()
    wavefront.seed = seed
    wavefront.session.finish()
    wall, cpu = time.perf_counter(), time.process_time()
    for wave in wavefront.waves(0, samples):
        wavefront.enqueue(*wave)
    wavefront.finish()
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    sums = wavefront.sums()[:, tiles.pixels].astype(np.float64)
    mean = (sums[:3] - sums[3:]).T / samples
    return mean.astype(np.float32), wall, cpu


def undisturbed_clock(device_type: str) -> Callable[[], float]:
    """Return a clock [s] that other work on the machine does not move: of a processor its time over all cores."""
    return (lambda: time.process_time() / cores()) if device_type == "cpu" else time.perf_counter


def cores() -> int:
    """Return how many processor cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


# How many tiles and samples fit the time, and the order of the renders: by turns, so that other work on the machine
# disturbs all configurations alike.

SEEDS, FEWEST_SEEDS = 8, 4
GROWTH = 4  # times the samples of the first picture that the second has
LONG_GROWTH, LONG_SEEDS, LONG_SHARE = 64, 2, 4  # times the samples of the first; pictures; one of so many tiles
FEWEST_LONG = 16  # tiles
PILOT_TILES, PILOT_SAMPLES = 32, 4
FEWEST_TILES, MOST_TILES = 64, {"cpu": 512, "gpu": 4096}
WANTED_SAMPLES = 2  # of the first picture, before more tiles are taken
TILES_SEED = 5
_SHORT, _LONG = SEEDS * (1 + GROWTH), LONG_SEEDS * LONG_GROWTH / LONG_SHARE
LONG_TIME = _LONG / (_SHORT + _LONG)  # of all that is rendered


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

    tiles: tradeoff_errors.SpreadTiles
    samples: tuple[int, int]
    seeds: int
    pixels: list[list[NDArray[np.float32]]]
    long: tradeoff_errors.LongPictures
    timings: list[Timings]
    by_cpu: bool


def render_by_turns(
    ready: Sequence[Ready], seconds: float, seed: int, on_progress: Callable[[str, float], Any], seeds: int = SEEDS
) -> Pictures:
    """Return pictures of every configuration, as large and with as many samples as fit the time.

    Where turns take longer than the first small renders said, there are fewer seeds and fewer long renders.
    """
    info, layout = ready[0].wavefront.session.info, ready[0].wavefront.layout
    now = undisturbed_clock(info.type)
    begun = now()
    on_progress("timing", 0.0)
    tiles, first = _extent(ready, seconds, seeds)
    samples = (first, GROWTH * first)
    pixels = [[np.empty((seeds, len(tiles.pixels), 3), np.float32) for _ in samples] for _ in ready]
    taken = np.zeros((len(ready), 2, seeds))
    turns = seeds * len(samples)
    turning = now()
    for turn in range(turns):
        row, k = divmod(turn, len(samples))
        a_row = (now() - turning) / max(row, 1)
        left = seconds - (now() - begun) - a_row
        if k == 0 and row >= FEWEST_SEEDS and left < a_row * _LONG / (1 + GROWTH):
            turns = turn
            break
        for place, index in enumerate(_order(len(ready), turn)):
            on_progress("rendering by turns", (1 - LONG_TIME) * (turn + place / len(ready)) / turns)
            pixels[index][k][row], wall_s, cpu_s = run(ready[index], tiles, samples[k], seed + 1 + turn)
            taken[index, :, row] += cpu_s, wall_s
    seeds = turns // len(samples)
    pixels = [[part[:seeds] for part in each] for each in pixels]
    taken = taken[:, :, :seeds]
    left = seconds - (now() - begun)
    a_tile = (now() - turning) / (seeds * (1 + GROWTH) * len(tiles.tiles)) * LONG_SEEDS * LONG_GROWTH
    most = len(tiles.tiles) if math.isinf(seconds) else int(left / a_tile)
    long = _long(ready, tiles, most, LONG_GROWTH * first, seed + 1 + turns, on_progress)
    taken *= layout.samples_per_spp / len(tiles.pixels) / sum(samples)
    by_cpu = info.type == "cpu"
    timings = [(cpu / cores() if by_cpu else wall, wall) for cpu, wall in taken]
    return Pictures(tiles, samples, seeds, pixels, long, timings, by_cpu)


def _order(count: int, turn: int) -> NDArray[np.int64]:
    return np.roll(np.arange(count), turn)[:: 1 if turn % 4 < 2 else -1]


def _long(
    ready: Sequence[Ready],
    tiles: tradeoff_errors.SpreadTiles,
    most: int,
    samples: int,
    seed: int,
    on_progress: Callable[[str, float], Any],
) -> tradeoff_errors.LongPictures:
    """Return pictures of a few of the tiles with many samples, of as many as the time allows."""
    count = min(max(min(len(tiles.tiles) // LONG_SHARE, most), FEWEST_LONG), len(tiles.tiles))
    chosen = np.sort(np.random.default_rng(TILES_SEED).choice(len(tiles.tiles), count, replace=False))
    few = tiles.some(chosen)
    pixels = [np.empty((LONG_SEEDS, len(few.pixels), 3), np.float32) for _ in ready]
    for turn in range(LONG_SEEDS):
        for place, index in enumerate(_order(len(ready), turn)):
            share = (turn + place / len(ready)) / LONG_SEEDS
            on_progress("rendering some tiles longer", 1 - LONG_TIME * (1 - share))
            pixels[index][turn], *_ = run(ready[index], few, samples, seed + turn)
    return tradeoff_errors.LongPictures(samples, chosen, pixels)


def _extent(ready: Sequence[Ready], seconds: float, seeds: int) -> tuple[tradeoff_errors.SpreadTiles, int]:
    """Return the tiles and the samples per pixel of the first pictures, by the speed of small ones."""
    layout, kind = ready[0].wavefront.layout, ready[0].wavefront.session.info.type
    now = undisturbed_clock(kind)
    rng = np.random.default_rng(TILES_SEED)
    pilot = tradeoff_errors.spread_tiles(layout, PILOT_TILES, rng)
    for each in ready:
        run(each, pilot, 1, 0)
    begun = now()
    for each in ready:
        run(each, pilot, PILOT_SAMPLES, 0)
    per_sample = (now() - begun) / (PILOT_SAMPLES * len(pilot.pixels))
    # Of one tile with one sample per pixel in the first picture of each seed.
    fits = seconds * (1 - LONG_TIME) / (seeds * (1 + GROWTH) * per_sample * TILE_PIXELS)
    most = int(np.clip(fits / WANTED_SAMPLES, FEWEST_TILES, MOST_TILES.get(kind, MOST_TILES["gpu"])))
    tiles = tradeoff_errors.spread_tiles(layout, most, rng)
    return tiles, 2 ** math.floor(math.log2(max(fits / len(tiles.tiles), 1)))  # lattices are even at powers of two
