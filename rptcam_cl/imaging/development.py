"""From light on the film to the picture on a screen: what a sensor makes of it, noise removed, tone, white balance."""

from __future__ import annotations

import importlib.util
import math
import struct
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, replace
from functools import partial
from importlib.metadata import version
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LUMENS_PER_WATT
from rptcam_cl.core import colour as colour_spaces
from rptcam_cl.core.colour import Matrix, electrons_per_joule, luminance, srgb_from_xyz
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.remember import checkpoint
from rptcam_cl.scene.film import Bayer, Gamut, PictureSettings, ToneCurve, WhiteBalance
from rptcam_cl.scene.scene import Scene

Pixels = NDArray[np.float32]

# A sensor during an exposure: its amounts by EMVA 1288, its speed by ISO 12232, how its channels see colours.

# Colour filter mosaics: which pixel sees which colour, and the colours that are missing.

CHANNELS = {"R": 0, "G": 1, "B": 2}


def _is_mosaic(pattern: str) -> bool:
    """Return whether a pattern is one of colours, as RGGB, and not ``none`` or ``monochrome``."""
    return set(pattern) <= CHANNELS.keys()


def _check_size(bayer: str, width: int, height: int) -> None:
    """Raise an error when a picture is too small for a mosaic.

    Raises
    ------
    InputError
        It says what would be large enough.
    """
    if _is_mosaic(bayer) and min(width, height) < 2:
        raise InputError(
            f"sensor.bayer: a mosaic needs more pixels (got {width} x {height};"
            " allowed: at least 2 x 2, or bayer: none)"
        )


def places(pattern: str) -> Iterator[tuple[int, tuple[slice, slice]]]:
    """Yield the channel of each of the 2 x 2 places of a pattern, and the index of its pixels."""
    for place, colour in enumerate(pattern):
        yield CHANNELS[colour], (slice(place // 2, None, 2), slice(place % 2, None, 2))


def mosaic(values: NDArray[Any], pattern: str) -> NDArray[Any]:
    """The values (height, width) that the pixels behind a mosaic see of values (height, width, 3)."""
    seen = np.empty(values.shape[:2], values.dtype)
    for channel, index in places(pattern):
        seen[index] = values[(*index, channel)]
    return seen


Array = NDArray[np.float64]

# H. Malvar, L. He and R. Cutler, "High-quality linear interpolation for demosaicing of Bayer-patterned color images",
# ICASSP 2004, figure 2: eighths of the pixels round the one whose colour is missing.
_GREEN = np.array([[0, 0, -1, 0, 0], [0, 0, 2, 0, 0], [-1, 2, 4, 2, -1], [0, 0, 2, 0, 0], [0, 0, -1, 0, 0]]) / 8
_ALONG_ROW = np.array(
    [[0, 0, 0.5, 0, 0], [0, -1, 0, -1, 0], [-1, 4, 5, 4, -1], [0, -1, 0, -1, 0], [0, 0, 0.5, 0, 0]]
) / 8  # fmt: skip
_ACROSS = np.array(
    [[0, 0, -1.5, 0, 0], [0, 2, 0, 2, 0], [-1.5, 0, 6, 0, -1.5], [0, 2, 0, 2, 0], [0, 0, -1.5, 0, 0]]
) / 8  # fmt: skip

# Means of the nearest pixels that have the colour.
_NEAREST_GREEN = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]]) / 4
_NEAREST_IN_ROW = np.array([[0, 0, 0], [1, 0, 1], [0, 0, 0]]) / 2
_NEAREST_DIAGONAL = np.array([[1, 0, 1], [0, 0, 0], [1, 0, 1]]) / 4

KERNELS = {"malvar": (_GREEN, _ALONG_ROW, _ACROSS), "bilinear": (_NEAREST_GREEN, _NEAREST_IN_ROW, _NEAREST_DIAGONAL)}


