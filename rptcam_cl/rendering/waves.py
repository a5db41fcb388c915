"""How the samples of a film are cut into waves, and the record that says which samples a wave holds."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.records import WAVE
from rptcam_cl.rendering.film import BLOCK, TILE_PIXELS, FilmLayout
from rptcam_cl.rendering.photon_passes import within_passes

# Paths of a wave, at least. On two CPU cores 256k render meshes 1.3 times as fast as 64k, whose ends leave a core idle.
WAVE_SLOTS = {"cpu": 1 << 18, "gpu": 1 << 20}
# And of each CPU core: three spheres keep it for a millisecond, where 64 cores that share 256k paths would be done with
# them in the time that it takes to wake them.
SLOTS_OF_CORE = 1 << 15
STREAM_SAMPLES = 16  # samples per pixel of a wave: what a lane may run through before it idles
STEPS_OF_SAMPLE = 4096  # that all loops of a kernel take for one sample, at most: those of trees and lenses

Wave = tuple[int, int, int, int]
"""First pixel (in the list of tiles), pixels, first sample, samples per pixel."""


def wave_slots(kind: str, compute_units: int) -> int:
    """Return how many paths a wave of a device has, "cpu" or "gpu"; the film does not depend on it."""
    return max(WAVE_SLOTS[kind], SLOTS_OF_CORE * compute_units if kind == "cpu" else 0)


class Waves:
    """Sizes of the waves of one film.

    Parameters
    ----------
    layout
        The film.
    slots
        Of a wave, at most; rounded to a multiple of 256.
    stream
        Whether a lane carries its pixel through all samples of the wave.
    loop_limit
        Steps that all loops of a work item may take together; None where they may take as many as they like.
    photons
        Whether the samples of a wave must see the same pass of photons.
    single
        Whether a wave has one sample of each pixel.

    Attributes
    ----------
    pixels, samples : int
        Pixels of a wave, and samples per pixel.
    """

    def __init__(
        self,
        layout: FilmLayout,
        slots: int,
        *,
        stream: bool,
        loop_limit: int | None,
        photons: bool = False,
        single: bool = False,
    ) -> None:
        self._layout = layout
        self._photons = photons
        at_least = STREAM_SAMPLES if stream and not single else 1
        self.pixels = min(max(slots // at_least // BLOCK, 1) * BLOCK, layout.pixels)
        most = (loop_limit or slots * STEPS_OF_SAMPLE) // STEPS_OF_SAMPLE
        self.samples = 1 if single else min(max(slots // self.pixels, 1), most)

    @property
    def capacity(self) -> int:
        """Slots of a wave."""
        return self.pixels * self.samples

    def over(self, tiles: int, first_sample: int, samples: int) -> list[Wave]:
        """Return the waves that render a range of samples of so many tiles."""
        found, pixels = [], tiles * TILE_PIXELS
        for start, count in self._pieces(first_sample, samples):
            for pixel in range(0, pixels, self.pixels):
                found.append((pixel, min(self.pixels, pixels - pixel), start, count))
        return found

    def _pieces(self, first_sample: int, samples: int) -> Iterator[tuple[int, int]]:
        """Yield first sample and number of what goes into a wave together."""
        if self._photons:
            yield from within_passes(first_sample, samples, self.samples)
            return
        for start in range(first_sample, first_sample + samples, self.samples):
            yield start, min(self.samples, first_sample + samples - start)

    def rays_of(self, wave: Wave, tiles: NDArray[np.uint32]) -> int:
        """Return how many samples of the picture's pixels a wave holds; ``tiles`` is the list that it goes through."""
        first_pixel, pixels, _, samples = wave
        taken = tiles[first_pixel // TILE_PIXELS : (first_pixel + pixels) // TILE_PIXELS]
        return samples * int(self._layout.pixels_of_tile[taken].sum())

    def record(self, wave: Wave, seed: int) -> bytes:
        """Return the record ``WAVE`` of a wave."""
        layout, record = self._layout, WAVE.zeros(1)
        record["seed"][0] = seed_words(seed)
        record["first_pixel"], record["pixels"], record["first_sample"], record["samples"] = wave
        record["tiles_across"], record["full_width"] = layout.tiles_across, layout.full_width
        record["width"], record["height"] = layout.width, layout.height
        record["crop_x"], record["crop_y"] = layout.x, layout.y
        record["tiles_skipped"] = layout.tiles_skipped
        return record.tobytes()


@lru_cache(maxsize=4)
def _shuffled(cycle: int, steps: int) -> NDArray[np.intp]:
    """Return the numbers below ``steps`` in an order that neighbouring cycles do not share."""
    return np.argsort([seed_words(cycle * steps + step)[0] for step in range(steps)], kind="stable")


def step_of(sample: int, steps: int) -> int:
    """Return which step of the exposure a sample of every pixel is of: so many samples have each of them once."""
    cycle, place = divmod(sample, steps)
    return int(_shuffled(cycle, steps)[place])


def seed_words(seed: int) -> tuple[int, int]:
    """Return two 32-bit words of a 64-bit seed, mixed so that neighbouring seeds are unrelated (splitmix64)."""
    mask = (1 << 64) - 1
    z = (seed + 0x9E3779B97F4A7C15) & mask
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & mask
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & mask
    z ^= z >> 31
    return z & 0xFFFFFFFF, z >> 32
