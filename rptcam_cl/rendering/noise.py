"""How noisy a picture is, with a noise target and without, and which tiles need more samples.

The samples of a pixel are not independent of each other, so their spread says nothing of the error of their mean.
Runs of them do: a power of two of consecutive samples is a whole lattice, shifted at random, and the means of four to
eight such runs of equal length estimate the variance of their mean. Together they are one denser lattice, whose error
is smaller than if the runs were independent: the estimate errs to the safe side.

The sums are taken from the film at the ends of runs; runs are 16 samples long and join in pairs once there are eight.
Decisions are made per tile of 8 x 8 pixels, after 64 samples at the earliest and after whole runs: pixels that stopped
on their own estimate would stop while they happen to be dark.

The film is looked at whenever the samples have doubled, which costs little. At the end the difference between the means
of the samples before and after such a look estimates the variance of the mean of all. Parts of a lattice together are
evener than each alone, so the estimate errs to the safe side (see `rptcam_cl.rendering.noise`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.rendering.film import TILE_PIXELS, FilmLayout
from rptcam_cl.rendering.several import AnyWavefront

SHORTEST_RUN = 16  # samples
MOST_RUNS = 8
BETWEEN_DECISIONS = 64  # samples, at least
DARKEST = 0.05  # of the picture's mean: the noise of darker tiles counts relative to this


def run_length(done: int) -> int:
    """Return the length of the run that sample number ``done`` belongs to, so that no more than eight are kept."""
    whole = SHORTEST_RUN * MOST_RUNS
    return SHORTEST_RUN if done < whole else 1 << (done.bit_length() - MOST_RUNS.bit_length() + 1)


def next_end(done: int) -> int:
    """Return the number of samples at which the run that follows ``done`` samples ends."""
    length = run_length(done)
    return (done // length + 1) * length


@dataclass(frozen=True)
class NoiseReport:
    """How noisy the picture is.

    Attributes
    ----------
    target : float or None
        The relative standard error requested.
    median, worst : float
        Relative standard error of the tiles.
    met : float
        Share of the tiles that meet the target; 1 without one.
    """

    target: float | None
    median: float
    worst: float
    met: float


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
        self.variance = np.full(layout.pixels, np.nan, np.float32)
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
        if done >= BETWEEN_DECISIONS and done % BETWEEN_DECISIONS == 0:
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

    def report(self) -> NoiseReport | None:
        """Return how noisy the picture is; None before 64 samples per pixel."""
        if np.isnan(self.error).all():
            return None
        met = 1.0 if self.target is None else float((self.error <= self.target).mean())
        return NoiseReport(self.target, float(np.median(self.error)), float(self.error.max()), met)

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
        self.variance = arrays["noise_variance"].astype(np.float32)
        self.error = arrays["noise_error"].astype(np.float32)
        self._runs = list(arrays["noise_runs"].astype(np.float32))
        self._before = arrays["noise_before"].astype(np.float64)


LARGEST_SHARE = 0.875  # of the samples that the first part may hold


@dataclass(frozen=True)
class AchievedNoise:
    """Relative standard errors of a picture's luminance.

    Attributes
    ----------
    picture : float
        Root mean square over the pixels of the standard error of a pixel, divided by the mean of the picture.
    tile_95 : float
        The same per tile of 8 x 8 pixels: the error that 95 of 100 tiles keep. Tiles darker than a twentieth of the
        picture's mean count relative to that.
    source : str
        What it was estimated from: "runs of samples", or "two parts of the samples".
    """

    picture: float
    tile_95: float
    source: str


def noise_of_runs(
    layout: FilmLayout, samples: NDArray[np.uint32], sums: NDArray[np.float32], variance: NDArray[np.float32]
) -> AchievedNoise | None:
    """Return how noisy a picture is whose variance was estimated on the way; None where there is no variance yet.

    Parameters
    ----------
    samples : (tiles of the buffer,) array
        Samples per pixel.
    sums : (6, pixels) array
        Of the film.
    variance : (pixels,) array
        Of the mean luminance.
    """
    mean = _luminance(sums) / np.repeat(np.maximum(samples, 1), TILE_PIXELS)
    return _achieved(layout, mean, variance, "runs of samples")


def _achieved(
    layout: FilmLayout, mean: NDArray[np.floating], variance: NDArray[np.floating], source: str
) -> AchievedNoise | None:
    """Return how noisy a picture is; None where it is black or its noise is not known.

    Parameters
    ----------
    mean, variance : (pixels,) arrays
        Mean luminance of each pixel of the film's buffer, and the variance of that mean.
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
    return AchievedNoise(picture, float(np.quantile(errors, 0.95)), source)


