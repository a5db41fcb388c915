"""The film on the device: compensated sums per pixel, in tiles of 8 x 8 pixels, each of four of 4 x 4."""

from __future__ import annotations

from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.scene import Film

Scalar = TypeVar("Scalar", bound=np.generic)

TILE = 8
QUARTER = 4  # neighbouring lanes share a square of so many pixels
TILE_PIXELS = TILE * TILE
SPARE_TILES = 3  # behind those of the picture, so that any number of tiles can be filled up to a block
BAND = 4  # rows of tiles that are made a picture at a time: so many stay in a processor's cache
BLOCK = 256  # pixels are padded to this, so that any wave is a whole number of work groups on every device
PLANES = 6  # three sums and three compensations; a limit of the samples adds what it has removed


@dataclass(frozen=True)
class FilmLayout:
    """Which pixels are rendered and where they lie in the film's buffer.

    Attributes
    ----------
    full_width, full_height : int
        Resolution of the whole film [pixels].
    x, y, width, height : int
        The part that is rendered [pixels].
    tiles_skipped : int
        Tiles of the film that are left out behind each tile in a row, and behind each row.
    """

    full_width: int
    full_height: int
    x: int
    y: int
    width: int
    height: int
    tiles_skipped: int = 0

    @classmethod
    def of(cls, film: Film) -> FilmLayout:
        """Return the layout of a film; its crop is rounded to whole pixels, at least one."""
        width, height = film.resolution
        x0, x1, y0, y1 = film.crop or (0.0, 1.0, 0.0, 1.0)
        left, top = min(round(x0 * width), width - 1), min(round(y0 * height), height - 1)
        return cls(width, height, left, top, max(round(x1 * width) - left, 1), max(round(y1 * height) - top, 1))

    @property
    def tiles_across(self) -> int:
        """Tiles per row."""
        return -(-self.width // TILE)

    @property
    def pixels(self) -> int:
        """Pixels of the buffer, with the padding of tiles and block and with the spare tiles."""
        return -(-(self.tiles + SPARE_TILES) * TILE_PIXELS // BLOCK) * BLOCK

    @property
    def tiles(self) -> int:
        """Tiles of the picture."""
        return self.tiles_across * -(-self.height // TILE)

    @property
    def samples_per_spp(self) -> int:
        """Pixels of the picture."""
        return self.width * self.height

    @cached_property
    def pixels_of_tile(self) -> NDArray[np.int64]:
        """Pixels of the picture in each tile of the buffer."""
        across = np.clip(self.width - TILE * np.arange(self.tiles_across), 0, TILE)
        down = np.clip(self.height - TILE * np.arange(-(-self.height // TILE)), 0, TILE)
        spare = self.pixels // TILE_PIXELS - self.tiles
        return np.append(np.outer(down, across).ravel(), np.zeros(spare, np.int64))

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """Whether a pixel of the buffer belongs to the picture."""
        found = np.zeros(self.pixels, np.bool_)
        found[self.in_rows(np.arange(self.pixels)[None]).ravel()] = True
        return found

    def whole_list(self) -> NDArray[np.uint32]:
        """Return the list of all tiles, filled up to whole blocks."""
        return np.arange(self.pixels // TILE_PIXELS, dtype=np.uint32)

    def filled_list(self, tiles: NDArray[np.uint32]) -> NDArray[np.uint32]:
        """Return a list of tiles filled up to whole blocks with tiles that hold no pixel of the picture."""
        missing = -len(tiles) % (BLOCK // TILE_PIXELS)
        return np.append(tiles, self.tiles + np.arange(missing)).astype(np.uint32)

    def picture(self, sums: NDArray[np.float32], spp: NDArray[np.uint32]) -> NDArray[np.float32]:
        """Return the mean, shape (height, width, 3), from the buffer ``(6, pixels)`` and the samples per tile."""
        rows, across, halves = -(-self.height // TILE), self.tiles_across, TILE // QUARTER
        whole = np.empty((rows, halves, QUARTER, across, halves, QUARTER, 3), np.float32)
        for first in range(0, rows, BAND):
            tiles = slice(first * across, min(first + BAND, rows) * across)
            pixels = slice(tiles.start * TILE_PIXELS, tiles.stop * TILE_PIXELS)
            mean = np.subtract(sums[:3, pixels], sums[3:, pixels], dtype=np.float64)
            mean /= np.repeat(np.maximum(spp[tiles], 1), TILE_PIXELS)
            split = mean.reshape(3, -1, across, halves, halves, QUARTER, QUARTER)
            whole[first : first + BAND] = split.transpose(1, 3, 5, 2, 4, 6, 0)
        return np.ascontiguousarray(whole.reshape(rows * TILE, across * TILE, 3)[: self.height, : self.width])

    def in_tiles(self, rows: NDArray[Any]) -> NDArray[Any]:
        """Return planes (count, pixels) in tiles, from values (height, width) or (height, width, count) in rows."""
        planes = np.zeros((rows.shape[2] if rows.ndim > 2 else 1, self.pixels), rows.dtype)
        planes[:, self.in_rows(np.arange(self.pixels)[None]).ravel()] = rows.reshape(self.samples_per_spp, -1).T
        return planes

    def in_rows(self, planes: NDArray[Scalar]) -> NDArray[Scalar]:
        """Return planes (count, height, width) in rows of the picture, from planes (count, pixels) in tiles."""
        rows, across, halves = -(-self.height // TILE), self.tiles_across, TILE // QUARTER
        tiles = planes[:, : self.tiles * TILE_PIXELS]
        split = tiles.reshape(-1, rows, across, halves, halves, QUARTER, QUARTER).transpose(0, 1, 3, 5, 2, 4, 6)
        whole = split.reshape(-1, rows * TILE, across * TILE)
        return whole[:, : self.height, : self.width]