def _convolve(values: Array, kernel: Array) -> Array:
    """Return the sum of the pixels round each, weighted; values go on mirrored, which keeps the mosaic in step."""
    reach = kernel.shape[0] // 2
    height, width = values.shape
    wide = np.pad(values, reach, mode="reflect")
    total = np.zeros_like(values)
    for (row, column), weight in np.ndenumerate(kernel):
        if weight:
            total += weight * wide[row : row + height, column : column + width]
    return total


def interpolate_colours(values: NDArray[np.floating], pattern: str, method: str = "malvar") -> Array:
    """Return all three colours of every pixel (height, width, 3).

    Parameters
    ----------
    values : (height, width) array
        What the pixels saw, white balanced; at least 2 x 2.
    pattern : str
        Colours of the upper left 2 x 2 pixels by rows, as ``RGGB``.
    method : str
        ``malvar`` (gradient-corrected, Malvar 2004) or ``bilinear``.
    """
    seen = np.asarray(values, np.float64)
    green, along, across = KERNELS[method]
    filtered = {"green": _convolve(seen, green), "row": _convolve(seen, along)}
    filtered |= {"column": _convolve(seen, along.T), "across": _convolve(seen, across)}
    colours = np.empty((*seen.shape, 3))
    sites = list(places(pattern))
    for place, (channel, index) in enumerate(sites):
        beside = sites[place ^ 1][0]  # the other colour of the row
        for wanted in range(3):
            if wanted == channel:
                source = seen
            elif wanted == 1:
                source = filtered["green"]
            elif channel == 1:
                source = filtered["row" if wanted == beside else "column"]
            else:
                source = filtered["across"]
            colours[(*index, wanted)] = source[index]
    return colours


PATTERNS: tuple[str, ...] = get_args(Bayer)
_AMOUNTS = ("full_well_e", "read_noise_e", "system_gain_dn_per_e", "black_level_dn", "dark_e", "prnu", "dsnu_e")

# ISO 12232, saturation-based speed: S = 78 / H, where H [lx s] is the exposure that just saturates.
_SATURATION_LUX_SECONDS = 78.0


