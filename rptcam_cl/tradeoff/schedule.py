"""How many tiles and samples fit the time, and the order of the renders: by turns, so that other work on the machine
disturbs all configurations alike."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.rendering import TILE_PIXELS
from rptcam_cl.tradeoff.errors import LongPictures
from rptcam_cl.tradeoff.measurement import Timings
from rptcam_cl.tradeoff.runs import Ready, cores, run, undisturbed_clock
from rptcam_cl.tradeoff.tiles import SpreadTiles, spread_tiles

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

    tiles: SpreadTiles
    samples: tuple[int, int]
    seeds: int
    pixels: list[list[NDArray[np.float32]]]
    long: LongPictures
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
            found = run(ready[index], tiles, samples[k], seed + 1 + turn)
            pixels[index][k][row] = found.pixels
            taken[index, :, row] += (found.cpu_s, found.wall_s)
    seeds = turns // len(samples)
    pixels = [[part[:seeds] for part in each] for each in pixels]
    taken = taken[:, :, :seeds]
    left = seconds - (now() - begun)
    a_tile = (now() - turning) / (seeds * (1 + GROWTH) * len(tiles.tiles)) * LONG_SEEDS * LONG_GROWTH
    most = len(tiles.tiles) if math.isinf(seconds) else int(left / a_tile)
    long = _long(ready, tiles, most, LONG_GROWTH * first, seed + 1 + turns, on_progress)
    taken *= layout.samples_per_spp / len(tiles.pixels) / sum(samples)
    by_cpu = info.type == "cpu"
    timings = [Timings(cpu / cores() if by_cpu else wall, wall) for cpu, wall in taken]
    return Pictures(tiles, samples, seeds, pixels, long, timings, by_cpu)


def _order(count: int, turn: int) -> NDArray[np.int64]:
    return np.roll(np.arange(count), turn)[:: 1 if turn % 4 < 2 else -1]


def _long(
    ready: Sequence[Ready],
    tiles: SpreadTiles,
    most: int,
    samples: int,
    seed: int,
    on_progress: Callable[[str, float], Any],
) -> LongPictures:
    """Return pictures of a few of the tiles with many samples, of as many as the time allows."""
    count = min(max(min(len(tiles.tiles) // LONG_SHARE, most), FEWEST_LONG), len(tiles.tiles))
    chosen = np.sort(np.random.default_rng(TILES_SEED).choice(len(tiles.tiles), count, replace=False))
    few = tiles.some(chosen)
    pixels = [np.empty((LONG_SEEDS, len(few.pixels), 3), np.float32) for _ in ready]
    for turn in range(LONG_SEEDS):
        for place, index in enumerate(_order(len(ready), turn)):
            share = (turn + place / len(ready)) / LONG_SEEDS
            on_progress("rendering some tiles longer", 1 - LONG_TIME * (1 - share))
            pixels[index][turn] = run(ready[index], few, samples, seed + turn).pixels
    return LongPictures(samples, chosen, pixels)


def _extent(ready: Sequence[Ready], seconds: float, seeds: int) -> tuple[SpreadTiles, int]:
    """Return the tiles and the samples per pixel of the first pictures, by the speed of small ones."""
    layout, kind = ready[0].wavefront.layout, ready[0].wavefront.session.info.type
    now = undisturbed_clock(kind)
    rng = np.random.default_rng(TILES_SEED)
    pilot = spread_tiles(layout, PILOT_TILES, rng)
    for each in ready:
        run(each, pilot, 1, 0)
    begun = now()
    for each in ready:
        run(each, pilot, PILOT_SAMPLES, 0)
    per_sample = (now() - begun) / (PILOT_SAMPLES * len(pilot.pixels))
    # Of one tile with one sample per pixel in the first picture of each seed.
    fits = seconds * (1 - LONG_TIME) / (seeds * (1 + GROWTH) * per_sample * TILE_PIXELS)
    most = int(np.clip(fits / WANTED_SAMPLES, FEWEST_TILES, MOST_TILES.get(kind, MOST_TILES["gpu"])))
    tiles = spread_tiles(layout, most, rng)
    return tiles, 2 ** math.floor(math.log2(max(fits / len(tiles.tiles), 1)))  # lattices are even at powers of two
