"""What a sensor puts out: light of the film becomes electrons and numbers (EMVA 1288), and a linear picture again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.imaging.mosaic import check_size, demosaiced, is_mosaic, mosaic
from rptcam_cl.imaging.sensor import SensorModel, rgb_from_balanced

Array = NDArray[np.float64]

MOST_ELECTRONS = 1e15  # of a pixel; beyond any well, and within what random numbers of a Poisson law are made for
_PHOTONS, _READING, _SENSITIVITY, _OFFSET = range(4)


@dataclass(frozen=True, eq=False)
class RawFrame:
    """What a sensor puts out.

    Attributes
    ----------
    numbers : uint16 array, (height, width) or (height, width, 3)
        The raw numbers [DN].
    sensor : SensorModel
    """

    numbers: NDArray[np.uint16]
    sensor: SensorModel


def exposed(film: NDArray[np.floating], sensor: SensorModel) -> RawFrame:
    """Return the raw frame of a linear film; the same seeds give the same numbers with one version of NumPy.

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
    mean = mean_electrons(film, sensor) * (1.0 + sensor.prnu * _pattern(_SENSITIVITY, film.shape, sensor))
    light = np.clip(mean + sensor.dark_e, 0.0, MOST_ELECTRONS)
    charge = _generator(_PHOTONS, sensor.seed).poisson(light).astype(np.float64)
    charge += sensor.dsnu_e * _pattern(_OFFSET, film.shape, sensor)
    np.minimum(charge, sensor.full_well_e, out=charge)
    if sensor.read_noise_e:
        charge += sensor.read_noise_e * _generator(_READING, sensor.seed).standard_normal(charge.shape)
    level = np.floor(sensor.black_level_dn + sensor.system_gain_dn_per_e * charge + 0.5)
    return RawFrame(np.clip(level, 0, sensor.top_dn).astype(np.uint16), sensor)


def mean_electrons(film: NDArray[np.floating], sensor: SensorModel) -> Array:
    """Return the mean electrons that light sets free in each pixel, (height, width) or (height, width, 3)."""
    check_size(sensor.bayer, film.shape[1], film.shape[0])
    largest = float(np.finfo(np.float32).max)
    light = np.nan_to_num(np.asarray(film, np.float64), nan=0.0, posinf=largest, neginf=-largest)
    electrons = np.maximum(light @ sensor.electrons, 0.0)
    if sensor.bayer == "monochrome":
        return np.asarray(electrons.sum(axis=2))
    return mosaic(electrons, sensor.pattern) if is_mosaic(sensor.bayer) else electrons


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


def linear_picture(frame: RawFrame) -> NDArray[np.float32]:
    """Return the linear picture (height, width, 3) of a raw frame, in the scale of the film and in linear sRGB.

    Highlights stay neutral: all channels end where, after white balance, the first of them saturates.
    """
    sensor = frame.sensor
    scale = 1.0 / (sensor.system_gain_dn_per_e * sensor.white_electrons)
    if is_mosaic(sensor.bayer):
        shape = (*frame.numbers.shape, 3)
        per_pixel = mosaic(np.broadcast_to(scale, shape), sensor.pattern)
    else:
        per_pixel = scale if sensor.bayer == "none" else scale[0]
    ceiling = (sensor.white_level_dn - sensor.dark_level_dn) * scale.min()
    balanced = np.minimum((frame.numbers - sensor.dark_level_dn) * per_pixel, ceiling)
    if sensor.bayer == "monochrome":
        return np.repeat(balanced[..., None], 3, axis=2).astype(np.float32)
    colours = demosaiced(balanced, sensor.pattern, sensor.demosaic) if is_mosaic(sensor.bayer) else balanced
    return np.asarray(colours @ rgb_from_balanced(sensor).T, np.float32)