@dataclass(frozen=True, eq=False)
class SensorModel:
    """A sensor during one exposure.

    Attributes
    ----------
    electrons : (3, 3) array
        Mean electrons in each channel of the sensor (columns) for a value 1 in each channel of the film (rows).
    full_well_e : float
        Most electrons that a pixel holds.
    read_noise_e : float
        Standard deviation of the noise of reading [electrons].
    dark_e : float
        Mean electrons that come without light during the exposure.
    system_gain_dn_per_e : float
    black_level_dn : float
    bit_depth : int
    prnu : float
        Standard deviation of the sensitivity from pixel to pixel, as a share.
    dsnu_e : float
        Standard deviation of the dark signal from pixel to pixel [electrons].
    bayer : str
        Colours of the upper left 2 x 2 pixels of the whole film by rows, ``none`` or ``monochrome``.
    demosaic : str
        ``malvar`` or ``bilinear``.
    seed, pattern_seed : int
        Seeds of the noise and of the fixed pattern.
    origin : pair of int
        Column and row of the upper left pixel in the whole film.
    """

    electrons: NDArray[np.float64]
    full_well_e: float
    read_noise_e: float
    system_gain_dn_per_e: float
    black_level_dn: float
    bit_depth: int
    bayer: str
    dark_e: float = 0.0
    prnu: float = 0.0
    dsnu_e: float = 0.0
    demosaic: str = "malvar"
    seed: int = 0
    pattern_seed: int = 0
    origin: tuple[int, int] = (0, 0)

    @property
    def pattern(self) -> str:
        """Colours of the picture's own upper left 2 x 2 pixels, ``none`` or ``monochrome``."""
        if len(self.bayer) != 4 or self.bayer == "none":
            return self.bayer
        x, y = self.origin
        return "".join(self.bayer[2 * ((row + y) % 2) + (column + x) % 2] for row in (0, 1) for column in (0, 1))

    @property
    def top_dn(self) -> int:
        """Highest number of the converter."""
        return int(2**self.bit_depth - 1)

    @property
    def dark_level_dn(self) -> float:
        """Mean number without light, dark current included."""
        return self.black_level_dn + self.system_gain_dn_per_e * min(self.dark_e, self.full_well_e)

    @property
    def white_level_dn(self) -> float:
        """Number at which a channel saturates: of a full well, or the converter's highest."""
        return min(self.black_level_dn + self.system_gain_dn_per_e * self.full_well_e, float(self.top_dn))

    @property
    def white_electrons(self) -> NDArray[np.float64]:
        """Electrons for a film of white 1: (3,) per channel, (1,) of a monochrome sensor."""
        return _electrons_of_white(self.electrons, self.bayer)

    def described(self) -> dict[str, Any]:
        """Return the sensor as a mapping for JSON, from which `from_description` makes it again."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        return {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in values.items()}

    def _check(self) -> None:
        """Raise ValueError where a value is not of its kind, or none that a sensor has."""
        whole = {"bit_depth": (1, 16), "seed": (0, 2**64 - 1), "pattern_seed": (0, 2**64 - 1)}
        for name, (least, most) in whole.items():
            value = getattr(self, name)
            if type(value) is not int or not least <= value <= most:
                raise ValueError(f"{name} is {value!r}")
        for name in _AMOUNTS:
            value = getattr(self, name)
            if type(value) not in (int, float) or not 0 <= value < 1e30:
                raise ValueError(f"{name} is {value!r}")
        if not (self.full_well_e and self.system_gain_dn_per_e and np.isfinite(self.electrons).all()):
            raise ValueError("a sensor without a well, gain or response")
        if self.bayer not in PATTERNS or self.demosaic not in KERNELS or min(self.origin) < 0:
            raise ValueError(f"bayer is {self.bayer!r}, demosaic {self.demosaic!r}, origin {self.origin!r}")

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> SensorModel:
        """Return the sensor of a mapping that `described` made, maybe in another version or edited since.

        Raises
        ------
        InputError
            When it does not describe a sensor.
        """
        try:
            values: dict[str, Any] = dict(description)
            values["electrons"] = np.array(values["electrons"], np.float64).reshape(3, 3)
            values["origin"] = (int(values["origin"][0]), int(values["origin"][1]))
            sensor = cls(**values)
            sensor._check()
            return sensor
        except (KeyError, TypeError, ValueError, IndexError, OverflowError) as error:
            raise InputError(f"the metadata describe no sensor ({error!r}; render the scene anew)") from None


def _electrons_of_white(electrons: NDArray[np.float64], bayer: str) -> NDArray[np.float64]:
    """The electrons of a pixel for white: (3,) by the channels of a sensor, (1,) of a monochrome one, which sees all.

    Parameters
    ----------
    electrons : (film, sensor) array
        Electrons in each channel of the sensor for light in each channel of the film.
    bayer : str
        Mosaic, ``none`` or ``monochrome``.
    """
    total = electrons.sum(axis=0)
    return np.asarray(total.sum(keepdims=True) if bayer == "monochrome" else total)


def white_electrons_at_iso(white_per_joule: float, pixel_area_m2: float, iso: float) -> float:
    """Return the electrons that white light of the saturating exposure of an ISO speed gives the fullest channel.

    Parameters
    ----------
    white_per_joule : float
        Electrons [1/J] in that channel for white light.
    pixel_area_m2 : float
        Area on which a pixel gathers light [m²].
    iso : float
    """
    joules_per_m2 = _SATURATION_LUX_SECONDS / iso / LUMENS_PER_WATT
    return white_per_joule * pixel_area_m2 * joules_per_m2


def system_gain(top_dn: float, black_level_dn: float, saturation_e: float) -> float:
    """Return the gain [DN/electron] with which a number of electrons just reaches the converter's highest number."""
    return (top_dn - black_level_dn) / saturation_e


