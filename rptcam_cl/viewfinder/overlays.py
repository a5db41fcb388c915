"""What is laid over the picture: zebra, false colour, focus peaking: masks of the film, and pictures with alpha.

They are computed from the linear film, before it is developed: white balance and tone curve do not move them.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging import srgb_from_linear
from rptcam_cl.viewfinder.histogram import MIDDLE_GREY, strongest

Film = NDArray[np.float32]
Mask = NDArray[np.bool_]
Rgba = NDArray[np.uint8]

STRIPE = 8  # pixels from one zebra stripe to the next
STRIPE_COLOUR = (255, 255, 255, 230)
STRIPE_GAP = (20, 20, 20, 150)
PEAKING_COLOUR = (255, 40, 60, 255)
FALSE_COLOUR_ALPHA = 255
WHITE_EV = float(np.log2(1.0 / MIDDLE_GREY))


def zebra(pixels: Film, level: float = 0.95) -> Mask:
    """Return where (h, w) any channel of the film reaches a level.

    Parameters
    ----------
    level
        Display signal from 0 to 1 as sRGB encodes it, 0.7 being zebra 70 of a video camera; 1 marks what is clipped.
    """
    return np.asarray(strongest(pixels) >= np.float32(linear_from_srgb(level)))


def linear_from_srgb(signal: float) -> float:
    """Return the linear value that sRGB encodes as a signal from 0 to 1 (IEC 61966-2-1)."""
    if not 0 <= signal <= 1:
        raise InputError(f"zebra level: is no display signal (got {signal:g}; allowed: 0 to 1)")
    return signal / 12.92 if signal <= 0.04045 else float(((signal + 0.055) / 1.055) ** 2.4)


def zebra_rgba(mask: Mask) -> Rgba:
    """Return a mask as diagonal stripes (h, w, 4)."""
    light = np.add.outer(np.arange(mask.shape[0]), np.arange(mask.shape[1])) % STRIPE < STRIPE // 2
    picture = np.zeros((*mask.shape, 4), np.uint8)
    picture[mask & light] = STRIPE_COLOUR
    picture[mask & ~light] = STRIPE_GAP
    return picture


@dataclass(frozen=True)
class Band:
    """A range of exposures that false colour shows alike.

    Attributes
    ----------
    name : str
        Zone of Adams's system; V is middle grey.
    low_ev, high_ev : float or None
        Stops from middle grey, the lower one included; None without an end.
    colour : tuple of int
        Red, green and blue codes.
    """

    name: str
    low_ev: float | None
    high_ev: float | None
    colour: tuple[int, int, int]


FALSE_COLOUR: tuple[Band, ...] = (
    Band("0", None, -4.5, (24, 8, 44)),
    Band("I", -4.5, -3.5, (86, 28, 148)),
    Band("II", -3.5, -2.5, (44, 70, 214)),
    Band("III", -2.5, -1.5, (28, 146, 204)),
    Band("IV", -1.5, -0.5, (32, 158, 118)),
    Band("V", -0.5, 0.5, (138, 138, 138)),
    Band("VI", 0.5, 1.5, (150, 196, 60)),
    Band("VII", 1.5, WHITE_EV, (246, 206, 52)),
    Band("clipped", WHITE_EV, None, (226, 32, 40)),
)
"""The scale: a stop to a zone, from black to what is white or more."""


def false_colour_legend() -> list[dict[str, Any]]:
    """Return the scale of false colour as plain values, darkest first."""
    return [asdict(band) for band in FALSE_COLOUR]


def false_colour(pixels: Film) -> NDArray[np.uint8]:
    """Return the place (h, w) in `FALSE_COLOUR` of each pixel, by its luminance."""
    edges = [MIDDLE_GREY * 2.0**band.low_ev for band in FALSE_COLOUR[1:] if band.low_ev is not None]
    bright = luminance(pixels, np.float32)
    return np.asarray(np.searchsorted(np.asarray(edges, np.float32), bright, side="right"), np.uint8)


def false_colour_rgba(index: NDArray[np.uint8]) -> Rgba:
    """Return false colour as an opaque picture (h, w, 4)."""
    table = np.array([(*band.colour, FALSE_COLOUR_ALPHA) for band in FALSE_COLOUR], np.uint8)
    return np.asarray(table[index])


NOISE_SIGMAS = 3.0  # so far noise alone seldom reaches
TILE = 16  # pixels, within which noise is taken as even
SHARE, SHARE_SIGMAS = (
    0.8,
    1.2816,
)  # of a tile's pixels lie below so many sigmas; an edge through it has fewer than the rest
MOST_OF_NOISE = 0.2  # sigma of the display signal for a relative noise of the whole picture of 1; more is texture
ALONG = 2  # pixels either way along an edge, whose mean has less noise
WAYS = ((0, 1), (1, 0), (1, 1), (1, -1))  # rows and columns of a step along it
LEAST_NEIGHBOURS = 2  # of the eight round an edge's pixel; a speck has fewer


def peaking(pixels: Film, level: float = 0.5, noise: float | None = None) -> Mask:
    """Return where (h, w) the film is sharp at the scale of its pixels.

    The display-encoded luminance less its 3 x 3 binomial mean is what only focus gives. Noise is measured in tiles and
    has to be exceeded clearly, by a pixel or by the mean of five in a row, so that a picture of few samples does not
    sparkle and shows its edges early; single pixels do not count.

    Parameters
    ----------
    level
        Sensitivity from 0, the strongest edges alone, to 1.
    noise
        Relative standard error of the picture, where it is known: what varies more in a tile is texture.
    """
    signal = srgb_from_linear(luminance(pixels, np.float32))
    least, most = 0.1 * (1.0 - level) + 0.005, np.inf if noise is None else MOST_OF_NOISE * noise
    contrast = signal - _binomial(signal)
    strong = _exceeds(contrast, least, most)
    for way in WAYS:
        strong |= _exceeds(_along(contrast, way), least, most / np.sqrt(2 * ALONG + 1))
    padded = np.pad(strong, 1).astype(np.uint8)
    near = sum(
        padded[row : row + strong.shape[0], column : column + strong.shape[1]]
        for row in range(3)
        for column in range(3)
    )
    return np.asarray(strong & (near > LEAST_NEIGHBOURS))


def _exceeds(contrast: Film, least: float, most_sigma: float) -> Mask:
    """Return where a contrast is at least so large, and well above its noise, which is at most so large."""
    size = np.abs(contrast)
    sigma = np.minimum(_sigma(size), np.float32(most_sigma))
    return np.asarray(size > np.maximum(np.float32(least), NOISE_SIGMAS * sigma))


def _along(contrast: Film, way: tuple[int, int]) -> Film:
    """Return the mean (h, w) of pixels in a row, the steps between which are given in rows and columns."""
    rows, columns = contrast.shape
    padded = np.pad(contrast, ALONG, mode="edge")
    places = [(ALONG + k * way[0], ALONG + k * way[1]) for k in range(-ALONG, ALONG + 1)]
    parts = [padded[row : row + rows, column : column + columns] for row, column in places]
    return np.asarray(sum(parts) / np.float32(len(parts)))


def _sigma(contrast: Film) -> Film:
    """Return the noise (h, w) of a contrast: that of the noisiest of a pixel's tile and those around it."""
    rows, columns = contrast.shape
    beyond = [(0, -side % TILE) for side in contrast.shape]
    whole = np.pad(contrast, beyond, mode="symmetric")
    tiles = whole.reshape(whole.shape[0] // TILE, TILE, -1, TILE).swapaxes(1, 2).reshape(-1, TILE * TILE)
    place = round(SHARE * TILE * TILE)
    found = np.partition(tiles, place, axis=1)[:, place].reshape(whole.shape[0] // TILE, -1) / np.float32(SHARE_SIGMAS)
    around = np.lib.stride_tricks.sliding_window_view(np.pad(found, 1, mode="edge"), (3, 3)).max(axis=(2, 3))
    return np.asarray(around.repeat(TILE, axis=0).repeat(TILE, axis=1)[:rows, :columns])


def _binomial(signal: Film) -> Film:
    """Return the mean of each pixel's neighbours with the weights 1 2 1 across and down."""
    padded = np.pad(signal, 1, mode="edge")
    across = padded[:, :-2] + 2 * padded[:, 1:-1] + padded[:, 2:]
    return np.asarray((across[:-2] + 2 * across[1:-1] + across[2:]) / np.float32(16))


def peaking_rgba(mask: Mask) -> Rgba:
    """Return a mask as a coloured picture (h, w, 4)."""
    picture = np.zeros((*mask.shape, 4), np.uint8)
    picture[mask] = PEAKING_COLOUR
    return picture


def overlay(picture: NDArray[np.uint8], *layers: Rgba) -> NDArray[np.uint8]:
    """Return a developed picture (h, w, 3) with layers (h, w, 4) over it, the last one on top.

    Raises
    ------
    InputError
        A layer has another size.
    """
    shown = picture.astype(np.float32)
    for layer in layers:
        if layer.shape[:2] != picture.shape[:2]:
            raise InputError(f"overlay: has another size than the picture (got {layer.shape}, {picture.shape})")
        alpha = layer[..., 3:].astype(np.float32) / np.float32(255)
        shown += alpha * (layer[..., :3] - shown)
    return np.asarray(np.floor(shown + np.float32(0.5)), np.uint8)


def magnifier(
    picture: NDArray[Any], x: float, y: float, width: int = 256, height: int = 256
) -> tuple[NDArray[Any], tuple[int, int]]:
    """Return the pixels of a picture round a point, one to one, and the column and row of the first of them.

    Parameters
    ----------
    picture
        (h, w, channels): the film, or what was developed from it.
    x, y
        The point in fractions of the picture from its left and top; near an edge the crop moves inside.
    width, height
        Of the crop; the picture's where that is smaller.
    """
    rows, columns = picture.shape[:2]
    width, height = min(width, columns), min(height, rows)
    left = min(max(round(x * columns - width / 2), 0), columns - width)
    top = min(max(round(y * rows - height / 2), 0), rows - height)
    return picture[top : top + height, left : left + width], (left, top)
