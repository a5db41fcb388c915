"""Which part of a film one of several runs renders, each anywhere: tiles of the picture, and samples of its pixels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering.film import TILE_PIXELS
from rptcam_cl.rendering.shares import GOLDEN

Arrays = dict[str, NDArray[Any]]
SHARP = "sharp:"  # begins the names of those of sharp layers
IN_PIXELS = ("film", "layers", SHARP)  # begin the names of those whose last axis is the pixels of the film's buffer


@dataclass(frozen=True)
class FilmPart:
    """Tiles and samples of a film.

    Attributes
    ----------
    number, count : int
        Part ``number`` of ``count`` parts with as many tiles each, give or take one, from 1 on.
    first : int
        The first sample of its pixels.
    end : int or None
        The sample that it ends before; None: as the render says.
    """

    number: int = 1
    count: int = 1
    first: int = 0
    end: int | None = None

    def check(self, tiles: int) -> None:
        """Refuse a part of a film with so many tiles that would have none.

        Raises
        ------
        InputError
        """
        if self.count > tiles:
            raise InputError(
                f"part: the film has fewer tiles of 8 x 8 pixels than parts (got {self.number}/{self.count}; allowed:"
                f" at most {tiles} parts, or parts by samples)"
            )

    def tiles(self, tiles: int) -> NDArray[np.uint32]:
        """Return which of so many tiles are its own; those of one part are spread over the picture."""
        places = np.argsort(np.modf((np.arange(tiles) + 0.5) * GOLDEN)[0], kind="stable")
        bounds = [tiles * each // self.count for each in (self.number - 1, self.number)]
        return np.sort(places[slice(*bounds)]).astype(np.uint32)

    def samples_of_tiles(self, ends: NDArray[np.uint32], tiles: int) -> NDArray[np.uint32]:
        """Return how many samples per pixel each tile of the buffer has, from the sample that it is rendered up to."""
        if self == WHOLE:
            return ends
        own, samples = self.tiles(tiles), np.zeros_like(ends)
        samples[own] = ends[own] - self.first
        return samples

    def packed(self, arrays: Arrays, tiles: int) -> Arrays:
        """Return the arrays of a saved render with its own tiles alone."""
        if self.count == 1:
            return arrays
        pixels = pixels_of(self.tiles(tiles))
        return arrays | {name: array[:, pixels] for name, array in arrays.items() if name.startswith(IN_PIXELS)}

    def unpacked(self, arrays: Arrays, tiles: int, pixels: int) -> Arrays:
        """Return the arrays that `packed` was given, of a buffer of so many pixels, other tiles empty.

        Arrays that do not fit are left as they are.
        """
        own = pixels_of(self.tiles(tiles))
        found = dict(arrays)
        for name, packed in arrays.items():
            if self.count > 1 and name.startswith(IN_PIXELS) and packed.ndim == 2 and packed.shape[1] == len(own):
                found[name] = np.zeros((len(packed), pixels), packed.dtype)
                found[name][:, own] = packed
        return found

    def facts(self) -> list[int | None] | None:
        """Return what a saved render says of it: number, count, first sample and end; None for the whole."""
        return None if self == WHOLE else [self.number, self.count, self.first, self.end]

    @property
    def title(self) -> str:
        """Its name as people read it."""
        names = [f"part {self.number}/{self.count}"] if self.count > 1 else []
        if self.end is not None:
            names.append(f"samples {self.first}:{self.end}")
        return ", ".join(names) or "the whole film"


WHOLE = FilmPart()


def part_of_facts(facts: Any) -> FilmPart:
    """Return the part that `FilmPart.facts` described.

    Raises
    ------
    ValueError
        They describe none.
    """
    if facts is None:
        return WHOLE
    number, count, first, end = facts
    if not all(type(value) is int and 0 <= value < 2**32 for value in (number, count, first)):
        raise ValueError("part")
    if not 1 <= number <= count or not (end is None or (type(end) is int and first < end < 2**32)):
        raise ValueError("part")
    return FilmPart(number, count, first, end)


def pixels_of(tiles: NDArray[np.uint32]) -> NDArray[np.int64]:
    """Return the pixels of some tiles in the film's buffer."""
    return (tiles.astype(np.int64)[:, None] * TILE_PIXELS + np.arange(TILE_PIXELS)).ravel()
