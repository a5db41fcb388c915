"""Bright parts of a picture around the scene, as distant points of light: a sun, lamps, windows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import luminance
from rptcam_cl.core.kinds import TexelFormat
from rptcam_cl.plan.environment import axes
from rptcam_cl.plan.pictures import Colours, PictureTable
from rptcam_cl.plan.texels import linear_codes, unpacked
from rptcam_cl.scene import ImageEnvironment, Scene

Array = NDArray[np.float64]

CONTRAST = 50.0  # times the mean of the sphere, from which a texel is bright
ACROSS_DEGREES = 1.0  # of the cells within which bright texels make one point


def bright_parts(scene: Scene) -> tuple[Array, Array]:
    """Return unit directions (n, 3) towards the bright parts of a scene's picture, and their irradiance (n, 3) [W/m2].

    There are none where the surroundings are no picture, or an even one.
    """
    image = scene.environment
    if not isinstance(image, ImageEnvironment):
        return np.zeros((0, 3)), np.zeros((0, 3))
    colours = PictureTable(scene).colours(image, "rgb", image.color_space)
    light = _linear(colours)
    height, width = light.shape[:2]
    elevation = np.pi * (0.5 - (np.arange(height) + 0.5) / height)
    solid = np.cos(elevation)[:, None] * np.ones(width)
    brightness = luminance(light)
    bright = brightness > CONTRAST * np.average(brightness, weights=solid)
    rows, columns = np.nonzero(bright)
    if not len(rows):
        return np.zeros((0, 3)), np.zeros((0, 3))
    angle = 2 * np.pi * ((columns + 0.5) / width - 0.5)
    up = elevation[rows]
    local = np.stack([np.cos(up) * np.sin(angle), np.sin(up), np.cos(up) * np.cos(angle)], axis=1)
    towards = local @ axes(image.up, image.rotation_degrees)
    flux = image.gain * light[rows, columns] * (np.cos(up) * 2 * np.pi / width * np.pi / height)[:, None]
    cell = max(round(height * ACROSS_DEGREES / 180), 1)
    _, place = np.unique((rows // cell) * width + columns // cell, return_inverse=True)
    irradiance = np.stack([np.bincount(place, part) for part in flux.T], axis=1)
    middle = np.stack([np.bincount(place, part * luminance(flux)) for part in towards.T], axis=1)
    return np.asarray(middle / np.linalg.norm(middle, axis=1)[:, None], np.float64), np.asarray(irradiance, np.float64)


def _linear(colours: Colours) -> Array:
    """Return the linear light (height, width, 3) of a picture, the top row first."""
    texels = unpacked(colours.words, colours.size, colours.form)
    if colours.form is TexelFormat.HALF:
        return np.asarray(colours.scale * texels.astype(np.float64))
    return np.asarray(linear_codes(colours.form)[texels], dtype=np.float64)
