"""White balance: what the picture's light is taken to be, and the matrix on linear RGB that makes it grey."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Literal

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
Colour = NDArray[np.float64]
Part = tuple[float, float, float, float]
Adaptation = Literal["channels", "bradford"]

WHOLE: Part = (0.0, 1.0, 0.0, 1.0)
_NEIGHBOURS = 2  # pixels on each side of a point that are averaged with it
_LEAST = 1e-3  # of a light's luminance that each of three responses must have to be scaled to white


@dataclass(frozen=True)
class KnownLight:
    """The scene's light by its linear sRGB colour."""

    colour: tuple[float, float, float]

    def light(self, linear: Pixels, part: Part) -> Colour:
        """Return the light's linear sRGB colour."""
        return np.array(self.colour)


@dataclass(frozen=True)
class Grey:
    """A place that is grey in truth: a point [x, y] or a rectangle [x0, x1, y0, y1] in fractions of the film."""

    place: tuple[float, ...]

    def light(self, linear: Pixels, part: Part) -> Colour:
        """Return the mean linear sRGB colour there."""
        return _mean(linear[self._window(linear.shape, part)])

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

    def light(self, linear: Pixels, part: Part) -> Colour:
        """Return the mean linear sRGB colour."""
        shown = (linear <= 1).all(axis=-1)
        return _mean(linear[shown] if shown.any() else linear)


@dataclass(frozen=True)
class Gains:
    """Factors on red, green and blue."""

    factors: tuple[float, float, float]


WhiteBalance = KnownLight | Gains | Grey | GreyWorld


def balance_matrix(balance: WhiteBalance, linear: Pixels, part: Part, by: Adaptation) -> Matrix:
    """Return the 3 x 3 matrix for linear colours as columns; that of no change where there is no light to balance.

    Parameters
    ----------
    balance
        What is to become grey, keeping its luminance, or the factors themselves.
    linear
        The picture, (height, width, 3).
    part
        Which part of the film it is.
    by
        Whether red, green and blue are scaled, or the responses of the Bradford transform. A light without red, green
        or blue can only be balanced by these.
    """
    if isinstance(balance, Gains):
        return np.diag(np.array(balance.factors, np.float64))
    light = balance.light(linear, part)
    xyz = XYZ_FROM_RGB @ light
    if xyz[1] <= 0 or (BRADFORD @ xyz <= _LEAST * xyz[1]).any():
        warnings.warn(
            "white balance: what should be grey is black or of no colour that light has; left as it is", stacklevel=2
        )
        return np.eye(3)
    if by == "channels" and (light > _LEAST * xyz[1]).all():
        return np.diag(xyz[1] / light)
    adapted: Matrix = RGB_FROM_XYZ @ adaptation(xyz / xyz[1], xyz_of(SRGB_WHITE)) @ XYZ_FROM_RGB
    return adapted


def _pixels(start: float, end: float, count: int, margin: int) -> slice:
    """Return the pixels of a row or column that a span of fractions touches."""
    first = min(max(int(start * count), 0), count - 1)
    last = min(max(int(np.ceil(end * count)), first + 1), count)
    return slice(max(first - margin, 0), last + margin)


def _mean(colours: Pixels) -> Colour:
    return np.asarray(colours.reshape(-1, 3).mean(axis=0, dtype=np.float64))