def rgb_from_balanced(sensor: SensorModel) -> NDArray[np.float64]:
    """Return the matrix (3, 3) from white-balanced raw channels to linear sRGB; white stays white.

    It undoes how the sensor's channels see the colours of the film: exact for light of RGB colours.
    """
    return np.linalg.inv((sensor.electrons / sensor.electrons.sum(axis=0)).T)


def camera_from_xyz(sensor: SensorModel) -> NDArray[np.float64]:
    """Return the matrix (3, 3) from CIE XYZ under D65 to raw channels, whose highest is 1 for white of Y = 1."""
    return np.asarray(sensor.electrons.T @ srgb_from_xyz() / sensor.white_electrons.max())


# What a sensor puts out: light of the film becomes electrons and numbers (EMVA 1288), and a linear picture again.

_MOST_ELECTRONS = 1e15  # of a pixel; beyond any well, and within what random numbers of a Poisson law are made for
_PHOTONS, _READING, _SENSITIVITY, _OFFSET = range(4)


def expose(film: NDArray[np.floating], sensor: SensorModel) -> NDArray[np.uint16]:
    """The raw numbers [DN] of a linear film, (height, width) or (height, width, 3).

    The same seeds give the same numbers with one version of NumPy.

    Parameters
    ----------
    film : (height, width, 3) array
        Linear film; not-a-number counts as 0, and so does light that a channel would see as less than nothing.
    sensor : SensorModel

    Raises
    ------
    InputError
        The picture is too small for a Bayer mosaic.
    """
    mean = _mean_electrons(film, sensor) * (1.0 + sensor.prnu * _pattern(_SENSITIVITY, film.shape, sensor))
    light = np.clip(mean + sensor.dark_e, 0.0, _MOST_ELECTRONS)
    charge = _generator(_PHOTONS, sensor.seed).poisson(light).astype(np.float64)
    charge += sensor.dsnu_e * _pattern(_OFFSET, film.shape, sensor)
    np.minimum(charge, sensor.full_well_e, out=charge)
    if sensor.read_noise_e:
        charge += sensor.read_noise_e * _generator(_READING, sensor.seed).standard_normal(charge.shape)
    level = np.floor(sensor.black_level_dn + sensor.system_gain_dn_per_e * charge + 0.5)
    return np.clip(level, 0, sensor.top_dn).astype(np.uint16)


def _mean_electrons(film: NDArray[np.floating], sensor: SensorModel) -> Array:
    """Return the mean electrons that light sets free in each pixel, (height, width) or (height, width, 3)."""
    _check_size(sensor.bayer, film.shape[1], film.shape[0])
    largest = float(np.finfo(np.float32).max)
    light = np.nan_to_num(np.asarray(film, np.float64), nan=0.0, posinf=largest, neginf=-largest)
    electrons = np.maximum(light @ sensor.electrons, 0.0)
    if sensor.bayer == "monochrome":
        return np.asarray(electrons.sum(axis=2))
    return mosaic(electrons, sensor.pattern) if _is_mosaic(sensor.bayer) else electrons


def _generator(stream: int, seed: int, *more: int) -> np.random.Generator:
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=(stream, *more))))


def _pattern(stream: int, shape: tuple[int, ...], sensor: SensorModel) -> Array:
    """Return standard normal numbers that belong to the pixels of the whole film, whatever part of it is seen."""
    amount = sensor.prnu if stream == _SENSITIVITY else sensor.dsnu_e
    height, width = shape[:2]
    depth = 3 if sensor.bayer == "none" else 1
    if not amount:
        return np.zeros((1, 1, 1) if depth == 3 else (1, 1))
    left, top = sensor.origin
    rows = np.empty((height, width, depth))
    for row in range(height):
        numbers = _generator(stream, sensor.pattern_seed, top + row).standard_normal((left + width, depth))
        rows[row] = numbers[left:]
    return rows if depth == 3 else rows[..., 0]


