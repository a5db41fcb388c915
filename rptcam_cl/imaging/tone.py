"""Tone curves: from linear light without an upper limit to the linear light of a display, and sRGB's encoding of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import luminance

Pixels = NDArray[np.float32]

ACES_WHITE = 7.25  # from here on the fit is above 1

# T. Sobotka, AgX, config.ocio at github.com/sobotka/AgX. The published rows sum to 1 within 1.4e-4; divided by their
# sums they leave grey exactly grey.
_PUBLISHED_INSET = np.array(
    [
        [0.842479062253094, 0.0784335999999992, 0.0792237451477643],
        [0.0423282422610123, 0.878468636469772, 0.0791661274605434],
        [0.0423756549057051, 0.0784336, 0.879142973793104],
    ]
)
INSET = _PUBLISHED_INSET / _PUBLISHED_INSET.sum(axis=1, keepdims=True)
OUTSET = np.linalg.inv(INSET)
LEAST_LOG2, MOST_LOG2 = -12.47393, 4.026069  # 10 stops below a grey of 0.18, 6.5 above it
AGX_WHITE = 2.0**MOST_LOG2
_PIVOT, _PIVOT_SHOWN, _SLOPE = 10 / 16.5, 0.5, 2.0  # the grey in the range, what it becomes, and the slope there
_TOE, _SHOULDER = 3.0, 3.25  # powers
_DISPLAY_POWER = 2.2


def srgb_from_linear(linear: NDArray[np.floating]) -> Pixels:
    """sRGB-encoded values of linear ones, both in 0..1 (IEC 61966-2-1).

    Values outside 0..1 are clipped; not-a-number becomes 0.
    """
    numbers = np.fmax(linear, 0.0)  # 0 where there is none
    clipped: Pixels = np.fmin(numbers, 1.0).astype(np.float32, copy=False)
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
    brightness = luminance(linear, np.float32)[..., None]
    shown: Pixels = linear * ((1 + brightness / np.float32(white**2)) / (1 + brightness))
    return shown


def aces(linear: Pixels) -> Pixels:
    """K. Narkowicz, "ACES Filmic Tone Mapping Curve", 2016: his fit of the ACES reference rendering, per channel."""
    x = np.minimum(linear, np.float32(ACES_WHITE))
    fit: Pixels = x * (np.float32(2.51) * x + np.float32(0.03))
    fit /= x * (np.float32(2.43) * x + np.float32(0.59)) + np.float32(0.14)
    return np.minimum(fit, np.float32(1))


def agx(linear: Pixels) -> Pixels:
    """T. Sobotka's AgX with the outset of B. Wrensch, "Minimal AgX Implementation", 2023; docs/picture.md.

    A matrix mixes the channels, a sigmoid shapes the logarithm of each, and the mixing is undone: bright colours pale
    towards white and do not turn to the nearest primary. The result is the light of a display of power 2.2, as AgX
    means it; it may leave 0..1 a little.
    """
    mixed = linear @ INSET.T.astype(np.float32)
    with np.errstate(divide="ignore"):
        stops = np.log2(mixed)
    share = (stops - np.float32(LEAST_LOG2)) / np.float32(MOST_LOG2 - LEAST_LOG2)
    encoded = agx_contrast(np.clip(share, 0, 1)) @ OUTSET.T.astype(np.float32)
    # Below 0 there is no power: the sign is kept, and the gamut deals with it.
    light: Pixels = np.copysign(np.abs(encoded) ** np.float32(_DISPLAY_POWER), encoded)
    return light


def agx_contrast(share: Pixels) -> Pixels:
    """Return the encoded value for a share of the range of stops, both 0..1: AgX's default contrast.

    Two hyperbolas d / (1 + d^p)^(1/p) leave the pivot with the slope there, scaled to end in 0 and 1: the curve of
    J. Smith that Sobotka's table samples.
    """
    toe = _PIVOT_SHOWN - _hyperbola(np.maximum(_PIVOT - share, 0), _PIVOT, _PIVOT_SHOWN, _TOE)
    shoulder = _hyperbola(np.maximum(share - _PIVOT, 0), 1 - _PIVOT, 1 - _PIVOT_SHOWN, _SHOULDER)
    return (toe + shoulder).astype(np.float32, copy=False)


def _hyperbola(distance: Pixels, reach: float, height: float, power: float) -> Pixels:
    """Return how far the curve rises over a distance from the pivot; over the whole reach it is the height."""
    rise = _SLOPE * reach
    scale = rise / ((rise / height) ** power - 1) ** (1 / power)
    ahead = np.float32(_SLOPE / scale) * distance
    risen: Pixels = np.float32(scale) * ahead / (1 + ahead ** np.float32(power)) ** np.float32(1 / power)
    return risen
