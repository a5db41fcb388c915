"""What makes a TIFF file of raw numbers a digital negative (DNG specification 1.4, Adobe 2012)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from fractions import Fraction
from typing import Any

import numpy as np

from rptcam_cl.imaging.mosaic import CHANNELS
from rptcam_cl.imaging.raw_frame import RawFrame
from rptcam_cl.imaging.sensor import SensorModel, camera_from_xyz

# Types of TIFF fields, as tifffile numbers them.
_BYTE, _ASCII, _SHORT, _LONG, _RATIONAL, _SRATIONAL = 1, 2, 3, 4, 5, 10

CFA, LINEAR_RAW = 32803, 34892  # photometric interpretations
_D65 = 21  # illuminant, by EXIF
_VERSION, _OLDEST_READER = (1, 4, 0, 0), (1, 2, 0, 0)
_LARGEST = 2**31 - 1

Tag = tuple[int, int, int, Any, bool]


def photometric_of(frame: RawFrame) -> int:
    """Return what the numbers stand for: a mosaic, or linear values of whole pixels."""
    return LINEAR_RAW if frame.numbers.ndim == 3 or frame.sensor.pattern == "monochrome" else CFA


def dng_tags(frame: RawFrame, metadata: Mapping[str, Any]) -> list[Tag]:
    """Return the tags beside those of plain TIFF: number, type, count, value, and that they belong to each page."""
    sensor = frame.sensor
    planes = 3 if frame.numbers.ndim == 3 else 1
    tags: list[Tag] = [
        _bytes(50706, _VERSION),
        _bytes(50707, _OLDEST_READER),
        (271, _ASCII, 0, "rptcam_cl", True),  # make
        (272, _ASCII, 0, "path-traced camera", True),  # model
        (50708, _ASCII, 0, "rptcam_cl path-traced camera", True),  # the same, unique
        (274, _SHORT, 1, 1, True),  # upright
        (50714, _RATIONAL, planes, _fractions([sensor.dark_level_dn] * planes), True),
        (50717, _LONG, planes, (math.floor(sensor.white_level_dn),) * planes, True),
        *_exposure_tags(metadata),
    ]
    if sensor.pattern != "monochrome":
        tags += _colour_tags(sensor)
    if photometric_of(frame) == CFA:
        tags += [
            (33421, _SHORT, 2, (2, 2), True),  # size of the pattern
            _bytes(33422, tuple(CHANNELS[colour] for colour in sensor.pattern)),
            _bytes(50710, (0, 1, 2)),  # the planes are red, green and blue
            (50711, _SHORT, 1, 1, True),  # pixels lie in a rectangle
        ]
    return tags


def _colour_tags(sensor: SensorModel) -> list[Tag]:
    """Return the tags with which a converter finds colours: the sensor's under D65, and its white."""
    neutral = sensor.white_electrons / sensor.white_electrons.max()
    return [
        (50721, _SRATIONAL, 9, _fractions(camera_from_xyz(sensor).ravel()), True),
        (50778, _SHORT, 1, _D65, True),
        (50728, _RATIONAL, 3, _fractions(neutral), True),
    ]


def _exposure_tags(metadata: Mapping[str, Any]) -> list[Tag]:
    """Return exposure time, f-number, focal length and ISO speed, as TIFF/EP has them, where they are known."""
    tags: list[Tag] = []
    for tag, key in ((33434, "exposure_time_s"), (33437, "f_number"), (37386, "focal_length_mm")):
        value = metadata.get(key)
        if isinstance(value, (int, float)) and 0 < value < _LARGEST:
            tags.append((tag, _RATIONAL, 1, _fractions([value]), True))
    iso = metadata.get("iso")
    if isinstance(iso, (int, float)) and 1 <= iso <= 65535:
        tags.append((34855, _SHORT, 1, round(iso), True))
    return tags


def _bytes(tag: int, values: tuple[int, ...]) -> Tag:
    return (tag, _BYTE, len(values), bytes(values), True)


def _fractions(values: Iterable[float]) -> tuple[int, ...]:
    """Return numerators and denominators in turn, of 31 bits."""
    found: list[int] = []
    for value in values:
        near = Fraction(float(value)).limit_denominator(max(1, min(1_000_000, int(_LARGEST / max(abs(value), 1.0)))))
        if not near and value:
            near = Fraction(int(np.sign(value)), min(math.ceil(1 / abs(value)), _LARGEST))
        found += [near.numerator, near.denominator]
    return tuple(found)
