"""A film under way: how many samples it has, where within a sample it was left, and how noisy it is."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import StateError
from rptcam_cl.rendering.film import BLOCK, TILE_PIXELS
from rptcam_cl.rendering.film_part import WHOLE, FilmPart
from rptcam_cl.rendering.noise import NoiseWatch
from rptcam_cl.rendering.several import AnyWavefront
from rptcam_cl.rendering.waves import Wave

GROWING = ("noise_tiles", "noise_runs")  # as many rows as tiles are left, or as runs are kept

Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class SavedState:
    """A render under way, for `render_plan` to go on with: samples per pixel and arrays by name."""

    done: int
    arrays: dict[str, NDArray[Any]]


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
        self.done = self._end = saved.done
        check_fits(saved.arrays, self.wavefront.state() | self.watch.arrays())
        self.wavefront.restore(saved.arrays)
        self.watch.resume(saved.done, saved.arrays)

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
        """Return how many samples per pixel each tile of the buffer has, those of a sample that was left included."""
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
        """Return what `resume` needs; the film is whole."""
        self.wavefront.finish()
        return SavedState(self.done, self.wavefront.state() | self.watch.arrays())


def _pieces(wave: Wave, slots: int | None) -> Iterator[Wave]:
    """Yield a wave in pieces of at most so many slots, or of one block of pixels."""
    first, pixels, start, samples = wave
    step = pixels if slots is None else max(slots // samples // BLOCK, 1) * BLOCK
    for pixel in range(first, first + pixels, step):
        yield pixel, min(step, first + pixels - pixel), start, samples


def check_fits(saved: Arrays, fresh: Arrays) -> None:
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
        found = saved.get(name)
        start = 1 if name in GROWING else 0
        if found is None or found.dtype.kind != wanted.dtype.kind or found.ndim != wanted.ndim:
            raise _misfit(name)
        if found.shape[start:] != wanted.shape[start:]:
            raise _misfit(name)
    tiles = saved.get("noise_tiles", np.zeros(0))
    if "noise_tiles" in fresh and tiles.size and int(tiles.max()) >= len(fresh["noise_tiles"]):
        raise _misfit("noise_tiles")


def _misfit(name: str) -> StateError:
    return StateError(f"the saved render is damaged: its array {name} does not fit (render without --resume)")
