"""Progressive rendering: waves until the samples, the noise or the time run out."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.colour import luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import StateError
from rptcam_cl.core.remember import checkpoint, is_cancellable
from rptcam_cl.rendering.film import BLOCK, PLANES, TILE_PIXELS, FilmLayout, Wave, group_pictures
from rptcam_cl.rendering.several import WHOLE, AnyWavefront, FilmPart
from rptcam_cl.scene.film import SHARP_LAYERS

#
# How noisy a picture is, with a noise target and without, and which tiles need more samples.
#
# The samples of a pixel are not independent of each other, so their spread says nothing of the error of their mean.
# Runs of them do: a power of two of consecutive samples is a whole lattice, shifted at random, and the means of four
# to eight such runs of equal length estimate the variance of their mean. Together they are one denser lattice, whose
# error is smaller than if the runs were independent: the estimate errs to the safe side.
#
# The sums are taken from the film at the ends of runs; runs are 16 samples long and join in pairs once there are
# eight. Decisions are made per tile of 8 x 8 pixels, after 64 samples at the earliest and after whole runs: pixels
# that stopped on their own estimate would stop while they happen to be dark.
#
# The film is looked at whenever the samples have doubled, which costs little. At the end the difference between the
# means of the samples before and after such a look estimates the variance of the mean of all. Parts of a lattice
# together are evener than each alone, so the estimate errs to the safe side.

_SHORTEST_RUN = 16  # samples
MOST_RUNS = 8
_BETWEEN_DECISIONS = 64  # samples, at least
DARKEST = 0.05  # of the picture's mean: the noise of darker tiles counts relative to this


def run_length(done: int) -> int:
    """Return the length of the run that sample number ``done`` belongs to, so that no more than eight are kept."""
    whole = _SHORTEST_RUN * MOST_RUNS
    return _SHORTEST_RUN if done < whole else 1 << (done.bit_length() - MOST_RUNS.bit_length() + 1)


def next_end(done: int) -> int:
    """Return the number of samples at which the run that follows ``done`` samples ends."""
    length = run_length(done)
    return (done // length + 1) * length


class NoiseEstimate:
    """Variance of every pixel's mean luminance, and the tiles that are still rendered.

    Parameters
    ----------
    layout
        Of the film.
    target : float or None
        Relative standard error at which a tile is done: the root of the mean over its pixels of the variance of the
        pixel's mean luminance, divided by the tile's mean luminance. None: no tile is ever done.
    """

    def __init__(self, layout: FilmLayout, target: float | None) -> None:
        self.layout, self.target = layout, target
        self.tiles = np.arange(layout.tiles, dtype=np.uint32)  # still rendered
        self.samples = np.zeros(layout.pixels // TILE_PIXELS, np.uint32)  # of each tile that is not
        self.variance = np.full(layout.pixels, np.nan)  # squares of radiance leave the range of float32
        self.error = np.full(layout.tiles, np.nan, np.float32)
        self.measured_at = 0  # samples per pixel at which `error` was found, 0 before
        self._runs: list[NDArray[np.float32]] = []  # sums of luminance, by pixel
        self._before = np.zeros(layout.pixels)  # sum up to the last end of a run

    def samples_of_tiles(self, done: int) -> NDArray[np.uint32]:
        """Return the samples per pixel in each tile of the buffer, those still rendered having ``done``."""
        samples = self.samples.copy()
        samples[self.tiles] = done
        return samples

    def take(self, done: int, sums: NDArray[np.float32]) -> bool:
        """Take the film's sums at the end of a run; return whether tiles were found to be done.

        Parameters
        ----------
        done : int
            Samples per pixel, the end of a run.
        sums : (6, pixels) array
            Of the film.
        """
        summed = luminance((sums[:3].astype(np.float64) - sums[3:].astype(np.float64)).T)
        length = run_length(done - 1)
        self._runs.append((summed - self._before).astype(np.float32))
        self._before = summed
        ended = False
        if done >= _BETWEEN_DECISIONS and done % _BETWEEN_DECISIONS == 0:
            self._measure(done, length, summed)
            ended = self._decide(done)
        if len(self._runs) == MOST_RUNS:
            self._runs = [a + b for a, b in zip(self._runs[::2], self._runs[1::2], strict=True)]
        return ended

    def _measure(self, done: int, length: int, summed: NDArray[np.float64]) -> None:
        places = (self.tiles[:, None] * TILE_PIXELS + np.arange(TILE_PIXELS, dtype=np.uint32)).ravel()
        runs = np.array([run[places] for run in self._runs]) / length
        self.variance[places] = runs.var(axis=0, ddof=1, dtype=np.float64) / len(runs)
        inside = self.layout.inside
        pixels = self.layout.pixels_of_tile
        samples = np.repeat(self.samples_of_tiles(done), TILE_PIXELS)
        means = np.where(inside, summed / np.maximum(samples, 1), 0).reshape(-1, TILE_PIXELS).sum(axis=1)
        floor = DARKEST * means.sum() / pixels.sum()
        variance = np.where(inside, self.variance, 0).reshape(-1, TILE_PIXELS)[self.tiles].sum(axis=1)
        tile_pixels = pixels[self.tiles]
        mean = np.maximum(means[self.tiles] / tile_pixels, floor)
        with np.errstate(divide="ignore", invalid="ignore"):
            self.measured_at = done
            self.error[self.tiles] = np.where(variance > 0, np.sqrt(variance / tile_pixels) / mean, 0)

    def _decide(self, done: int) -> bool:
        if self.target is None:
            return False
        finished = self.error[self.tiles] <= self.target
        self.samples[self.tiles[finished]] = done
        self.tiles = self.tiles[~finished]
        return bool(finished.any())

    def report(self) -> dict[str, Any] | None:
        """How noisy the picture is; None before 64 samples per pixel.

        Returns
        -------
        dict
            The ``target``; ``median`` and ``worst`` relative standard error of the tiles; ``met``, the share of them
            that meet the target, 1 without one.
        """
        if np.isnan(self.error).all():
            return None
        met = 1.0 if self.target is None else float((self.error <= self.target).mean())
        median, worst = float(np.median(self.error)), float(self.error.max())
        return {"target": self.target, "median": median, "worst": worst, "met": met}

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return everything that `restore` needs."""
        runs = np.array(self._runs, np.float32).reshape(len(self._runs), self.layout.pixels)
        return {
            "noise_tiles": self.tiles, "noise_samples": self.samples, "noise_variance": self.variance,
            "noise_error": self.error, "noise_runs": runs, "noise_before": self._before,
        }  # fmt: skip

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        """Go on from what `arrays` returned."""
        self.tiles, self.samples = arrays["noise_tiles"].astype(np.uint32), arrays["noise_samples"].astype(np.uint32)
        self.variance = arrays["noise_variance"].astype(np.float64)
        self.error = arrays["noise_error"].astype(np.float32)
        self._runs = list(arrays["noise_runs"].astype(np.float32))
        self._before = arrays["noise_before"].astype(np.float64)


