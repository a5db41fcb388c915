"""A map of the picture, a rectangle for each rendered tile, by how much it differs."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.lensview.picture import INK, Path, Picture, Point, Text

LOW, HIGH = 0.003, 1.0  # relative differences between which the shade changes, by logarithm
SHADES = ((247, 247, 250), (170, 195, 222), (60, 110, 165), (96, 40, 110), (40, 5, 40))


def draw_map(picture: Picture, corner: Point, size: Point, bias: NDArray[np.float64]) -> None:
    """Draw squared differences (rows, columns) of tiles as a map with its upper left corner at a point."""
    rows, columns = bias.shape
    width, height = size[0] / columns, size[1] / rows
    for (y, x), value in np.ndenumerate(bias):
        left, top = corner[0] + x * width, corner[1] + y * height
        picture.add(_box((left, top), (width, height), _shade(math.sqrt(max(value, 0.0)))))
    picture.add(Path(_corners(corner, size), INK, 0.8, closed=True))


def map_scale(picture: Picture, corner: Point) -> None:
    """Draw what the shades stand for."""
    steps, width = 60, 4.0
    for step in range(steps):
        value = LOW * (HIGH / LOW) ** ((step + 0.5) / steps)
        picture.add(_box((corner[0] + step * width, corner[1]), (width, 10.0), _shade(value)))
    for value in (0.003, 0.01, 0.03, 0.1, 0.3, 1.0):
        at = corner[0] + steps * width * math.log(value / LOW) / math.log(HIGH / LOW)
        picture.add(Text((at, corner[1] + 22), f"{100 * value:g} %", 10, "middle"))


def _shade(value: float) -> str:
    share = math.log(max(value, LOW) / LOW) / math.log(HIGH / LOW)
    at = np.linspace(0, 1, len(SHADES))
    return "#" + "".join(f"{round(float(np.interp(share, at, channel))):02x}" for channel in zip(*SHADES, strict=True))


def _box(corner: Point, size: Point, fill: str) -> Path:
    return Path(_corners(corner, size), fill, 0.4, fill=fill, closed=True)


def _corners(corner: Point, size: Point) -> list[Point]:
    (left, top), (width, height) = corner, size
    return [(left, top), (left + width, top), (left + width, top + height), (left, top + height)]
