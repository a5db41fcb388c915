"""A sensor during an exposure: its amounts by EMVA 1288, its speed by ISO 12232, how its channels see colours."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LUMENS_PER_WATT
from rptcam_cl.core.colour import electrons_per_joule, srgb_from_xyz
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.film import Bayer
from rptcam_cl.scene.scene import Scene

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
