"""From linear film values to the picture that a screen shows."""

from __future__ import annotations

import importlib.util
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import colour as colour_spaces
from rptcam_cl.core.colour import Matrix, luminance
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.remember import checkpoint
from rptcam_cl.scene.film import Gamut, PictureSettings, ToneCurve, WhiteBalance

#
# Removing noise by Intel Open Image Denoise, guided by the layers albedo and normal. It runs on the processor.
#
# The network guesses what the noise hides: the result looks clean, yet its error has no bound and does not vanish as
# samples are added. The picture's metadata say so.

Pixels = NDArray[np.float32]

GUIDES = ("albedo", "normal")
_MARGIN_PX = 16  # with 8 or 32 the error is the same within a tenth


def check_denoiser() -> None:
    """Raise an error when the package that denoises is not installed.

    Raises
    ------
    InputError
        It says how to install it.
    """
    if importlib.util.find_spec("pyoidn") is None:
        raise InputError('denoising needs the package pyoidn (pip install "rptcam_cl[denoise]")')


def denoise(pixels: Pixels, albedo: Pixels, normal: Pixels, quality: str = "high") -> tuple[Pixels, str]:
    """Return the picture without its noise, and the name of what removed it.

    Parameters
    ----------
    pixels
        (height, width, 3), linear.
    albedo, normal
        Layers of the same shape.
    quality
        Of the network: ``high``, or ``fast`` for half the time.

    Raises
    ------
    InputError
        The denoiser is missing or fails.
    """
    check_denoiser()
    try:
        import pyoidn

        margins = ((_MARGIN_PX,) * 2, (_MARGIN_PX,) * 2, (0, 0))  # mirrored: the network takes what is beyond for black
        wide, guide, facing = (np.pad(values, margins, mode="symmetric") for values in (pixels, albedo, normal))
        clean = _within_channels(partial(pyoidn.denoise, normal=facing, hdr=True, quality=quality), wide, guide)
    except (ImportError, OSError, RuntimeError) as error:
        raise InputError(f"denoising failed: {error}") from error
    inside = slice(_MARGIN_PX, -_MARGIN_PX)
    return np.ascontiguousarray(
        clean[inside, inside], np.float32
    ), f"Open Image Denoise (pyoidn {version('pyoidn')}), biased"


def _within_channels(remove_noise: Callable[..., Pixels], pixels: Pixels, albedo: Pixels) -> Pixels:
    """Denoise a picture that may have channels below 0, as spectral colours have, which a denoiser takes for 0.

    Such a picture goes through it in CIE XYZ, where every colour of light is positive, scaled so that white is
    (1, 1, 1) there, too.
    """
    if not (pixels < 0).any():
        return remove_noise(pixels, albedo=albedo)
    matrix = colour_spaces.XYZ_FROM_RGB / colour_spaces.XYZ_FROM_RGB.sum(axis=1, keepdims=True)
    seen, guide = (np.asarray(values @ matrix.T, np.float32) for values in (pixels, albedo))
    return np.asarray(remove_noise(seen, albedo=guide) @ np.linalg.inv(matrix).T)


# Tone curves: from linear light without an upper limit to the linear light of a display, and sRGB's encoding of it.

_ACES_WHITE = 7.25  # from here on the fit is above 1

# T. Sobotka, AgX, config.ocio at github.com/sobotka/AgX. The published rows sum to 1 within 1.4e-4; divided by their
# sums they leave grey exactly grey.
_PUBLISHED_INSET = np.array(
    [
        [0.842479062253094, 0.0784335999999992, 0.0792237451477643],
        [0.0423282422610123, 0.878468636469772, 0.0791661274605434],
        [0.0423756549057051, 0.0784336, 0.879142973793104],
    ]
)
_INSET = _PUBLISHED_INSET / _PUBLISHED_INSET.sum(axis=1, keepdims=True)
_OUTSET = np.linalg.inv(_INSET)
LEAST_LOG2, MOST_LOG2 = -12.47393, 4.026069  # 10 stops below a grey of 0.18, 6.5 above it
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
    x = np.minimum(linear, np.float32(_ACES_WHITE))
    fit: Pixels = x * (np.float32(2.51) * x + np.float32(0.03))
    fit /= x * (np.float32(2.43) * x + np.float32(0.59)) + np.float32(0.14)
    return np.minimum(fit, np.float32(1))


