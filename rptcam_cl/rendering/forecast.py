"""What a render will take, before it is rendered: memory, kernel launches, and the time, by a measured piece of it."""

from __future__ import annotations

import time

import numpy as np

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.rendering.film import BLOCK, TILE_PIXELS
from rptcam_cl.rendering.film_part import WHOLE, FilmPart
from rptcam_cl.rendering.film_run import FilmRun
from rptcam_cl.rendering.memory import MemoryNeeds
from rptcam_cl.rendering.several import AnyWavefront, SharedWavefront

MEASURED_SECONDS = 2.0


@dataclass(frozen=True)
class Forecast:
    """What a render will take.

    Attributes
    ----------
    samples : int
        Of the picture's pixels.
    devices : dict
        What each device will hold, by its identifier.
    saved_bytes : int
        Of the file that its state is kept in.
    launches : int
        Of kernels.
    seconds : float
        Of rendering, without preparing it [s].
    measured_seconds : float
        How long the piece took that this follows from [s].
    at_most : bool
        Whether a noise target may end it earlier.
    """

    samples: int
    devices: dict[str, MemoryNeeds]
    saved_bytes: int
    launches: int
    seconds: float
    measured_seconds: float
    at_most: bool


def forecast(
    wavefront: AnyWavefront, first: int, end: int, part: FilmPart = WHOLE, measure_s: float = MEASURED_SECONDS
) -> Forecast:
    """Return what the samples of each pixel from ``first`` to before ``end`` take; the film is of no use afterwards.

    Tiles all over the picture are rendered for a while, after a first wave that is not counted.

    Parameters
    ----------
    wavefront
        Compiled, its film is overwritten.
    part
        Which tiles; its samples do not matter here.
    measure_s
        How long to measure [s].
    """
    layout = wavefront.layout
    held = wavefront.wavefronts if isinstance(wavefront, SharedWavefront) else [wavefront]
    saved = sum(array.nbytes for array in part.packed(FilmRun(wavefront).state().arrays, layout.tiles).values())
    tiles = part.tiles(layout.tiles)
    at_once = max(wavefront.capacity // wavefront.samples_per_wave, BLOCK) // TILE_PIXELS
    step = -(-len(tiles) // at_once)
    wavefront.choose_tiles(tiles[::step])
    some = len(tiles[::step])
    done = _render(wavefront, 0)
    begun, start, before = time.perf_counter(), done, sum(each.launches for each in held)
    while (seconds := time.perf_counter() - begun) < measure_s or done == start:
        done = _render(wavefront, done)
    share = (end - first) * len(tiles) / ((done - start) * some)
    return Forecast(
        samples=int(layout.pixels_of_tile[tiles].sum()) * (end - first),
        devices={each.session.info.id: each.needs for each in held},
        saved_bytes=saved,
        launches=int(np.ceil((sum(each.launches for each in held) - before) * share)),
        seconds=seconds * share,
        measured_seconds=seconds,
        at_most=wavefront.settings.noise is not None,
    )


def _render(wavefront: AnyWavefront, first: int) -> int:
    """Render some samples of the chosen tiles, and return the number of the next one."""
    count = wavefront.samples_per_wave
    for wave in wavefront.waves(first, count):
        wavefront.enqueue(*wave)
    wavefront.finish()
    return first + count
