"""Which tiles of the film are rendered: all, or some spread evenly, at the resolution of the picture itself.

A picture made smaller would hide what an inaccurate camera does to fine detail; tiles of the true one do not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.rendering import TILE, TILE_PIXELS, FilmLayout


@dataclass(frozen=True)
class SpreadTiles:
    """One tile in each cell of a grid over the film.

    Attributes
    ----------
    tiles : (n,) array
        Numbers of the tiles, row by row of the grid.
    shape : (rows, columns)
        Of the grid.
    pixels : (p,) array
        Where their pixels lie in the film's buffer.
    cell : (p,) array
        Which tile of `tiles` a pixel is in.
    weights : (p,) array
        Share of the picture that a pixel stands for; 1 in all.
    all : int
        Tiles that the picture has.
    """

    tiles: NDArray[np.uint32]
    shape: tuple[int, int]
    pixels: NDArray[np.int64]
    cell: NDArray[np.int64]
    weights: NDArray[np.float64]
    all: int

    def some(self, chosen: NDArray[np.int64]) -> SpreadTiles:
        """Return a few of the tiles, by their places in `tiles`; each pixel stands for what it did."""
        of_cell = np.full(len(self.tiles), -1)
        of_cell[chosen] = np.arange(len(chosen))
        cell = of_cell[self.cell]
        kept = cell >= 0
        shape = (1, len(chosen))
        return SpreadTiles(self.tiles[chosen], shape, self.pixels[kept], cell[kept], self.weights[kept], self.all)


def spread_tiles(layout: FilmLayout, most: int, rng: np.random.Generator) -> SpreadTiles:
    """Return at most so many tiles, at a random place in cells of equal size; all where there are no more."""
    across, down = layout.tiles_across, -(-layout.height // TILE)
    columns, rows = across, down
    if across * down > most:
        columns = min(max(round((most * across / down) ** 0.5), 1), across, most)
        rows = min(max(most // columns, 1), down)
    x_edges, y_edges = (np.arange(n + 1) * of // n for n, of in ((columns, across), (rows, down)))
    x = rng.integers(x_edges[:-1], x_edges[1:], size=(rows, columns))
    y = rng.integers(y_edges[:-1, None], y_edges[1:, None], size=(rows, columns))
    tiles = (y * across + x).ravel().astype(np.uint32)
    cells = np.outer(np.diff(y_edges), np.diff(x_edges)).ravel()
    buffer = (tiles[:, None].astype(np.int64) * TILE_PIXELS + np.arange(TILE_PIXELS)).ravel()
    inside = layout.inside[buffer]
    cell = np.repeat(np.arange(len(tiles)), TILE_PIXELS)
    full = len(tiles) == across * down
    weights = np.ones(len(cell)) if full else cells[cell] / layout.pixels_of_tile[tiles][cell].clip(1)
    weights = weights[inside] / weights[inside].sum()
    return SpreadTiles(tiles, (rows, columns), buffer[inside], cell[inside], weights, layout.tiles)