def agx(linear: Pixels) -> Pixels:
    """T. Sobotka's AgX with the outset of B. Wrensch, "Minimal AgX Implementation", 2023; docs/picture.md.

    A matrix mixes the channels, a sigmoid shapes the logarithm of each, and the mixing is undone: bright colours pale
    towards white and do not turn to the nearest primary. The result is the light of a display of power 2.2, as AgX
    means it; it may leave 0..1 a little.
    """
    mixed = linear @ _INSET.T.astype(np.float32)
    with np.errstate(divide="ignore"):
        stops = np.log2(mixed)
    share = (stops - np.float32(LEAST_LOG2)) / np.float32(MOST_LOG2 - LEAST_LOG2)
    encoded = agx_contrast(np.clip(share, 0, 1)) @ _OUTSET.T.astype(np.float32)
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
    return np.where(share > 0, toe + shoulder, 0).astype(np.float32, copy=False)  # black to the bit on any processor


def _hyperbola(distance: Pixels, reach: float, height: float, power: float) -> Pixels:
    """Return how far the curve rises over a distance from the pivot; over the whole reach it is the height."""
    rise = _SLOPE * reach
    scale = rise / ((rise / height) ** power - 1) ** (1 / power)
    ahead = np.float32(_SLOPE / scale) * distance
    risen: Pixels = np.float32(scale) * ahead / (1 + ahead ** np.float32(power)) ** np.float32(1 / power)
    return risen


# White balance: what the picture's light is taken to be, and the matrix on linear RGB that makes it grey.

Colour = NDArray[np.float64]
Part = tuple[float, float, float, float]

WHOLE: Part = (0.0, 1.0, 0.0, 1.0)
_NEIGHBOURS = 2  # pixels on each side of a point that are averaged with it
_ROUNDING = 1e-6  # pixels: a point between two belongs to the same one in a part of the film as in the whole
_LEAST = 1e-3  # of a light's luminance that each of three responses must have to be scaled to white


def _light_of(balance: WhiteBalance, linear: Pixels, part: Part) -> Colour:
    """The light that is made grey, in linear sRGB: known, the mean of a grey place, or that of the picture.

    The mean of a picture is grey (G. Buchsbaum, J. Franklin Institute 310, 1980); pixels beyond white do not count.
    """
    if balance.grey is not None:
        return _mean(linear[_window(balance.grey, linear.shape, part)])
    if (colour := balance.light_colour()) is not None:
        return colour
    shown = (linear <= 1).all(axis=-1)
    return _mean(linear[shown] if shown.any() else linear)


def _window(place: tuple[float, ...], shape: tuple[int, ...], part: Part) -> tuple[slice, slice]:
    """Rows and columns of the pixels, at least one, at a point or in a rectangle in fractions of the film."""
    half = len(place) // 2
    across, down = (
        [(edge - start) / (end - start) * count for edge in edges]
        for edges, start, end, count in ((place[:half], *part[:2], shape[1]), (place[half:], *part[2:], shape[0]))
    )
    return _pixels(down, shape[0]), _pixels(across, shape[1])


def _balance_matrix(balance: WhiteBalance, linear: Pixels, part: Part) -> Matrix:
    """Return the 3 x 3 matrix for linear colours as columns; that of no change where there is no light to balance.

    Parameters
    ----------
    balance
        What is to become grey, keeping its luminance, or the factors themselves; and whether red, green and blue are
        scaled, which is the default, or the responses of the Bradford transform. A light without red, green or blue
        can only be balanced by these.
    linear
        The picture, (height, width, 3).
    part
        Which part of the film it is.
    """
    if balance.gains is not None:
        return np.diag(np.array(balance.gains, np.float64))
    light = _light_of(balance, linear, part)
    xyz = colour_spaces.XYZ_FROM_RGB @ light
    if xyz[1] <= 0 or (colour_spaces.BRADFORD @ xyz <= _LEAST * xyz[1]).any():
        warnings.warn(
            "white balance: what should be grey is black or of no colour that light has; left as it is", stacklevel=2
        )
        return np.eye(3)
    if balance.adaptation != "bradford" and (light > _LEAST * xyz[1]).all():
        return np.diag(xyz[1] / light)
    adapted: Matrix = (
        colour_spaces.RGB_FROM_XYZ
        @ colour_spaces.adaptation(xyz / xyz[1], colour_spaces.xyz_of(colour_spaces.SRGB_WHITE))
        @ colour_spaces.XYZ_FROM_RGB
    )
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


