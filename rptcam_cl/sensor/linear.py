"""From raw numbers back to a linear picture: black level, white balance, highlights, mosaic, colour matrix."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.sensor.demosaic import demosaiced
from rptcam_cl.sensor.exposure import Frame
from rptcam_cl.sensor.model import Sensor
from rptcam_cl.sensor.mosaic import is_mosaic, mosaic
from rptcam_cl.spectra import srgb_from_xyz

Array = NDArray[np.float64]


def rgb_from_balanced(sensor: Sensor) -> Array:
    """Return the matrix (3, 3) from white-balanced raw channels to linear sRGB; white stays white.

    It undoes how the sensor's channels see the colours of the film: exact for light of RGB colours.
    """
    return np.linalg.inv((sensor.electrons / sensor.electrons.sum(axis=0)).T)


def camera_from_xyz(sensor: Sensor) -> Array:
    """Return the matrix (3, 3) from CIE XYZ under D65 to raw channels, whose highest is 1 for white of Y = 1."""
    return np.asarray(sensor.electrons.T @ srgb_from_xyz() / sensor.white_electrons.max())


def linear_picture(frame: Frame) -> NDArray[np.float32]:
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
