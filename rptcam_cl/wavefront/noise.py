"""How noisy the picture is, and which of its tiles need more samples.

The samples of a pixel are not independent of each other, so their spread says nothing of the error of their mean.
Runs of them do: a power of two of consecutive samples is a whole lattice, shifted at random, and the means of four to
eight such runs of equal length estimate the variance of their mean. Together they are one denser lattice, whose error
is smaller than if the runs were independent: the estimate errs to the safe side.

The sums are taken from the film at the ends of runs; runs are 16 samples long and join in pairs once there are eight.
Decisions are made per tile of 8 x 8 pixels, after 64 samples at the earliest and after whole runs: pixels that decided
by themselves would stop while they happen to be dark.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.wavefront.film import TILE_PIXELS, FilmLayout

SHORTEST_RUN = 16  # samples
MOST_RUNS = 8
BETWEEN_DECISIONS = 64  # samples, at least
DARKEST = 0.05  # of the picture's mean: the noise of darker tiles counts relative to this
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear RGB, ITU-R BT.709-6


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
        The relative standard error asked for.
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
        luminance = LUMINANCE @ (sums[:3].astype(np.float64) - sums[3:].astype(np.float64))
        length = run_length(done - 1)
        self._runs.append((luminance - self._before).astype(np.float32))
        self._before = luminance
        decided = False
        if done >= BETWEEN_DECISIONS and done % BETWEEN_DECISIONS == 0:
            self._measure(done, length, luminance)
            decided = self._decide(done)
        if len(self._runs) == MOST_RUNS:
            self._runs = [a + b for a, b in zip(self._runs[::2], self._runs[1::2], strict=True)]
        return decided

    def _measure(self, done: int, length: int, luminance: NDArray[np.float64]) -> None:
        places = (self.tiles[:, None] * TILE_PIXELS + np.arange(TILE_PIXELS, dtype=np.uint32)).ravel()
        runs = np.array([run[places] for run in self._runs]) / length
        self.variance[places] = runs.var(axis=0, ddof=1, dtype=np.float64) / len(runs)
        inside = self.layout.inside
        pixels = self.layout.pixels_of_tile
        samples = np.repeat(self.samples_of_tiles(done), TILE_PIXELS)
        means = np.where(inside, luminance / np.maximum(samples, 1), 0).reshape(-1, TILE_PIXELS).sum(axis=1)
        floor = DARKEST * means.sum() / pixels.sum()
        variance = np.where(inside, self.variance, 0).reshape(-1, TILE_PIXELS)[self.tiles].sum(axis=1)
        tile_pixels = pixels[self.tiles]
        mean = np.maximum(means[self.tiles] / tile_pixels, floor)
        with np.errstate(divide="ignore", invalid="ignore"):
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