def linear_picture(numbers: NDArray[Any], sensor: SensorModel) -> NDArray[np.float32]:
    """The linear picture (height, width, 3) of raw numbers, in the scale of the film and in linear sRGB.

    Highlights stay neutral: all channels end where, after white balance, the first of them saturates.
    """
    scale = 1.0 / (sensor.system_gain_dn_per_e * sensor.white_electrons)
    if _is_mosaic(sensor.bayer):
        shape = (*numbers.shape, 3)
        per_pixel = mosaic(np.broadcast_to(scale, shape), sensor.pattern)
    else:
        per_pixel = scale if sensor.bayer == "none" else scale[0]
    ceiling = (sensor.white_level_dn - sensor.dark_level_dn) * scale.min()
    balanced = np.minimum((numbers - sensor.dark_level_dn) * per_pixel, ceiling)
    if sensor.bayer == "monochrome":
        return np.repeat(balanced[..., None], 3, axis=2).astype(np.float32)
    colours = interpolate_colours(balanced, sensor.pattern, sensor.demosaic) if _is_mosaic(sensor.bayer) else balanced
    return np.asarray(colours @ rgb_from_balanced(sensor).T, np.float32)


def binned_exposure(film: NDArray[np.floating], sensor: SensorModel, pixels: float, seed: int) -> NDArray[np.float32]:
    """Return the linear picture (height, width, 3) of a film each of whose pixels so many of the sensor share.

    The colours of a mosaic have their shares of them. The noise is that of photons, dark current, reading and rounding,
    and what fills a pixel is white. The fixed pattern, which cameras take off, is left out.

    Parameters
    ----------
    film : (height, width, 3) array
        As for `expose`.
    sensor : SensorModel
    pixels : float
        Of the sensor, for one of the film; may be less than 1.
    seed : int
        In place of the sensor's.
    """
    plain, count = sensor, np.array([pixels])
    if _is_mosaic(sensor.bayer):
        plain = replace(sensor, bayer="none")
        count = pixels * np.array([sensor.bayer.count(colour) / len(sensor.bayer) for colour in CHANNELS])
    if plain.bayer == "monochrome":
        count = count[0]
    light = np.clip(_mean_electrons(film, plain) + sensor.dark_e, 0.0, _MOST_ELECTRONS)
    random = _generator(_PHOTONS, seed)
    charge = np.minimum(random.poisson(np.minimum(light * count, _MOST_ELECTRONS)) / count, sensor.full_well_e)
    rounded_e = 1 / (math.sqrt(12) * sensor.system_gain_dn_per_e)
    charge += np.hypot(sensor.read_noise_e, rounded_e) / np.sqrt(count) * random.standard_normal(charge.shape)
    numbers = sensor.black_level_dn + sensor.system_gain_dn_per_e * charge
    return linear_picture(np.clip(numbers, 0.0, sensor.top_dn), plain)


# The sensor that a scene describes, behind the film that a render made.

_WELL_E_PER_UM2 = 2000.0  # a usual density; of the presets, from 720 (kac-12040) to 3400 (imx477)