_LARGEST_SHARE = 0.875  # of the samples that those before a look at the film may be


def _noise_of(
    layout: FilmLayout, mean: NDArray[np.floating], variance: NDArray[np.floating], source: str
) -> dict[str, Any] | None:
    """How noisy a picture is; None where it is black or its noise is not known.

    Parameters
    ----------
    mean, variance : (pixels,) arrays
        Mean luminance of each pixel of the film's buffer, and the variance of that mean.

    Returns
    -------
    dict
        ``picture``: root mean square over the pixels of the standard error of a pixel, over the mean of the picture.
        ``tile_95``: the same per tile of 8 x 8 pixels, the error that 95 of 100 tiles keep; tiles darker than a
        twentieth of the picture's mean count relative to that. ``source``: what it was estimated from.
    """
    inside, pixels = layout.inside, layout.pixels_of_tile[: layout.tiles]
    tiles = [
        np.where(inside, values, 0).reshape(-1, TILE_PIXELS).sum(axis=1, dtype=np.float64)
        for values in (mean, variance)
    ]
    means, variances = (values[: layout.tiles] for values in tiles)
    whole = float(means.sum() / pixels.sum())
    if not (whole > 0 and np.isfinite(variances).all()):
        return None
    errors = np.sqrt(variances / pixels) / np.maximum(means / pixels, DARKEST * whole)
    picture = float(np.sqrt(variances.sum() / pixels.sum())) / whole
    return {"picture": picture, "tile_95": float(np.quantile(errors, 0.95)), "source": source}


