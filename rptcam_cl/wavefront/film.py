"""The film on the device: compensated sums per pixel, stored in 4 x 4 tiles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.scene.film import Film

Scalar = TypeVar("Scalar", bound=np.generic)

TILE = 4
BLOCK = 256  # pixels are padded to this, so that any wave is a whole number of work groups on every device
BYTES_PER_PIXEL = 6 * 4  # three sums and three compensations


@dataclass(frozen=True)
class FilmLayout:
    """Which pixels are rendered and where they lie in the film's buffer.

    Attributes
    ----------
    full_width, full_height : int
        Resolution of the whole film [pixels].
    x, y, width, height : int
        The part that is rendered [pixels].
    """

    full_width: int
    full_height: int
    x: int
    y: int
    width: int
    height: int

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
        """Pixels of the buffer, with the padding of tiles and block."""
        tiles = self.tiles_across * -(-self.height // TILE)
        return -(-tiles * TILE * TILE // BLOCK) * BLOCK

    @property
    def samples_per_spp(self) -> int:
        """Pixels of the picture."""
        return self.width * self.height

    def pixels_within(self, first: int, count: int) -> int:
        """Return how many pixels of the picture lie in a range of whole tiles of the buffer."""
        return self._pixels_before(first + count) - self._pixels_before(first)

    def _pixels_before(self, index: int) -> int:
        row, column = divmod(index // (TILE * TILE), self.tiles_across)
        above = min(TILE * row, self.height)
        deep = min(TILE, self.height - above)
        return above * self.width + deep * min(TILE * column, self.width)

    def picture(self, sums: NDArray[np.float32], spp: int) -> NDArray[np.float32]:
        """Return the mean of ``spp`` samples, shape (height, width, 3), from the buffer ``(6, pixels)``."""
        mean = (sums[:3].astype(np.float64) - sums[3:].astype(np.float64)) / max(spp, 1)
        return np.ascontiguousarray(np.moveaxis(self.in_rows(mean), 0, -1), dtype=np.float32)

    def in_rows(self, planes: NDArray[Scalar]) -> NDArray[Scalar]:
        """Return planes (count, height, width) in rows of the picture, from planes (count, pixels) in tiles."""
        rows = -(-self.height // TILE)
        tiles = planes[:, : rows * self.tiles_across * TILE * TILE]
        tiles = tiles.reshape(-1, rows, self.tiles_across, TILE, TILE).transpose(0, 1, 3, 2, 4)
        whole = tiles.reshape(-1, rows * TILE, self.tiles_across * TILE)
        return whole[:, : self.height, : self.width]
