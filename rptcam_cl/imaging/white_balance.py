"""White balance: what the picture's light is taken to be, and the matrix on linear RGB that makes it grey."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.imaging.colour import (
    BRADFORD,
    RGB_FROM_XYZ,
    SRGB_WHITE,
    XYZ_FROM_RGB,
    Matrix,
    adaptation,
    xyz_of,
)

Pixels = NDArray[np.float32]
Part = tuple[float, float, float, float]

WHOLE: Part = (0.0, 1.0, 0.0, 1.0)
_NEIGHBOURS = 2  # pixels on each side of a point that are averaged with it


@dataclass(frozen=True)
class KnownLight:
    """The scene's light by its linear sRGB colour; it is adapted to the white of sRGB."""

    colour: tuple[float, float, float]

    def matrix(self, linear: Pixels, part: Part) -> Matrix:
        """Return the 3 x 3 matrix for colours as columns."""
        return _from_light(XYZ_FROM_RGB @ np.array(self.colour))


@dataclass(frozen=True)
class Gains:
    """Factors on red, green and blue."""

    factors: tuple[float, float, float]

    def matrix(self, linear: Pixels, part: Part) -> Matrix:
        """Return the 3 x 3 matrix for colours as columns."""
        return np.diag(np.array(self.factors, np.float64))


@dataclass(frozen=True)
class Grey:
    """A place that is grey in truth: a point [x, y] or a rectangle [x0, x1, y0, y1] in fractions of the film."""

    place: tuple[float, ...]

    def matrix(self, linear: Pixels, part: Part) -> Matrix:
        """Return the 3 x 3 matrix for colours as columns."""
        return _from_grey(linear[self._window(linear.shape, part)], "the grey place")

    def _window(self, shape: tuple[int, ...], part: Part) -> tuple[slice, slice]:
        """Return rows and columns of the pixels in the place, at least one."""
        x0, x1, y0, y1 = part
        place = self.place if len(self.place) == 4 else (self.place[0], self.place[0], self.place[1], self.place[1])
        margin = 0 if len(self.place) == 4 else _NEIGHBOURS
        across = _pixels((place[0] - x0) / (x1 - x0), (place[1] - x0) / (x1 - x0), shape[1], margin)
        down = _pixels((place[2] - y0) / (y1 - y0), (place[3] - y0) / (y1 - y0), shape[0], margin)
        return down, across


@dataclass(frozen=True)
class GreyWorld:
    """The picture's mean is grey (G. Buchsbaum, J. Franklin Institute 310, 1980); pixels beyond white do not count."""

    def matrix(self, linear: Pixels, part: Part) -> Matrix:
        """Return the 3 x 3 matrix for colours as columns."""
        shown = (linear <= 1).all(axis=-1)
        return _from_grey(linear[shown] if shown.any() else linear, "the picture")


WhiteBalance = KnownLight | Gains | Grey | GreyWorld


def _pixels(start: float, end: float, count: int, margin: int) -> slice:
    """Return the pixels of a row or column that a span of fractions touches."""
    first = min(max(int(start * count), 0), count - 1)
    last = min(max(int(np.ceil(end * count)), first + 1), count)
    return slice(max(first - margin, 0), last + margin)


def _from_light(xyz: NDArray[np.float64]) -> Matrix:
    """Return the matrix that makes a light of any luminance grey and keeps its luminance."""
    adapted: Matrix = RGB_FROM_XYZ @ adaptation(xyz / xyz[1], xyz_of(SRGB_WHITE)) @ XYZ_FROM_RGB
    return adapted


def _from_grey(colours: Pixels, name: str) -> Matrix:
    """Return the matrix that makes the mean of colours grey; that of no change where it cannot be."""
    xyz = XYZ_FROM_RGB @ colours.reshape(-1, 3).mean(axis=0, dtype=np.float64)
    if xyz[1] <= 0 or (BRADFORD @ xyz <= 1e-3 * xyz[1]).any():
        warnings.warn(f"white balance: {name} is black or too colourful to be grey; left as it is", stacklevel=2)
        return np.eye(3)
    return _from_light(xyz)
