"""What measures the picture: histogram, exposure meter, overlays, and the view through a simpler camera."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LUMENS_PER_WATT
from rptcam_cl.core.colour import LUMINANCE, luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging import development, formats
from rptcam_cl.rendering.account import SPOT_AREA, weights, window
from rptcam_cl.rendering.cameras.model import values_per_irradiance
from rptcam_cl.scene import base, exposure
from rptcam_cl.scene.camera import keys_as, plain_keys
from rptcam_cl.scene.changes import with_camera
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies.tier_models import equivalent, without_lens
from rptcam_cl.viewfinder.panel import irradiance_per_radiance, value_per_radiance

#
# Histograms and clipping counts.
#
# `histogram` counts the display codes 0 to 255 of the developed picture, as the back of a camera shows it; luminance
# is the luma of ITU-R BT.709-6. `stop_histogram` counts film values by thirds of a stop about middle grey, for those
# who develop from the linear file; `raw_histogram` counts the numbers of a sensor. What is clipped is counted on the
# film, or on the sensor, and never on the developed picture.

_MIDDLE_GREY = 0.18
CODES = 256
MOST_PIXELS = 1 << 16
_DARKEST_EV, _BRIGHTEST_EV, _PER_STOP = -10, 6, 3
CHANNELS = ("red", "green", "blue")
_DARK_VALUE = 0.5 / 255 / 12.92  # film values below it are shown as code 0: the foot of sRGB (IEC 61966-2-1)
_RAW_BINS = 256


Histogram = dict[str, Any]
"""Counts by brightness, as plain values: lists of counts by channel, ``luminance``, ``red``, ``green`` and ``blue`` or
those of a sensor; ``edges``, the outer ones of the ``bins``; ``scale`` of these, ``display code``, ``stops`` about
middle grey, or ``DN``; ``samples``, pixels that were counted; and what else is known: of the film what is clipped, of a
sensor its levels."""


def _histogram(
    counts: Mapping[str, NDArray[np.int64]], scale: str, ends: tuple[float, float], samples: int
) -> Histogram:
    bins = len(next(iter(counts.values())))
    lists = {name: values.tolist() for name, values in counts.items()}
    return lists | {"edges": list(ends), "bins": bins, "scale": scale, "samples": samples}


def thinned(picture: NDArray[Any], most: int = MOST_PIXELS) -> NDArray[Any]:
    """Return evenly spaced pixels of a picture, about as many as `most`: single ones, as means would hide extremes."""
    step = max(1, math.ceil(math.sqrt(picture.shape[0] * picture.shape[1] / most)))
    return picture[step // 2 :: step, step // 2 :: step]


def histogram(
    picture: NDArray[np.uint8], pixels: NDArray[np.float32] | None = None, most: int = MOST_PIXELS
) -> Histogram:
    """Return how many pixels of a developed picture have each display code.

    Parameters
    ----------
    picture
        (height, width, 3), 8 bits.
    pixels
        The film (height, width, 3), whose clipping is counted.
    most
        Pixels to count at most, about; the clipping counts them all.
    """
    codes = thinned(picture, most).reshape(-1, 3)
    luma = np.floor(luminance(codes, np.float32) + np.float32(0.5)).astype(np.uint8)
    counts = {"luminance": np.bincount(luma, minlength=CODES)}
    counts |= {name: np.bincount(codes[:, k], minlength=CODES) for k, name in enumerate(CHANNELS)}
    clipped = {} if pixels is None else {"clipped": clipping(pixels)}
    return _histogram(counts, "display code", (-0.5, CODES - 0.5), len(codes)) | clipped


def stop_histogram(pixels: NDArray[np.float32]) -> Histogram:
    """Return how many pixels of a film lie in each third of a stop about middle grey; the ends take what is beyond."""
    values = thinned(pixels).reshape(-1, 3)
    bins = (_BRIGHTEST_EV - _DARKEST_EV) * _PER_STOP
    series = {"luminance": luminance(values, np.float32)} | {name: values[:, k] for k, name in enumerate(CHANNELS)}
    counts = {}
    for name, channel in series.items():
        with np.errstate(divide="ignore", invalid="ignore"):
            stops = np.log2(channel.astype(np.float64) / _MIDDLE_GREY)
        place = np.floor((np.nan_to_num(stops, nan=-99.0, neginf=-99.0, posinf=99.0) - _DARKEST_EV) * _PER_STOP)
        counts[name] = np.bincount(np.clip(place, 0, bins - 1).astype(np.int64), minlength=bins)
    return _histogram(counts, "stops", (float(_DARKEST_EV), float(_BRIGHTEST_EV)), len(values))


def raw_histogram(raw: formats.RawImage) -> Histogram:
    """Return how many numbers of a sensor lie in each of 256 bins, by the colours of its mosaic, all pixels counted."""
    sensor, numbers = raw.sensor, raw.numbers
    width = max(1, (sensor.top_dn + 1) // _RAW_BINS)
    bins = -(-(sensor.top_dn + 1) // width)
    counts = {
        name: np.bincount(np.concatenate([plane.ravel() for plane in planes]) // width, minlength=bins)
        for name, planes in _planes(numbers, sensor.pattern).items()
    }
    notes = {"black_dn": sensor.black_level_dn, "white_dn": sensor.white_level_dn}
    notes["saturated"] = int(np.count_nonzero(numbers >= math.floor(sensor.white_level_dn)))
    return _histogram(counts, "DN", (0.0, float(bins * width)), numbers.size) | notes


def _planes(numbers: NDArray[np.uint16], pattern: str) -> dict[str, list[NDArray[np.uint16]]]:
    """Return the numbers of each colour of a mosaic."""
    if numbers.ndim == 3:
        return {name: [numbers[..., k]] for k, name in enumerate(CHANNELS)}
    if len(pattern) != 4:
        return {"luminance": [numbers]}
    planes: dict[str, list[NDArray[np.uint16]]] = {name: [] for name in CHANNELS}
    for place, letter in enumerate(pattern):
        planes[CHANNELS["RGB".index(letter)]].append(numbers[place // 2 :: 2, place % 2 :: 2])
    return planes


def clipping(pixels: NDArray[np.float32]) -> dict[str, Any]:
    """Count the pixels of a film whose light is lost.

    Returns
    -------
    pixels : int
        Counted.
    high : dict
        How many reach white, 1, by ``any``, ``luminance``, ``red``, ``green`` and ``blue``.
    low : dict
        How many are so dark that they are shown as code 0, in the same way; ``any`` are those dark in all channels.
    """
    series = {"any": strongest(pixels), "luminance": luminance(pixels, np.float32)}
    series |= {name: pixels[..., k] for k, name in enumerate(CHANNELS)}
    high = {name: int(np.count_nonzero(values >= 1)) for name, values in series.items()}
    low = {name: int(np.count_nonzero(values < _DARK_VALUE)) for name, values in series.items()}
    return {"pixels": pixels.shape[0] * pixels.shape[1], "high": high, "low": low}


def strongest(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the largest channel (h, w) of each pixel, in a tenth of the time of a maximum along the last axis."""
    return np.maximum(np.maximum(pixels[..., 0], pixels[..., 1]), pixels[..., 2])


