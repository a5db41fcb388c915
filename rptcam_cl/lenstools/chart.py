"""Axes with ticks on a picture: curves and dots in the units of the data."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rptcam_cl.lenstools.picture import GRID, INK, Dots, Drawing, Path, Point, Text

WIDTH, HEIGHT = 720.0, 460.0
BOX = (70.0, 46.0, 690.0, 350.0)  # left, top, right, bottom of a chart that fills its picture [pixels]


@dataclass(frozen=True)
class Axes:
    """A rectangle of a picture that stands for ranges of x and y.

    Attributes
    ----------
    picture : Drawing
    box : tuple of float
        Left, top, right and bottom edge [pixels].
    x_range, y_range : tuple of float
        Values at the left and right, and at the lower and upper edge.
    """

    picture: Drawing
    box: tuple[float, float, float, float]
    x_range: tuple[float, float]
    y_range: tuple[float, float]

    def place(self, x: float, y: float) -> Point:
        """Return the pixel of a pair of values."""
        left, top, right, bottom = self.box
        across = (x - self.x_range[0]) / (self.x_range[1] - self.x_range[0])
        up = (y - self.y_range[0]) / (self.y_range[1] - self.y_range[0])
        return left + across * (right - left), bottom - up * (bottom - top)

    def frame(self, x_label: str, y_label: str) -> None:
        """Draw the frame, a grid at round values, their numbers and the names of the axes."""
        left, top, right, bottom = self.box
        for value in ticks(*self.x_range):
            x, _ = self.place(value, self.y_range[0])
            self.picture.add(Path([(x, top), (x, bottom)], GRID, 0.7))
            self.picture.add(Text((x, bottom + 16), f"{value:g}", 11, "middle"))
        for value in ticks(*self.y_range):
            _, y = self.place(self.x_range[0], value)
            self.picture.add(Path([(left, y), (right, y)], GRID, 0.7))
            self.picture.add(Text((left - 6, y + 4), f"{value:g}", 11, "end"))
        self.picture.add(Path([(left, top), (right, top), (right, bottom), (left, bottom)], INK, 1.0, closed=True))
        self.picture.add(Text(((left + right) / 2, bottom + 36), x_label, 12, "middle"))
        self.picture.add(Text((left - 48, (top + bottom) / 2), y_label, 12, "middle", turned=True))

    def curve(self, x: ArrayLike, y: ArrayLike, colour: str, dash: tuple[float, ...] = ()) -> None:
        """Draw a curve; values that are not numbers leave a gap."""
        xs, ys = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
        good = np.isfinite(xs) & np.isfinite(ys)
        for part in np.split(np.arange(len(xs)), np.flatnonzero(np.diff(good.astype(int))) + 1):
            if len(part) > 1 and good[part[0]]:
                places = [self.place(float(xs[i]), float(ys[i])) for i in part]
                self.picture.add(Path(places, colour, 1.8, dash=dash))

    def dots(self, x: ArrayLike, y: ArrayLike, colour: str, radius: float = 0.8) -> None:
        """Draw dots."""
        pairs = zip(np.asarray(x).tolist(), np.asarray(y).tolist(), strict=True)
        self.picture.add(Dots([self.place(*pair) for pair in pairs], radius, colour))


@dataclass(frozen=True)
class Legend:
    """One entry of the key below a chart."""

    label: str
    colour: str
    dash: tuple[float, ...] = ()


def chart(
    title: str,
    labels: tuple[str, str],
    x_range: tuple[float, float],
    y_range: tuple[float, float],
    keys: Sequence[Legend] = (),
) -> Axes:
    """Return empty axes that fill a picture, with a title above and a key below."""
    picture = Drawing(WIDTH, HEIGHT, title)
    picture.add(Text((BOX[0], 28), title, 15))
    axes = Axes(picture, BOX, x_range, y_range)
    axes.frame(*labels)
    draw_key(picture, keys, HEIGHT - 46)
    return axes


def draw_key(picture: Drawing, keys: Sequence[Legend], top: float) -> None:
    """Draw the key in as many lines as it takes."""
    x, y = BOX[0], top
    for key in keys:
        width = 30 + 7 * len(key.label) + 18
        if x + width > picture.width and x > BOX[0]:
            x, y = BOX[0], y + 18
        picture.add(Path([(x, y - 4), (x + 24, y - 4)], key.colour, 2.2, dash=key.dash))
        picture.add(Text((x + 30, y), key.label, 12))
        x += width


def ticks(low: float, high: float, most: int = 8) -> list[float]:
    """Return round values between two others, at most so many."""
    span = high - low
    unit = 10.0 ** math.floor(math.log10(span / most))
    step = next(unit * factor for factor in (1, 2, 5, 10, 20) if span / (unit * factor) <= most)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [round(i * step, 12) for i in range(first, last + 1)]


def padded(values: ArrayLike, floor: float | None = None) -> tuple[float, float]:
    """Return a range that holds values with a margin; `floor` replaces its lower end."""
    array = np.asarray(values, dtype=np.float64)
    array = array[np.isfinite(array)]
    low, high = (float(array.min()), float(array.max())) if array.size else (0.0, 1.0)
    margin = 0.06 * (high - low) or 0.06 * abs(high) or 1.0
    return (low - margin if floor is None else floor), high + margin
