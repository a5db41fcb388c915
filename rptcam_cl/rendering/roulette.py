"""How kind Russian roulette is, by cell of the film: before its first sample a render looks at a few tiles, once.

A path goes on with the chance of its throughput times a factor that is great where the picture is dark: what a path
brings counts by what its pixel shows. Light per throughput is about the same for all paths of a scene: measured on
six, it is 1.0 to 2.5 times the square of the mean root of the picture. That mean resists lamps and single bright
samples, and that of noisy places lies below their light, so that their paths live longer.
"""

from __future__ import annotations

from math import fsum

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import LIMITS
from rptcam_cl.rendering.film import TILE, FilmLayout
from rptcam_cl.scene import RenderSettings

KINDNESS = 2.0  # where the picture is as bright as on the whole
KINDEST = 40.0  # times that, at most
MOST_TILES = 512  # that are looked at
SCOUTING_SEED = 0x726F756C65747465  # the same for all seeds, parts and continuations of a picture


@dataclass(frozen=True)
class Roulette:
    """How kind roulette is where.

    Attributes
    ----------
    kindness : (down, across) array
        What throughputs are multiplied by, float32.
    cell_shift : int
        Binary logarithm of the pixels across a cell.
    """

    kindness: NDArray[np.float32]
    cell_shift: int

    def limits(self, settings: RenderSettings) -> bytes:
        """Return the record ``LIMITS`` of a render."""
        record = LIMITS.zeros(1)
        record["max_depth"], record["roulette_depth"] = settings.max_depth, settings.roulette_depth
        record["cell_shift"] = self.cell_shift
        record["cells_down"], record["cells_across"] = self.kindness.shape
        return record.tobytes()


ALIKE = Roulette(np.full((1, 1), KINDNESS, np.float32), 3)
"""As kind everywhere."""


def plays(settings: RenderSettings) -> bool:
    """Return whether roulette ends any path."""
    return 0 < settings.roulette_depth < settings.max_depth


def scouted(layout: FilmLayout) -> FilmLayout:
    """Return the tiles that are looked at, spread over the whole film, whatever part of it is rendered."""
    step = 1
    while (layout.full_width // (TILE * step)) * (layout.full_height // (TILE * step)) > MOST_TILES:
        step *= 2
    width, height = (
        min(TILE * max(full // (TILE * step), 1), full) for full in (layout.full_width, layout.full_height)
    )
    first = TILE * ((step - 1) // 2)
    return FilmLayout(layout.full_width, layout.full_height, first, first, width, height, step - 1)


def roulette_of(picture: NDArray[np.floating], layout: FilmLayout) -> Roulette:
    """Return how kind roulette is by a picture (height, width, 3) of the tiles of `scouted`.

    Sums are taken in an order that no processor changes.
    """
    height, width = picture.shape[:2]
    down, across = -(-height // TILE), -(-width // TILE)
    channels = picture.astype(np.float64)
    roots = np.sqrt(np.maximum(channels[..., 0] + channels[..., 1] + channels[..., 2], 0.0))
    split = roots.reshape(down, height // down, across, width // across)
    cells = np.zeros((down, across))
    for y in range(split.shape[1]):
        for x in range(split.shape[3]):
            cells += split[:, y, :, x]
    whole = fsum(cells.ravel()) / cells.size
    if whole <= 0.0:
        return ALIKE
    ratio = whole / np.maximum(cells, whole / KINDEST**0.5)
    shift = (TILE * (layout.tiles_skipped + 1)).bit_length() - 1
    return Roulette((KINDNESS * ratio * ratio).astype(np.float32), shift)
