"""Which device renders which tile of a picture that several share, and how large a share each is worth."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.rendering.film import BLOCK, TILE_PIXELS
from rptcam_cl.rendering.tracer import Wavefront

MEASURED_SECONDS = 0.3  # that each device renders before its share is settled
STEPS = 1000  # shares are whole numbers of these parts, so that their text repeats them exactly
GOLDEN = (5**0.5 - 1) / 2  # its multiples, less their whole parts, are spread evenly, however many there are


def owners(tiles: int, shares: Sequence[float]) -> NDArray[np.intp]:
    """Return which device renders each tile: the place of its share among ``shares``.

    Tiles of one device are spread over the picture, so that each has its part of the costly ones. The choice follows
    from the number of a tile and the shares alone.
    """
    places = np.modf((np.arange(tiles) + 0.5) * GOLDEN)[0]
    ends = np.cumsum(np.asarray(shares, np.float64) / np.sum(shares))[:-1]
    return np.asarray(np.searchsorted(ends, places, side="right"), np.intp)


def measured_speed(wavefront: Wavefront) -> float:
    """Return how many samples per second a device renders of tiles all over the picture; its film is empty after."""
    layout = wavefront.layout
    at_once = max(wavefront.capacity // wavefront.samples_per_wave, BLOCK) // TILE_PIXELS
    step = -(-layout.tiles // at_once)
    wavefront.choose_tiles(np.arange(0, layout.tiles, step, dtype=np.uint32))
    samples, first, begun = 0, 0, time.perf_counter()
    while time.perf_counter() - begun < MEASURED_SECONDS or not samples:
        for wave in wavefront.waves(first, wavefront.samples_per_wave):
            wavefront.enqueue(*wave)
            samples += wave[1] * wave[3]
        first += wavefront.samples_per_wave
        wavefront.finish()
    seconds = time.perf_counter() - begun
    wavefront.clear()
    return samples / seconds


def shares_of(speeds: Sequence[float]) -> list[float]:
    """Return shares in proportion to speeds, in thousandths that add up to 1, each at least one."""
    parts = [max(round(STEPS * speed / sum(speeds)), 1) for speed in speeds]
    parts[int(np.argmax(parts))] += STEPS - sum(parts)
    return [part / STEPS for part in parts]