#
# What is laid over the picture: zebra, false colour, focus peaking: masks of the film, and pictures with alpha.
#
# They are computed from the linear film, before it is developed: white balance and tone curve do not move them.

Film = NDArray[np.float32]
Mask = NDArray[np.bool_]
_Rgba = NDArray[np.uint8]

_STRIPE = 8  # pixels from one zebra stripe to the next
_STRIPE_COLOUR = (255, 255, 255, 230)
_STRIPE_GAP = (20, 20, 20, 150)
PEAKING_COLOUR = (255, 40, 60, 255)
_FALSE_COLOUR_ALPHA = 255
_WHITE_EV = float(np.log2(1.0 / _MIDDLE_GREY))


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


def zebra_rgba(mask: Mask) -> _Rgba:
    """Return a mask as diagonal stripes (h, w, 4)."""
    light = np.add.outer(np.arange(mask.shape[0]), np.arange(mask.shape[1])) % _STRIPE < _STRIPE // 2
    picture = np.zeros((*mask.shape, 4), np.uint8)
    picture[mask & light] = _STRIPE_COLOUR
    picture[mask & ~light] = _STRIPE_GAP
    return picture


@dataclass(frozen=True)
class ColourBand:
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


FALSE_COLOUR: tuple[ColourBand, ...] = (
    ColourBand("0", None, -4.5, (24, 8, 44)),
    ColourBand("I", -4.5, -3.5, (86, 28, 148)),
    ColourBand("II", -3.5, -2.5, (44, 70, 214)),
    ColourBand("III", -2.5, -1.5, (28, 146, 204)),
    ColourBand("IV", -1.5, -0.5, (32, 158, 118)),
    ColourBand("V", -0.5, 0.5, (138, 138, 138)),
    ColourBand("VI", 0.5, 1.5, (150, 196, 60)),
    ColourBand("VII", 1.5, _WHITE_EV, (246, 206, 52)),
    ColourBand("clipped", _WHITE_EV, None, (226, 32, 40)),
)
"""The scale: a stop to a zone, from black to what is white or more."""


