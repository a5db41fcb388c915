"""Removing noise by Intel Open Image Denoise, guided by the layers albedo and normal. It runs on the processor.

The network guesses what the noise hides: the result looks clean, yet its error has no bound and does not vanish as
samples are added. The picture's metadata say so.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from functools import partial
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import XYZ_FROM_RGB
from rptcam_cl.core.errors import InputError

Pixels = NDArray[np.float32]

GUIDES = ("albedo", "normal")
MARGIN_PX = 16  # with 8 or 32 the error is the same within a tenth


def check_denoiser() -> None:
    """Raise an error when the package that denoises is not installed.

    Raises
    ------
    InputError
        It says how to install it.
    """
    if importlib.util.find_spec("pyoidn") is None:
        raise InputError('denoising needs the package pyoidn (pip install "rptcam_cl[denoise]")')


def denoised(pixels: Pixels, albedo: Pixels, normal: Pixels) -> tuple[Pixels, str]:
    """Return the picture without its noise, and the name of what removed it.

    Parameters
    ----------
    pixels
        (height, width, 3), linear.
    albedo, normal
        Layers of the same shape.

    Raises
    ------
    InputError
        The denoiser is missing or fails.
    """
    check_denoiser()
    try:
        import pyoidn

        wide, guide, facing = (_with_margin(values) for values in (pixels, albedo, normal))
        clean = _within_channels(partial(pyoidn.denoise, normal=facing, hdr=True), wide, guide)
    except (ImportError, OSError, RuntimeError) as error:
        raise InputError(f"denoising failed: {error}") from error
    inside = slice(MARGIN_PX, -MARGIN_PX)
    return np.ascontiguousarray(
        clean[inside, inside], np.float32
    ), f"Open Image Denoise (pyoidn {version('pyoidn')}), biased"


def _with_margin(values: Pixels) -> Pixels:
    """Return a picture that goes on mirrored: the network takes what is beyond its edges for black."""
    return np.pad(values, ((MARGIN_PX, MARGIN_PX), (MARGIN_PX, MARGIN_PX), (0, 0)), mode="symmetric")


def _within_channels(denoise: Callable[..., Pixels], pixels: Pixels, albedo: Pixels) -> Pixels:
    """Return what a denoiser makes of a picture, which takes channels below 0, as spectral colours have, for 0.

    Such a picture goes through it in CIE XYZ, where every colour of light is positive, scaled so that white is
    (1, 1, 1) there, too.
    """
    if not (pixels < 0).any():
        return denoise(pixels, albedo=albedo)
    matrix = XYZ_FROM_RGB / XYZ_FROM_RGB.sum(axis=1, keepdims=True)
    seen, guide = (np.asarray(values @ matrix.T, np.float32) for values in (pixels, albedo))
    return np.asarray(denoise(seen, albedo=guide) @ np.linalg.inv(matrix).T)
