"""White balance: what the picture's light is taken to be, and the matrix on linear RGB that makes it grey."""

from __future__ import annotations

import warnings
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import BRADFORD, RGB_FROM_XYZ, SRGB_WHITE, XYZ_FROM_RGB, Matrix, adaptation, xyz_of
from rptcam_cl.core.dataclass import dataclass

Pixels = NDArray[np.float32]
Colour = NDArray[np.float64]
Part = tuple[float, float, float, float]
Adaptation = Literal["channels", "bradford"]

WHOLE: Part = (0.0, 1.0, 0.0, 1.0)
_NEIGHBOURS = 2  # pixels on each side of a point that are averaged with it
_ROUNDING = 1e-6  # pixels: a point between two belongs to the same one in a part of the film as in the whole
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
        half = len(self.place) // 2
        across, down = (
            [(edge - start) / (end - start) * count for edge in edges]
            for edges, start, end, count in (
                (self.place[:half], *part[:2], shape[1]),
                (self.place[half:], *part[2:], shape[0]),
            )
        )
        return _pixels(down, shape[0]), _pixels(across, shape[1])


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


def _pixels(edges: list[float], count: int) -> slice:
    """Return the pixels of a row or column between two edges, or round a point, in pixels."""
    if len(edges) == 2:
        first = min(max(round(edges[0]), 0), count - 1)
        return slice(first, max(round(edges[1]), first + 1))
    middle = min(max(int(edges[0] + _ROUNDING), 0), count - 1)
    return slice(max(middle - _NEIGHBOURS, 0), middle + _NEIGHBOURS + 1)


def _mean(colours: Pixels) -> Colour:
    return np.asarray(colours.reshape(-1, 3).mean(axis=0, dtype=np.float64))