def false_colour(pixels: Film) -> NDArray[np.uint8]:
    """Return the place (h, w) in `FALSE_COLOUR` of each pixel, by its luminance."""
    edges = [_MIDDLE_GREY * 2.0**band.low_ev for band in FALSE_COLOUR[1:] if band.low_ev is not None]
    bright = luminance(pixels, np.float32)
    return np.asarray(np.searchsorted(np.asarray(edges, np.float32), bright, side="right"), np.uint8)


def false_colour_rgba(index: NDArray[np.uint8]) -> _Rgba:
    """Return false colour as an opaque picture (h, w, 4)."""
    table = np.array([(*band.colour, _FALSE_COLOUR_ALPHA) for band in FALSE_COLOUR], np.uint8)
    return np.asarray(table[index])


_NOISE_SIGMAS = 3.0  # so far noise alone seldom reaches
TILE = 16  # pixels, within which noise is taken as even
SHARE, _SHARE_SIGMAS = (
    0.8,
    1.2816,
)  # of a tile's pixels lie below so many sigmas; an edge through it has fewer than the rest
_MOST_OF_NOISE = 0.2  # sigma of the display signal for a relative noise of the whole picture of 1; more is texture
ALONG = 2  # pixels either way along an edge, whose mean has less noise
WAYS = ((0, 1), (1, 0), (1, 1), (1, -1))  # rows and columns of a step along it
_LEAST_NEIGHBOURS = 2  # of the eight round an edge's pixel; a speck has fewer


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
    signal = development.srgb_from_linear(luminance(pixels, np.float32))
    least, most = 0.1 * (1.0 - level) + 0.005, np.inf if noise is None else _MOST_OF_NOISE * noise
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
    return np.asarray(strong & (near > _LEAST_NEIGHBOURS))