BAND_PIXELS = 1 << 16  # developed at a time; more leave the cache, and take twice as long
_LARGEST = np.float32(1e30)  # leaves room for products; far beyond the white of any curve


PLAIN = PictureSettings()


def developed_values(pixels: NDArray[np.floating], picture: PictureSettings = PLAIN, part: Part = WHOLE) -> Pixels:
    """Return the display-encoded picture, (height, width, 3) in 0..1.

    Parameters
    ----------
    pixels
        (height, width, 3), linear; 1 is white with `srgb` and `linear` at ``ev`` 0. Not-a-number becomes 0.
    picture
        How to develop; by default as sRGB, clipped.
    part
        Which part of the film the pixels are: x0, x1, y0, y1 in fractions from its left and top.
    """
    bands = [band for _, band in _bands(np.asarray(pixels), picture, part)]
    return np.concatenate(bands) if len(bands) > 1 else bands[0]


def developed_codes(
    pixels: NDArray[np.floating], picture: PictureSettings, part: Part, bits: int
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Return the developed picture in codes of 8 or 16 bits; in memory there is never more of it than some rows."""
    codes = np.empty(pixels.shape, np.uint8 if bits == 8 else np.uint16)
    for rows, band in _bands(pixels, picture, part):
        codes[rows] = quantise(band, bits)
    return codes


def _bands(pixels: NDArray[np.floating], picture: PictureSettings, part: Part) -> Iterator[tuple[slice, Pixels]]:
    """Yield runs of rows, developed; the white balance is that of the whole."""
    matrix = None
    if picture.white_balance is not None:
        whole = _expose(np.asarray(pixels, np.float32), picture.ev)
        matrix = _balance_matrix(picture.white_balance, whole, part).T.astype(np.float32)
        del whole
    step = max(1, BAND_PIXELS // max(1, pixels.shape[1]))
    for start in range(0, len(pixels), step):
        checkpoint()
        rows = slice(start, start + step)
        exposed = _expose(np.asarray(pixels[rows], np.float32), picture.ev)
        balanced = exposed if matrix is None else exposed @ matrix
        shown = _display(balanced, picture) if picture.ocio is None else picture.ocio.loaded.apply(balanced)
        yield rows, shown if picture.table is None else _within_one(picture.table.apply(shown))


def _display(balanced: Pixels, picture: PictureSettings) -> Pixels:
    """Return display values by our own curves."""
    gamut = picture.gamut
    toned = _apply_curve(_without_negatives(balanced, gamut), picture.tone)
    shown = _below_one(_without_negatives(toned, gamut), gamut)
    return shown if picture.tone.kind == "linear" else srgb_from_linear(shown)


def _within_one(values: Pixels) -> Pixels:
    return np.clip(values, 0, 1, out=values)


def quantise(encoded: Pixels, bits: int) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Return the nearest codes of 8 or 16 bits of values in 0..1."""
    nearest = encoded * np.float32(2**bits - 1) + np.float32(0.5)
    return nearest.astype(np.uint8) if bits == 8 else nearest.astype(np.uint16)


def _expose(pixels: Pixels, ev: float) -> Pixels:
    with np.errstate(over="ignore"):  # beyond float32 is white all the same
        scaled = np.nan_to_num(pixels, nan=0.0) * np.float32(2.0**ev)
    clipped: Pixels = np.clip(scaled, -_LARGEST, _LARGEST)
    return clipped


def _apply_curve(linear: Pixels, tone: ToneCurve) -> Pixels:
    match tone.kind:
        case "reinhard":
            return reinhard(linear, tone.shown_white)
        case "aces":
            return aces(linear)
        case "agx":
            return agx(linear)
    return linear


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