def _luminance(sums: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the sum of luminance per pixel, in float32, whose rounding is far below the noise."""
    return np.asarray(luminance((sums[:3] - sums[3:]).T, np.float32))


class NoiseWatch:
    """Looks at the film as samples come in: tile by tile with a noise target, else by two parts of the samples.

    Attributes
    ----------
    estimate : NoiseEstimate or None
        Of the tiles, where there is a target or their variance is a layer.

    Parameters
    ----------
    whole
        Whether all of the film is rendered; of a part no noise is known.
    """

    def __init__(self, wavefront: AnyWavefront, target: float | None, *, whole: bool = True) -> None:
        self._wavefront = wavefront
        requested = target is not None or "variance" in wavefront.settings.layers
        self.estimate = NoiseEstimate(wavefront.layout, target) if requested else None
        self._compares = whole and not requested
        self._snapshots: list[tuple[int, NDArray[np.float32]]] = []  # the last two: samples, and the sum of luminance

    @property
    def satisfied(self) -> bool:
        """Whether all tiles meet the target."""
        return self.estimate is not None and len(self.estimate.tiles) == 0

    def resume(self, done: int, arrays: dict[str, NDArray[Any]]) -> None:
        """Go on from a film of ``done`` samples per pixel and what `arrays` gave beside it."""
        if self.estimate is not None:
            self.estimate.restore(arrays)
            self._wavefront.choose_tiles(self.estimate.tiles)
        elif self._compares and done:
            self._take_snapshot(done)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays that a later run goes on from."""
        return {} if self.estimate is None else self.estimate.arrays()

    def most(self, done: int, count: int) -> int:
        """How many of ``count`` samples may follow before the film has to be looked at."""
        return count if self.estimate is None else min(count, next_end(done) - done)

    def observe(self, done: int, *, last: bool) -> None:
        """Look at the film, where ``done`` samples per pixel are a reason to."""
        if self.estimate is not None and done == next_end(done - 1):
            self._wavefront.finish()
            if self.estimate.take(done, self._wavefront.sums()):
                self._wavefront.choose_tiles(self.estimate.tiles)
        if self._compares and not last and (not self._snapshots or done >= 2 * self._snapshots[-1][0]):
            self._wavefront.finish()
            self._take_snapshot(done)

    def _take_snapshot(self, done: int) -> None:
        self._snapshots = [*self._snapshots[-1:], (done, _luminance(self._wavefront.sums()))]

    def samples_of_tiles(self, done: int) -> NDArray[np.uint32]:
        """How many samples per pixel each tile has."""
        if self.estimate is not None:
            return self.estimate.samples_of_tiles(done)
        return np.full(len(self._wavefront.layout.whole_list()), done, np.uint32)

    def variance(self) -> NDArray[np.float32]:
        """Return the variance of each pixel's mean luminance; nan where it is not recorded."""
        if self.estimate is None:
            return np.full(self._wavefront.layout.pixels, np.nan, np.float32)
        with np.errstate(over="ignore"):
            return self.estimate.variance.astype(np.float32)

    def report(self) -> dict[str, Any] | None:
        """How noisy the tiles are, where that is recorded."""
        return None if self.estimate is None else self.estimate.report()

    def achieved(self, done: int, sums: NDArray[np.float32]) -> dict[str, Any] | None:
        """How noisy the finished picture is; None where all samples came at once, or with no variance yet."""
        layout, summed = self._wavefront.layout, _luminance(sums)
        if self.estimate is not None:
            mean = summed / np.repeat(np.maximum(self.samples_of_tiles(done), 1), TILE_PIXELS)
            return _noise_of(layout, mean, self.estimate.variance, "runs of samples")
        earlier = [snapshot for snapshot in self._snapshots if snapshot[0] <= _LARGEST_SHARE * done]
        if not earlier:
            return None
        first, before = earlier[-1]
        second = done - first
        difference = before / first - (summed - before).astype(np.float64) / second
        variance = difference**2 * (first * second / done**2)
        return _noise_of(layout, summed / done, variance, "two parts of the samples")


# A film under way: how many samples it has, where within a sample it was left, and how noisy it is.

_GROWING = ("noise_tiles", "noise_runs")  # as many rows as tiles are left, or as runs are kept

_SavedArrays = Mapping[str, NDArray[Any]]
SavedState = tuple[int, dict[str, NDArray[Any]]]
"""A film under way: samples per pixel, and arrays by name."""


class FilmRun:
    """Adds samples to the film of a wavefront, and can be left and gone on with after any wave.

    Parameters
    ----------
    wavefront
        Compiled, with an empty film.
    noise
        Relative standard error at which a tile of 8 x 8 pixels is left alone (`NoiseEstimate`).
    part
        Which tiles and samples are rendered.

    Attributes
    ----------
    done : int
        Number of the first sample that is not made yet, but for tiles that are left alone.
    watch : NoiseWatch
    """

    def __init__(self, wavefront: AnyWavefront, noise: float | None = None, part: FilmPart = WHOLE) -> None:
        self.wavefront, self.part = wavefront, part
        self.watch = NoiseWatch(wavefront, noise, whole=part == WHOLE)
        if part != WHOLE:
            wavefront.choose_tiles(part.tiles(wavefront.layout.tiles))
        self.done = part.first
        self._end = part.first  # what `done` is once all waves are made
        self._made: list[Wave] = []
        self._left: list[Wave] = []

    @property
    def is_whole(self) -> bool:
        """Whether every pixel has the same samples: the film was not left within one."""
        return not self._left

    def resume(self, saved: SavedState) -> None:
        """Go on from an earlier state; raises `StateError` where it does not fit."""
        done, arrays = saved
        self.done = self._end = done
        check_fits(arrays, self.wavefront.state() | self.watch.arrays())
        self.wavefront.restore(arrays)
        self.watch.resume(done, arrays)

    def add(
        self,
        samples: int,
        enqueued: Callable[[int], Any] | None = None,
        *,
        slots: int | None = None,
        last: bool = False,
    ) -> bool:
        """Enqueue more samples of every pixel, or what is left of those at hand; return whether all of it is.

        Parameters
        ----------
        samples
            At most; fewer are enqueued where the film has to be looked at before more.
        enqueued
            Called with the slots of each wave; what is true ends the work there.
        slots
            Most of a wave; by default those of the wavefront.
        last
            Whether these samples are the last.
        """
        if not self._left:
            count = self.watch.most(self.done, samples)
            self._left = [piece for wave in self.wavefront.waves(self.done, count) for piece in _pieces(wave, slots)]
            self._made, self._end = [], self.done + count
        while self._left:
            wave = self._left.pop(0)
            self.wavefront.enqueue(*wave)
            self._made.append(wave)
            if enqueued is not None and enqueued(wave[1] * wave[3]) and self._left:
                return False
        self._made, self.done = [], self._end
        self.watch.observe(self.done, last=last)
        return True

    def samples_of_tiles(self) -> NDArray[np.uint32]:
        """How many samples per pixel each tile of the buffer has, those of a sample that was left included."""
        samples = self.part.samples_of_tiles(self.watch.samples_of_tiles(self.done), self.wavefront.layout.tiles)
        for first, pixels, start, count in self._made:
            tiles = self.wavefront.tiles[first // TILE_PIXELS : (first + pixels) // TILE_PIXELS]
            samples[tiles] = start + count - self.part.first
        return samples

    def pixels(self) -> NDArray[np.float32]:
        """Return the mean of the film so far, (height, width, 3), each pixel's over its own samples."""
        self.wavefront.finish()
        return self.wavefront.layout.picture(self.wavefront.sums(), self.samples_of_tiles())

    def state(self) -> SavedState:
        """The state that `resume` takes; the film is whole."""
        self.wavefront.finish()
        return self.done, self.wavefront.state() | self.watch.arrays()


def _pieces(wave: Wave, slots: int | None) -> Iterator[Wave]:
    """Yield a wave in pieces of at most so many slots, or of one block of pixels."""
    first, pixels, start, samples = wave
    step = pixels if slots is None else max(slots // samples // BLOCK, 1) * BLOCK
    for pixel in range(first, first + pixels, step):
        yield pixel, min(step, first + pixels - pixel), start, samples


def check_fits(saved: _SavedArrays, fresh: _SavedArrays) -> None:
    """Refuse arrays that kernels would read or write beyond their ends.

    Parameters
    ----------
    saved
        Of the file.
    fresh
        The same arrays of the render at its start.

    Raises
    ------
    StateError
        When one is missing, or of another type or shape, or names a tile that is not there.
    """
    for name, wanted in fresh.items():
        array, start = saved.get(name), 1 if name in _GROWING else 0
        if array is None or (array.dtype.kind, array.ndim) != (wanted.dtype.kind, wanted.ndim):
            raise _misfit(name)
        if array.shape[start:] != wanted.shape[start:]:
            raise _misfit(name)
    tiles = saved.get("noise_tiles", np.zeros(0))
    if "noise_tiles" in fresh and tiles.size and int(tiles.max()) >= len(fresh["noise_tiles"]):
        raise _misfit("noise_tiles")


def _misfit(name: str) -> StateError:
    return StateError(f"the saved render is damaged: its array {name} does not fit (render without --resume)")


# How long a render with a noise target still takes: the samples that its tiles need, at the speed of late.

_RECENT = 2 / 3  # of the time so far, after which the speed counts: fewer tiles use a device less well
_LEAST_POWER, _MOST_POWER = 0.5, 1.0
MOST_SAMPLES = 2**32 - 1
FEW = 0.05  # share of the tiles whose noise is said when no more are left


@dataclass(frozen=True)
class TilesLeft:
    """The tiles that do not meet the noise target yet.

    Attributes
    ----------
    count : int
    worst, target : float
        Relative standard error of the noisiest of them, and the one requested.
    samples : float
        Of all their pixels, still to be made.
    seconds : float
        For those [s].
    few : bool
        Whether most of the picture is done, so that it is worth saying why it goes on.
    """

    count: int
    worst: float
    target: float
    samples: float
    seconds: float
    few: bool


class TimeLeft:
    """Foretells the end of a render with a noise target, from its reports.

    The error of a tile falls by a power of its samples: 1/2 for independent ones, more where the lattice helps. The
    power is that of the median tile since it had half of its samples. A tile then needs (error / target)^(1 / power)
    times its samples, up to the end of a run, where the decision is made. Samples go at the speed of late.
    """

    def __init__(self) -> None:
        self._marks = [(0.0, 0)]  # seconds, samples of all pixels
        self._errors: list[tuple[int, NDArray[np.float32]]] = []  # samples per pixel, error of each tile

    def note(self, seconds: float, samples: int) -> None:
        """Note how many samples of all pixels were made after so many seconds."""
        while len(self._marks) > 1 and self._marks[1][0] <= _RECENT * seconds:
            self._marks.pop(0)
        if seconds > self._marks[-1][0]:
            self._marks.append((seconds, samples))

    def tiles_left(self, estimate: NoiseEstimate | None, done: int, most: int | None) -> TilesLeft | None:
        """Foretell the rest; None without a target, before the noise is known, and when all tiles meet it.

        Parameters
        ----------
        done
            Samples per pixel of the tiles that are still rendered.
        most
            Samples per pixel at which the render ends in any case.
        """
        if estimate is None or estimate.target is None or not estimate.measured_at or not len(estimate.tiles):
            return None
        (since, before), (now, made) = self._marks[0], self._marks[-1]
        if made <= before:
            return None
        errors = estimate.error[estimate.tiles].astype(np.float64)
        needed = estimate.measured_at * (errors / estimate.target) ** (1 / self._power(estimate))
        needed = np.array([_run_end(max(value, done + 1)) for value in np.minimum(needed, MOST_SAMPLES)])
        if most is not None:
            needed = np.minimum(needed, most)
        samples = float(((needed - done) * estimate.layout.pixels_of_tile[estimate.tiles]).sum())
        return TilesLeft(
            len(errors), float(errors.max()), estimate.target, samples, samples * (now - since) / (made - before),
            len(errors) <= FEW * estimate.layout.tiles,
        )  # fmt: skip

    def _power(self, estimate: NoiseEstimate) -> float:
        """Return by which power of the samples the errors of the tiles fall."""
        count = estimate.measured_at
        if not self._errors or self._errors[-1][0] != count:
            self._errors.append((count, estimate.error.copy()))
        while len(self._errors) > 1 and self._errors[1][0] <= count / 2:
            self._errors.pop(0)
        first, then = self._errors[0]
        if first > count / 2:
            return _LEAST_POWER
        with np.errstate(divide="ignore", invalid="ignore"):
            falls = np.log(then[estimate.tiles] / estimate.error[estimate.tiles]) / np.log(count / first)
        falls = falls[np.isfinite(falls)]
        return float(np.clip(np.median(falls), _LEAST_POWER, _MOST_POWER)) if len(falls) else _LEAST_POWER


def _run_end(samples: float) -> float:
    length = run_length(int(samples) - 1)
    return float(np.ceil(samples / length) * length)


# Progressive rendering: waves until the samples or the time run out.

_REPORT_INTERVAL = 0.2  # seconds of work that may be enqueued before a report and a chance to stop
_GIVING_WAY_S = 0.02  # likewise, where somebody may want it no longer


@dataclass(frozen=True)
class Progress:
    """How far a render is.

    Attributes
    ----------
    stage : "compile" or "render"
    samples_done : int
        Samples per pixel done.
    spp_target : int or None
        Samples per pixel requested; None when only time ends the render.
    seconds : float
        Time spent rendering [s].
    msamples_per_second : float
        Camera samples per second, in millions.
    blocked_share : float or None
        Share of the camera rays that the lens blocked; None without a lens.
    samples_at_start : int
        Samples per pixel that a resumed render had already.
    tiles_done : float or None
        Share of the tiles that meet the noise target; None without one.
    tiles_left : TilesLeft or None
        The others, and how long they take; None without a target and before their noise is known.
    film : FilmRun or None
        The film under way; None before there is one.
    image : callable or None
        Of `rptcam_cl.render`: returns the picture so far as an image, while this is the latest progress.
    """

    stage: str
    samples_done: int
    spp_target: int | None
    seconds: float
    msamples_per_second: float
    blocked_share: float | None
    samples_at_start: int = 0
    tiles_done: float | None = None
    tiles_left: TilesLeft | None = None
    film: FilmRun | None = field(default=None, repr=False, compare=False)
    image: Callable[[], Any] | None = field(default=None, repr=False, compare=False)

    def pixels(self) -> NDArray[np.float32] | None:
        """Return the film so far, (height, width, 3), to be called while this is the latest progress; None before any.

        It costs nothing until it is called: then the film is read from the devices.
        """
        return None if self.film is None else self.film.pixels()


@dataclass(frozen=True)
class Rendering:
    """The result of a render.

    Attributes
    ----------
    pixels : (height, width, 3) array
        Mean of the film.
    done : int
        Samples per pixel up to which it was rendered, those of earlier parts included.
    spp : int
        Samples of the pixels that have most.
    samples : (height, width) array
        Samples of each pixel.
    variance : (height, width) array
        Of each pixel's mean luminance; nan unless it is recorded and there are 64 samples to estimate it from.
    noise : dict or None
        How noisy the tiles are, likewise, as `NoiseEstimate.report` has it.
    achieved : dict or None
        How noisy the picture is, as far as it is known without a noise target.
    seconds : float
        Time spent rendering [s].
    interrupted : bool
        Whether ``should_stop`` ended the render.
    layers : dict
        Auxiliary layers by name.
    resumed_from : int
        Samples per pixel that it started from.
    new_samples : int
        Samples of all pixels made since.
    state : callable
        Returns what `render_plan` needs to go on.
    """

    pixels: NDArray[np.float32]
    done: int
    spp: int
    samples: NDArray[np.uint32]
    variance: NDArray[np.float32]
    noise: dict[str, Any] | None
    achieved: dict[str, Any] | None
    seconds: float
    interrupted: bool
    layers: dict[str, NDArray[Any]]
    resumed_from: int
    new_samples: int
    state: Callable[[], SavedState]


def render_plan(
    wavefront: AnyWavefront,
    *,
    spp: int | None,
    seconds: float | None,
    has_lens: bool,
    noise: float | None = None,
    part: FilmPart = WHOLE,
    saved: SavedState | None = None,
    save: Callable[[Callable[[], SavedState]], Any] | None = None,
    on_progress: Callable[[Progress], Any] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> Rendering:
    """Render until every pixel has ``spp`` samples, or ``seconds`` have passed, or ``should_stop`` says so.

    It always ends after whole samples: every pixel has the same number of them, at least one. With ``noise``, tiles of
    8 x 8 pixels are left alone once their relative standard error is so small (`NoiseEstimate`).

    Parameters
    ----------
    part
        Which tiles and samples are rendered; its samples end where it says, if it does.
    saved
        What to go on with.
    save
        Called between samples with a function that returns the state.
    """
    run = FilmRun(wavefront, noise, part)
    if saved is not None:
        run.resume(saved)
    start = 0 if saved is None else run.done
    clock = _Clock(run, spp, has_lens, on_progress)
    stopped = _add_samples(run, clock, spp, seconds, save, should_stop)
    wavefront.finish()
    clock.report()
    return rendering_of(run, start=start, seconds=clock.elapsed, new_samples=clock.samples, interrupted=stopped)


def _add_samples(
    run: FilmRun,
    clock: _Clock,
    spp: int | None,
    seconds: float | None = None,
    save: Callable[[Callable[[], SavedState]], Any] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> bool:
    """Add samples as `render_plan` says; return whether ``should_stop`` has ended it."""
    most = run.wavefront.samples_per_wave
    while (spp is None or run.done < spp) and not run.watch.satisfied:
        # By time, the first picture comes after one sample per pixel; later waves hold at most as many as are done.
        rest = most if spp is None else min(most, spp - run.done)
        count = rest if seconds is None else min(rest, max(run.done, 1), clock.fitting(seconds))
        run.add(count, clock.count, last=run.done + count == spp)
        if save is not None:
            save(run.state)
        if should_stop is not None and should_stop():
            return True
        if seconds is not None and clock.out_of_time(seconds):
            return False
    return False


def render_state(wavefront: AnyWavefront, spp: int, part: FilmPart = WHOLE) -> SavedState:
    """Return the state of a part's film with all its samples; no picture is made of it, which takes the whole film.

    Parameters
    ----------
    wavefront
        Compiled, with an empty film and all tiles.
    spp
        The sample of each pixel to end before.
    part
        Which tiles and samples are rendered.
    """
    run = FilmRun(wavefront, part=part)
    _add_samples(run, _Clock(run, spp, False, None), spp)
    return run.state()


def rendering_of(run: FilmRun, *, start: int, seconds: float, new_samples: int, interrupted: bool) -> Rendering:
    """Make the picture of a film, of so many samples per pixel at the start and so many of all pixels since."""
    wavefront, watch, done = run.wavefront, run.watch, run.done
    layout = wavefront.layout
    tiles = run.samples_of_tiles()
    in_rows = {"samples": np.repeat(tiles, TILE_PIXELS), "variance": watch.variance()}
    film = {name: np.ascontiguousarray(layout.in_rows(values[None])[0]) for name, values in in_rows.items()}
    planes = wavefront.planes()
    sums = planes[:PLANES]
    pixels = layout.picture(sums, tiles)
    layers = wavefront.layers() | film | {"direct": pixels, "ghosts": np.zeros_like(pixels)}
    lights = group_pictures(layout, planes, tiles, wavefront.light_groups)
    return Rendering(
        pixels=pixels,
        done=done,
        spp=int(film["samples"].max()),
        samples=film["samples"],
        variance=film["variance"],
        noise=watch.report(),
        achieved=watch.achieved(done, sums),
        seconds=seconds,
        interrupted=interrupted,
        layers={name: layers[name] for name in wavefront.settings.layers if name not in (*SHARP_LAYERS, "lights")}
        | lights,
        resumed_from=start,
        new_samples=new_samples,
        state=run.state,
    )


class _Clock:
    """Keeps the queue short enough for reports, from the speed seen so far."""

    def __init__(
        self, run: FilmRun, spp: int | None, has_lens: bool, on_progress: Callable[[Progress], Any] | None
    ) -> None:
        self._run, self._wavefront = run, run.wavefront
        self._spp = spp
        self._first = run.done  # samples per pixel at the start
        self._has_lens = has_lens
        self._on_progress = on_progress
        self._rays = run.wavefront.camera_rays
        self._start = time.perf_counter()
        self._last = self._start
        self._pending = 0
        self._batch = 1  # slots to enqueue before waiting
        self._time_left = TimeLeft()

    @property
    def elapsed(self) -> float:
        """Seconds since the start."""
        return time.perf_counter() - self._start

    @property
    def samples(self) -> int:
        """Samples of all pixels since the start, up to the last time that the device was waited for."""
        return self._wavefront.camera_rays - self._rays

    def count(self, slots: int) -> None:
        """Note enqueued slots; wait and report when enough are under way."""
        self._pending += slots
        if self._pending >= self._batch:
            self._wait()

    def _wait(self) -> None:
        self._wavefront.finish()
        now = time.perf_counter()
        rate = self._pending / max(now - self._last, 1e-6)
        self._batch = max(int(rate * (_GIVING_WAY_S if is_cancellable() else _REPORT_INTERVAL)), 1)
        self._pending, self._last = 0, now
        self.report()
        checkpoint()

    def fitting(self, seconds: float) -> int:
        """How many samples per pixel fit into what is left of ``seconds``, at the speed so far; at least one."""
        made = self._run.done - self._first
        return max(round((seconds - self.elapsed) / self.elapsed * made), 1) if made else 1

    def out_of_time(self, seconds: float) -> bool:
        """Whether another sample per pixel would end nearer to ``seconds`` after it than before."""
        self._wait()
        per_sample = self.elapsed / (self._run.done - self._first)
        return self.elapsed + 0.5 * per_sample >= seconds

    def report(self) -> None:
        """Report progress to the listener."""
        if self._on_progress is None:
            return
        blocked = None
        if self._has_lens:
            outcomes = self._wavefront.outcomes()
            total = sum(outcomes.values()) - outcomes["dark"]
            blocked = 1 - outcomes["passed"] / total if total else 0.0
        elapsed = self.elapsed
        rate = self.samples / max(elapsed, 1e-9) / 1e6
        done_share = None
        estimate = self._run.watch.estimate
        if estimate is not None and estimate.target is not None:
            done_share = 1 - len(estimate.tiles) / self._wavefront.layout.tiles
        done = self._run.done
        self._time_left.note(elapsed, self.samples)
        left = self._time_left.tiles_left(estimate, done, self._spp)
        self._on_progress(
            Progress("render", done, self._spp, elapsed, rate, blocked, self._first, done_share, left, self._run)
        )