def _exceeds(contrast: Film, least: float, most_sigma: float) -> Mask:
    """Return where a contrast is at least so large, and well above its noise, which is at most so large."""
    size = np.abs(contrast)
    sigma = np.minimum(_sigma(size), np.float32(most_sigma))
    return np.asarray(size > np.maximum(np.float32(least), _NOISE_SIGMAS * sigma))


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
    found = np.partition(tiles, place, axis=1)[:, place].reshape(whole.shape[0] // TILE, -1) / np.float32(_SHARE_SIGMAS)
    around = np.lib.stride_tricks.sliding_window_view(np.pad(found, 1, mode="edge"), (3, 3)).max(axis=(2, 3))
    return np.asarray(around.repeat(TILE, axis=0).repeat(TILE, axis=1)[:rows, :columns])


def _binomial(signal: Film) -> Film:
    """Return the mean of each pixel's neighbours with the weights 1 2 1 across and down."""
    padded = np.pad(signal, 1, mode="edge")
    across = padded[:, :-2] + 2 * padded[:, 1:-1] + padded[:, 2:]
    return np.asarray((across[:-2] + 2 * across[1:-1] + across[2:]) / np.float32(16))


def peaking_rgba(mask: Mask) -> _Rgba:
    """Return a mask as a coloured picture (h, w, 4)."""
    picture = np.zeros((*mask.shape, 4), np.uint8)
    picture[mask] = PEAKING_COLOUR
    return picture


OverlayName = Literal["zebra", "false_colour", "peaking"]
OVERLAYS: dict[OverlayName, Callable[[Film, float, float | None], _Rgba]] = {
    "zebra": lambda pixels, level, noise: zebra_rgba(zebra(pixels, level)),
    "false_colour": lambda pixels, level, noise: false_colour_rgba(false_colour(pixels)),
    "peaking": lambda pixels, level, noise: peaking_rgba(peaking(pixels, level, noise)),
}
"""What is drawn over a film, by its level from 0 to 1, where it has one, and the noise of the picture."""


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


#
# The exposure meter: luminance from the film, as the metering of `exposure: auto` sees it.
#
# The film knows no saturation, so that one picture, however exposed, tells the luminance of everything in it: its
# values over what radiance 1 gives. A reading in EV is that of a reflected-light meter at ISO 100, 2^EV = L S / K
# with K = 12.5 (ISO 2720).

_METER_CONSTANT = 12.5  # K [cd s/m²], ISO 2720


def film_reading(pixels: Film, resolved: Scene, settings: exposure.Exposure | None = None) -> float | None:
    """Return the mean luminance [cd/m²] of the metered part of the frame, as `exposure: auto` would find it.

    None where there is no light to go by, or the film lacks its background, which `exposure: auto` sees.

    Parameters
    ----------
    pixels
        The film (h, w, 3) of the whole frame, or of its crop, at any resolution.
    resolved
        The scene that it was rendered from, with its exposure resolved.
    settings
        Whose metering counts; by default that of the scene. With a crop, what is left of the metered part counts.
    """
    counts = _shares(pixels, resolved, settings or resolved.exposure)
    if resolved.film.transparent or not counts.any():
        return None
    value = float(np.sum(luminance(pixels) * counts) / counts.sum())
    return value / value_per_radiance(resolved) * LUMENS_PER_WATT if value > 0 else None


def _shares(pixels: Film, scene: Scene, settings: exposure.Exposure) -> NDArray[np.float64]:
    """Return how much each pixel (h, w) counts."""
    rows, columns = pixels.shape[:2]
    film = scene.film
    if film.crop is None:
        return weights(settings, film.model_copy(update=film.whole_in((columns, rows))))
    left, top, width, height = window(scene)
    whole = weights(settings, film.model_copy(update={"crop": None}))
    part = whole[top : top + height, left : left + width]
    return part[np.ix_(_places(rows, height), _places(columns, width))]


def _places(count: int, size: int) -> NDArray[np.intp]:
    """Return the places of `count` samples spread evenly over `size` pixels."""
    return ((np.arange(count) + 0.5) * size / count).astype(np.intp)


def spot_meter(pixels: Film, resolved: Scene, x: float, y: float, area: float = SPOT_AREA) -> dict[str, Any]:
    """Read a spot of the film; of one without its background what stands there, not the black beside it.

    Parameters
    ----------
    pixels, resolved
        As for `film_reading`, the whole frame.
    x, y
        Middle of the spot, in fractions of the picture from its left and top.
    area
        Of the spot as a share of the frame; by default that of `metering: spot`. The nearest pixel always counts.

    Returns
    -------
    x, y : float
        As given.
    cd_m2 : float
        Luminance.
    ev : float or None
        At ISO 100; None where there is no light.
    value : float
        Luminance of the film, 1 being white.
    stops : float or None
        From middle grey, 0.18 on the film.
    zone : str
        In the scale of false colour.
    rgb : tuple of float
        Film values.
    time_s : float or None
        Exposure time that would bring the spot to middle grey at the f-number and ISO set; None without a film.
    """
    inside = _disk(pixels, resolved, x, y, area)
    if resolved.film.transparent and (there := inside & pixels.any(axis=2)).any():
        inside = there
    red, green, blue = (float(channel) for channel in pixels[inside].mean(axis=0, dtype=np.float64))
    value = float(np.dot((red, green, blue), LUMINANCE))
    cd_m2 = value / value_per_radiance(resolved) * LUMENS_PER_WATT
    stops = math.log2(value / _MIDDLE_GREY) if value > 0 else None
    return {
        "x": x,
        "y": y,
        "cd_m2": cd_m2,
        "ev": ev100(cd_m2) if cd_m2 > 0 else None,
        "value": value,
        "stops": stops,
        "zone": next(band.name for band in FALSE_COLOUR if band.high_ev is None or (stops or -99.0) < band.high_ev),
        "rgb": (red, green, blue),
        "time_s": _time_for(resolved, cd_m2),
    }


def ev100(cd_m2: float) -> float:
    """Return the exposure value at ISO 100 of a luminance [cd/m²]."""
    return math.log2(cd_m2 * 100.0 / _METER_CONSTANT)


def _disk(pixels: Film, scene: Scene, x: float, y: float, area: float) -> NDArray[np.bool_]:
    """Return the pixels (h, w) in a disk of a share of the frame, at least the nearest."""
    rows, columns = pixels.shape[:2]
    width, height = scene.film.size_m()
    across = (np.arange(columns) + 0.5) / columns * width - x * width
    down = (np.arange(rows) + 0.5) / rows * height - y * height
    square = across[None, :] ** 2 + down[:, None] ** 2
    return np.asarray(square <= max(area * width * height / math.pi, float(square.min())))


def _time_for(scene: Scene, cd_m2: float) -> float | None:
    """Return the exposure time [s] that brings a luminance to middle grey; None without light or film."""
    light = irradiance_per_radiance(scene)
    if light is None or cd_m2 <= 0:
        return None
    irradiance = cd_m2 / LUMENS_PER_WATT * light * 2.0**-scene.exposure.neutral_density_stops
    return float(_MIDDLE_GREY / irradiance / values_per_irradiance(1.0, scene.exposure.iso))


# The same view through a simpler camera: what a traced lens does beyond first-order optics is the difference.

Kind = Literal["thick_lens", "thin_lens", "pinhole"]
KINDS: tuple[Kind, ...] = get_args(Kind)
ORDER = ("realistic", *KINDS)  # each stands for those before it


def as_model(scene: Scene, resolved: Scene, kind: str) -> dict[str, Any]:
    """Return the changes that put a simpler camera in the place of a scene's, with the same view and brightness.

    Thin lens and pinhole stand in the entrance pupil; see `tradeoff`.

    Parameters
    ----------
    scene, resolved
        As requested, and in focus and exposed.
    kind
        ``thick_lens``, ``thin_lens`` or ``pinhole``; the kind that it is changes nothing.

    Raises
    ------
    InputError
        The kind is none of these, or nothing simple stands for the camera; the message says why.
    """
    if kind not in KINDS:
        raise InputError(f"model: is no simpler camera (got {kind[:40]!r}; allowed: {', '.join(KINDS)})")
    view = resolved if type(resolved.camera) is type(scene.camera) else scene
    camera = view.camera
    if camera.kind == kind:
        return {}
    if camera.kind not in ORDER or ORDER.index(camera.kind) > ORDER.index(kind):
        raise InputError(f"model: no {kind} stands for a camera of kind {camera.kind}")
    plain = view.model_copy(update={"exposure": exposure.Exposure()})
    if camera.ideal_lens is not None:
        simple = without_lens(plain)
    else:
        if camera.traced_camera is None:
            plain = with_camera(plain, keys_as(camera, {"kind": "realistic"})[0])
        simple = equivalent(plain, next(known for known in KINDS if known == kind))
    changes: dict[str, Any] = {"camera": plain_keys(simple.camera)}
    if kind == "pinhole" and view.camera.has_opening and scene.exposure.mode != "relative":
        light = irradiance_per_radiance(view)
        assert light is not None
        changes["exposure.f_number"] = math.sqrt(math.pi / (4.0 * light))
    return changes


#
# How two settings differ: a map in stops, and numbers.
#
# The number of a comparison is relMSE, the mean over the picture of |b - a|^2 / (|a|^2 + (0.01 mean a)^2) with
# vectors of the three channels, |a|^2 averaged over tiles of 8 x 8 pixels, as `rptcam tradeoff` has it; a is the
# picture, b what it is compared with. The noise of both counts in it.

_MSE_TILE = 8  # pixels
_MSE_FLOOR = 0.01  # of the mean: what is darker counts as this dark
_RANGE_STOPS = 2.0  # that the map shows in its strongest colours
_DARKER, _EQUAL, _BRIGHTER = (40, 90, 220), (244, 244, 244), (214, 48, 40)


def difference_rgb(stops: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Draw by how much a second film is brighter (h, w) as a picture (h, w, 3): blue where it is darker, else red."""
    share = np.clip(stops / np.float32(_RANGE_STOPS), -1, 1)[..., None]
    darker, equal, brighter = (np.array(colour, np.float32) for colour in (_DARKER, _EQUAL, _BRIGHTER))
    ends = np.where(share < 0, darker, brighter)
    return np.asarray(np.floor(equal + np.abs(share) * (ends - equal) + 0.5), np.uint8)


LEGEND = [
    {"stops": -_RANGE_STOPS, "colour": _DARKER},
    {"stops": 0.0, "colour": _EQUAL},
    {"stops": _RANGE_STOPS, "colour": _BRIGHTER},
]
"""Stops and colours of the map's ends and middle."""


def difference(first: NDArray[np.float32], second: NDArray[np.float32]) -> tuple[NDArray[np.float32], dict[str, float]]:
    """Compare a second film (h, w, 3) with a first of the same size.

    Returns
    -------
    stops : (h, w) float32 array
        How much brighter the second is; negative where it is darker.
    numbers : dict
        ``relmse``; ``mean_stops``, the mean of the absolute values of `stops`; ``bias_stops``, how much brighter the
        second is in the mean; ``worst_stops``, the 99.9th percentile of the absolute values: more than noise of single
        pixels.

    Raises
    ------
    InputError
        They have other sizes.
    """
    if first.shape != second.shape:
        raise InputError(f"compare: the films have other sizes (got {first.shape} and {second.shape})")
    a, b = first.astype(np.float64), second.astype(np.float64)
    mean_square = float(np.sum(np.square(a.mean(axis=(0, 1)))))
    squares = _tile_means(np.sum(np.square(a), axis=2)) + _MSE_FLOOR**2 * mean_square
    error = np.sum(np.square(b - a), axis=2)
    relmse = float(np.mean(np.divide(error, squares, out=np.zeros_like(error), where=squares > 0)))
    bright_a, bright_b = luminance(a), luminance(b)
    floor = _MSE_FLOOR * max(float(bright_a.mean()), float(bright_b.mean()), base.FLOAT32_MIN_NORMAL)
    stops = np.log2(np.maximum(bright_b, floor) / np.maximum(bright_a, floor))
    size = np.abs(stops)
    return stops.astype(np.float32), {
        "relmse": relmse,
        "mean_stops": float(size.mean()),
        "bias_stops": float(np.log2(max(bright_b.mean(), floor) / max(bright_a.mean(), floor))),
        "worst_stops": float(np.percentile(size, 99.9)),
    }


def _tile_means(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values (h, w), each replaced by the mean of its tile; tiles at the right and the bottom may be smaller."""
    starts = [np.arange(0, size, _MSE_TILE) for size in values.shape]
    sums = np.add.reduceat(np.add.reduceat(values, starts[0], axis=0), starts[1], axis=1)
    sizes = [np.diff([*start, size]) for start, size in zip(starts, values.shape, strict=True)]
    means = sums / np.outer(*sizes)
    return np.asarray(means.repeat(sizes[0], axis=0).repeat(sizes[1], axis=1))
