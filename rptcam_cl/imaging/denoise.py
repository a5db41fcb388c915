"""Removing noise by Intel Open Image Denoise, guided by the layers albedo and normal. It runs on the processor.

The network guesses what the noise hides: the result looks clean, yet its error has no bound and does not vanish as
samples are added. The picture's metadata say so.
"""

from __future__ import annotations

import importlib.util
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError

GUIDES = ("albedo", "normal")


def check_denoiser() -> None:
    """Raise an error when the package that denoises is not installed.

    Raises
    ------
    InputError
        It says how to install it.
    """
    if importlib.util.find_spec("pyoidn") is None:
        raise InputError('denoising needs the package pyoidn (pip install "rptcam_cl[denoise]")')


def denoised(
    pixels: NDArray[np.float32], albedo: NDArray[np.float32], normal: NDArray[np.float32]
) -> tuple[NDArray[np.float32], str]:
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

        clean = pyoidn.denoise(pixels, albedo=albedo, normal=normal, hdr=True)
    except (ImportError, OSError, RuntimeError) as error:
        raise InputError(f"denoising failed: {error}") from error
    return np.asarray(clean, np.float32), f"Open Image Denoise (pyoidn {version('pyoidn')}), biased"