class TwoParts:
    """Looks at the film during a render, so that its noise can be reported at the end."""

    def __init__(self, layout: FilmLayout) -> None:
        self._layout = layout
        self._snapshots: list[tuple[int, NDArray[np.float32]]] = []  # the last two: samples, and the sum of luminance

    def wants(self, done: int) -> bool:
        """Return whether the film should be looked at after ``done`` samples per pixel."""
        return not self._snapshots or done >= 2 * self._snapshots[-1][0]

    def take(self, done: int, sums: NDArray[np.float32]) -> None:
        """Look at the film's sums (6, pixels) after ``done`` samples per pixel."""
        self._snapshots = [*self._snapshots[-1:], (done, _luminance(sums))]

    def report(self, done: int, sums: NDArray[np.float32]) -> AchievedNoise | None:
        """Return how noisy the picture is in the end; None where all its samples came at once."""
        earlier = [snapshot for snapshot in self._snapshots if snapshot[0] <= LARGEST_SHARE * done]
        if not earlier:
            return None
        first, before = earlier[-1]
        second, summed = done - first, _luminance(sums)
        difference = before / first - (summed - before) / second
        variance = difference**2 * (first * second / done**2)
        return _achieved(self._layout, summed / done, variance, "two parts of the samples")


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
        self._parts = TwoParts(wavefront.layout) if whole and not requested else None

    @property
    def satisfied(self) -> bool:
        """Whether all tiles meet the target."""
        return self.estimate is not None and len(self.estimate.tiles) == 0

    def resume(self, done: int, arrays: dict[str, NDArray[Any]]) -> None:
        """Go on from a film of ``done`` samples per pixel and what `arrays` gave beside it."""
        if self.estimate is not None:
            self.estimate.restore(arrays)
            self._wavefront.choose_tiles(self.estimate.tiles)
        elif self._parts is not None and done:
            self._parts.take(done, self._wavefront.sums())

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what to keep, to go on later."""
        return {} if self.estimate is None else self.estimate.arrays()

    def most(self, done: int, count: int) -> int:
        """Return how many of ``count`` samples may follow before the film has to be looked at."""
        return count if self.estimate is None else min(count, next_end(done) - done)

    def observe(self, done: int, *, last: bool) -> None:
        """Look at the film, where ``done`` samples per pixel are a reason to."""
        if self.estimate is not None and done == next_end(done - 1):
            self._wavefront.finish()
            if self.estimate.take(done, self._wavefront.sums()):
                self._wavefront.choose_tiles(self.estimate.tiles)
        if self._parts is not None and not last and self._parts.wants(done):
            self._wavefront.finish()
            self._parts.take(done, self._wavefront.sums())

    def samples_of_tiles(self, done: int) -> NDArray[np.uint32]:
        """Return how many samples per pixel each tile has."""
        if self.estimate is not None:
            return self.estimate.samples_of_tiles(done)
        return np.full(len(self._wavefront.layout.whole_list()), done, np.uint32)

    def variance(self) -> NDArray[np.float32]:
        """Return the variance of each pixel's mean luminance; nan where it is not recorded."""
        if self.estimate is not None:
            return self.estimate.variance
        return np.full(self._wavefront.layout.pixels, np.nan, np.float32)

    def report(self) -> NoiseReport | None:
        """Return how noisy the tiles are, where that is recorded."""
        return None if self.estimate is None else self.estimate.report()

    def achieved(self, done: int, sums: NDArray[np.float32]) -> AchievedNoise | None:
        """Return how noisy the finished picture is."""
        if self._parts is not None:
            return self._parts.report(done, sums)
        if self.estimate is None:
            return None
        return noise_of_runs(self._wavefront.layout, self.samples_of_tiles(done), sums, self.variance())