def sensor_of(scene: Scene, metadata: Mapping[str, Any]) -> SensorModel | None:
    """Return the scene's sensor, ready for the film of a render; None when the scene has none.

    With ``exposure: relative`` the film's 1 of white just saturates the sensor. Otherwise the film is an irradiance in
    the scale that the metadata give, over the time of the exposure.

    Parameters
    ----------
    scene : Scene
        With its exposure resolved.
    metadata : mapping
        Of the rendered image: its window, and what the exposure came to.
    """
    settings = scene.sensor
    if settings is None:
        return None
    per_joule = electrons_per_joule(settings.response, settings.quantum_efficiency)
    white_per_joule = float(_electrons_of_white(per_joule, settings.bayer).max())
    area = pixel_area_m2(scene)
    well = settings.full_well_e or max(1.0, _WELL_E_PER_UM2 * area * 1e12)
    saturation = well
    if (iso := metadata.get("iso")) is not None:
        saturation = min(well, white_electrons_at_iso(white_per_joule, area, float(iso)))
    top, black = 2**settings.bit_depth - 1, settings.black_dn
    gain = settings.system_gain_dn_per_e or system_gain(top, black, saturation)
    if scene.exposure.mode == "relative":
        if settings.system_gain_dn_per_e is not None:
            saturation = min(well, (top - black) / gain)
        electrons = per_joule * (saturation / white_per_joule)
    else:
        electrons = per_joule * _joules_per_value(scene, metadata, area)
    x, y, _, _ = metadata["window"]
    return SensorModel(
        electrons=np.asarray(electrons),
        full_well_e=well,
        read_noise_e=settings.read_noise_e,
        system_gain_dn_per_e=gain,
        black_level_dn=black,
        bit_depth=settings.bit_depth,
        bayer=settings.bayer,
        dark_e=settings.dark_current() * scene.shutter.time_s,
        prnu=settings.prnu,
        dsnu_e=settings.dsnu_e,
        demosaic=settings.demosaic,
        seed=_seed_at(scene.shutter.open_s, scene.render.seed if settings.seed is None else settings.seed),
        pattern_seed=settings.pattern_seed,
        origin=(int(x), int(y)),
    )


def _seed_at(open_s: float, seed: int) -> int:
    """Return the seed of an exposure that begins at a moment [s]: frames of a sequence do not share their noise."""
    if open_s == 0.0:
        return seed
    words = struct.unpack("<2I", struct.pack("<d", open_s))
    return int(np.random.SeedSequence([seed, *words]).generate_state(1, np.uint64)[0])


def _joules_per_value(scene: Scene, metadata: Mapping[str, Any], area_m2: float) -> float:
    """Return the energy [J] that a film of value 1 brings to a pixel during the exposure."""
    filtered = 2.0**-scene.exposure.neutral_density_stops
    joules: float = area_m2 * scene.shutter.time_s * filtered / float(metadata["values_per_irradiance"])
    return joules


def check_sensor(scene: Scene, width: int, height: int) -> None:
    """Raise an error, before anything is rendered, when a picture of so many pixels is too small for the sensor.

    Raises
    ------
    InputError
        It says what would be large enough.
    """
    if scene.sensor is not None:
        _check_size(scene.sensor.bayer, width, height)


def pixel_area_m2(scene: Scene) -> float:
    """Return the area on which a pixel gathers light [m²]."""
    if scene.sensor is not None and scene.sensor.pixel_pitch_um is not None:
        return float(scene.sensor.pixel_pitch_um * 1e-6) ** 2
    (width, height), (columns, rows) = scene.film.size_m(), scene.film.resolution
    return width / columns * height / rows


#
# Removing noise by Intel Open Image Denoise, guided by the layers albedo and normal. It runs on the processor.
#
# The network guesses what the noise hides: the result looks clean, yet its error has no bound and does not vanish as
# samples are added. The picture's metadata say so.

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
        # The network takes light below 1e-8 for none, whatever its unit: here that is so of the mean.
        digits = -int(np.frexp(np.abs(wide, dtype=np.float64).mean())[1])
        bright = np.ldexp(wide, digits)
        clean = _within_channels(partial(pyoidn.denoise, normal=facing, hdr=True, quality=quality), bright, guide)
    except (ImportError, OSError, RuntimeError) as error:
        raise InputError(f"denoising failed: {error}") from error
    inside = slice(_MARGIN_PX, -_MARGIN_PX)
    clean = np.ldexp(clean[inside, inside], -digits)
    return np.ascontiguousarray(clean, np.float32), f"Open Image Denoise (pyoidn {version('pyoidn')}), biased"


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
