"""From linear film values to the picture that a screen shows."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.imaging.tone import aces, agx, reinhard, srgb_from_linear
from rptcam_cl.imaging.white_balance import WHOLE, Adaptation, Part, WhiteBalance, balance_matrix

Pixels = NDArray[np.float32]
Tone = Literal["srgb", "linear", "reinhard", "aces", "agx"]
Gamut = Literal["clip", "desaturate"]

BAND_PIXELS = 1 << 18  # developed at a time
_LARGEST = np.float32(1e30)  # leaves room for products; far beyond the white of any curve


@dataclass(frozen=True)
class Development:
    """How a film becomes a picture: white balance, exposure, tone curve, gamut, encoding, in this order.

    Attributes
    ----------
    ev : float
        Exposure compensation [stops]; +1 doubles the values.
    white_balance : KnownLight, Gains, Grey or GreyWorld, optional
        What is made grey; by default colours stay.
    adaptation : str
        What the white balance scales: the channels, or the responses of the Bradford transform.
    tone : str
        The tone curve. `linear` is the only one that is not encoded as sRGB.
    tone_white : float
        Luminance that `reinhard` shows as white.
    gamut : str
        What becomes of colours that the display cannot show: each channel is clipped, or the colour is moved towards
        the grey of its luminance.
    bits : int, optional
        Bits per channel in PNG and TIFF files; by default 8 in PNG and 16 in TIFF.
    jpeg_quality : int
        1 to 100.
    """

    ev: float = 0.0
    white_balance: WhiteBalance | None = None
    adaptation: Adaptation = "channels"
    tone: Tone = "srgb"
    tone_white: float = 4.0
    gamut: Gamut = "clip"
    bits: Literal[8, 16] | None = None
    jpeg_quality: int = 95


PLAIN = Development()


def developed_values(pixels: NDArray[np.floating], development: Development = PLAIN, part: Part = WHOLE) -> Pixels:
    """Return the display-encoded picture, (height, width, 3) in 0..1.

    Parameters
    ----------
    pixels
        (height, width, 3), linear; 1 is white with `srgb` and `linear` at ``ev`` 0. Not-a-number becomes 0.
    development
        How to develop; by default as sRGB, clipped.
    part
        Which part of the film the pixels are: x0, x1, y0, y1 in fractions from its left and top.
    """
    bands = [band for _, band in _bands(np.asarray(pixels), development, part)]
    return np.concatenate(bands) if len(bands) > 1 else bands[0]


def developed_codes(
    pixels: NDArray[np.floating], development: Development, part: Part, bits: int
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Return the developed picture in codes of 8 or 16 bits; in memory there is never more of it than some rows."""
    codes = np.empty(pixels.shape, np.uint8 if bits == 8 else np.uint16)
    for rows, band in _bands(pixels, development, part):
        codes[rows] = quantised(band, bits)
    return codes


def _bands(pixels: NDArray[np.floating], development: Development, part: Part) -> Iterator[tuple[slice, Pixels]]:
    """Yield runs of rows, developed; the white balance is that of the whole."""
    matrix = None
    if development.white_balance is not None:
        whole = _exposed(np.asarray(pixels, np.float32), development.ev)
        matrix = balance_matrix(development.white_balance, whole, part, development.adaptation).T.astype(np.float32)
        del whole
    step = max(1, BAND_PIXELS // max(1, pixels.shape[1]))
    for start in range(0, len(pixels), step):
        rows = slice(start, start + step)
        exposed = _exposed(np.asarray(pixels[rows], np.float32), development.ev)
        toned = _toned(
            _without_negatives(exposed if matrix is None else exposed @ matrix, development.gamut), development
        )
        shown = _below_one(_without_negatives(toned, development.gamut), development.gamut)
        yield rows, shown if development.tone == "linear" else srgb_from_linear(shown)


def quantised(encoded: Pixels, bits: int) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Return the nearest codes of 8 or 16 bits of values in 0..1."""
    nearest = encoded * np.float32(2**bits - 1) + np.float32(0.5)
    return nearest.astype(np.uint8) if bits == 8 else nearest.astype(np.uint16)


def _exposed(pixels: Pixels, ev: float) -> Pixels:
    with np.errstate(over="ignore"):  # beyond float32 is white all the same
        scaled = np.nan_to_num(pixels, nan=0.0) * np.float32(2.0**ev)
    clipped: Pixels = np.clip(scaled, -_LARGEST, _LARGEST)
    return clipped


def _toned(linear: Pixels, development: Development) -> Pixels:
    if development.tone == "reinhard":
        return reinhard(linear, development.tone_white)
    if development.tone == "aces":
        return aces(linear)
    return agx(linear) if development.tone == "agx" else linear


def _without_negatives(linear: Pixels, gamut: Gamut) -> Pixels:
    if gamut == "clip":
        return np.maximum(linear, np.float32(0))
    grey = np.maximum(luminance(linear, np.float32)[..., None], np.float32(0))
    depth = grey - linear.min(axis=-1, keepdims=True)
    return np.maximum(_towards(grey, linear, room=grey, reach=depth), np.float32(0))


def _below_one(linear: Pixels, gamut: Gamut) -> Pixels:
    if gamut == "clip":
        return np.minimum(linear, np.float32(1))
    grey = np.minimum(luminance(linear, np.float32)[..., None], np.float32(1))
    height = linear.max(axis=-1, keepdims=True) - grey
    return np.minimum(_towards(grey, linear, room=1 - grey, reach=height), np.float32(1))


def _towards(grey: Pixels, linear: Pixels, room: Pixels, reach: Pixels) -> Pixels:
    """Return colours moved to their greys where a channel reaches further from it than there is room."""
    outside = reach > room
    share = np.divide(room, reach, out=np.ones_like(grey), where=outside)
    return np.where(outside, grey + share * (linear - grey), linear)
