"""Tone curves: from linear light without an upper limit to the linear light of a display, and sRGB's encoding of it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import pixel_luminance

Pixels = NDArray[np.float32]

FILMIC_WHITE = 7.25  # from here on the fit is above 1
GREY = 0.18
STOPS_BELOW, STOPS_ABOVE = 10.0, 6.5  # around grey, between the black and the white of `agx`
INSET = 0.2  # share of the mean of the channels that `agx` mixes into each


def srgb_from_linear(linear: NDArray[np.floating]) -> Pixels:
    """sRGB-encoded values of linear ones, both in 0..1 (IEC 61966-2-1).

    Values outside 0..1 are clipped; not-a-number becomes 0.
    """
    clipped: Pixels = np.clip(np.nan_to_num(linear, nan=0.0), 0.0, 1.0).astype(np.float32, copy=False)
    foot = clipped * np.float32(12.92)
    curve = np.float32(1.055) * clipped ** np.float32(1 / 2.4) - np.float32(0.055)
    return np.where(clipped <= np.float32(0.0031308), foot, curve)


def linear_from_srgb(encoded: Pixels) -> Pixels:
    """Linear values of sRGB-encoded ones in 0..1 (IEC 61966-2-1)."""
    curve = ((encoded + np.float32(0.055)) / np.float32(1.055)) ** np.float32(2.4)
    return np.where(encoded <= np.float32(0.04045), encoded / np.float32(12.92), curve)


def reinhard(linear: Pixels, white: float) -> Pixels:
    """Reinhard, Stark, Shirley and Ferwerda, SIGGRAPH 2002, eq. 4, on luminance: hue and saturation stay.

    Parameters
    ----------
    linear
        Colours (…, 3) from 0 up.
    white
        Luminance that becomes 1.
    """
    brightness = pixel_luminance(linear)
    shown: Pixels = linear * ((1 + brightness / np.float32(white**2)) / (1 + brightness))
    return shown


def filmic(linear: Pixels) -> Pixels:
    """K. Narkowicz, "ACES Filmic Tone Mapping Curve", 2016: his fit of the ACES reference rendering, per channel."""
    x = np.minimum(linear, np.float32(FILMIC_WHITE))
    fit: Pixels = x * (np.float32(2.51) * x + np.float32(0.03))
    fit /= x * (np.float32(2.43) * x + np.float32(0.59)) + np.float32(0.14)
    return np.minimum(fit, np.float32(1))


def agx(linear: Pixels) -> Pixels:
    """A curve in the manner of T. Sobotka's AgX, with constants of our own; docs/picture.md derives them.

    Some of the channels' mean is mixed into each, a sigmoid shapes the logarithm of each channel, and the mixing is
    undone: colours lose saturation towards white instead of turning to the nearest primary. Grey stays grey, 0.18
    stays 0.18; the result may leave 0..1 a little.
    """
    mixed = linear + np.float32(INSET) * (linear.mean(axis=-1, keepdims=True) - linear)
    shaped = linear_from_srgb(_sigmoid(mixed))
    mean = shaped.mean(axis=-1, keepdims=True)
    shown: Pixels = mean + (shaped - mean) / np.float32(1 - INSET)
    return shown


def _sigmoid(linear: Pixels) -> Pixels:
    """Return encoded values: powers of the stops from black below grey, and of those from white above it.

    Both branches meet in grey, as bright and as steep per stop as sRGB encodes it.
    """
    grey = 1.055 * GREY ** (1 / 2.4) - 0.055
    steep = math.log(2) * (grey + 0.055) / 2.4  # per stop
    with np.errstate(divide="ignore"):
        stops = np.log2(linear / np.float32(GREY))
    below = np.clip(1 + stops / np.float32(STOPS_BELOW), 0, 1)
    above = np.clip(1 - stops / np.float32(STOPS_ABOVE), 0, 1)
    toe = np.float32(grey) * below ** np.float32(steep * STOPS_BELOW / grey)
    shoulder = 1 - np.float32(1 - grey) * above ** np.float32(steep * STOPS_ABOVE / (1 - grey))
    encoded: Pixels = np.where(stops < 0, toe, shoulder).astype(np.float32, copy=False)
    return encoded
