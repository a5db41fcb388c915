"""Pictures as the words that ``kernels/material/image.h`` reads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.pictures import Picture
from rptcam_cl.core.kinds import TexelFormat

Texels = NDArray[np.uint8] | NDArray[np.float32]
_LARGEST_EXPONENT = 15  # halves reach 2^16


def srgb_decoded(encoded: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the linear values of sRGB-encoded ones (IEC 61966-2-1)."""
    power = ((encoded + np.float32(0.055)) / np.float32(1.055)) ** np.float32(2.4)
    return np.where(encoded <= np.float32(0.04045), encoded / np.float32(12.92), power).astype(np.float32)


def colour_texels(picture: Picture, channel: str, *, encoded: bool) -> tuple[Texels, TexelFormat]:
    """Return red, green and blue of a picture, shape (height, width, 3), and how to store them.

    A single channel becomes grey. Floats come out linear, bytes as they are.
    """
    texels = picture.texels[..., :3] if channel == "rgb" else picture.texels[..., ["rgba".index(channel)] * 3]
    if texels.dtype == np.uint8:
        return texels, TexelFormat.SRGB if encoded else TexelFormat.LINEAR
    floats = texels.astype(np.float32, copy=False)
    return srgb_decoded(floats) if encoded else floats, TexelFormat.HALF


def packed(texels: Texels, form: TexelFormat) -> tuple[NDArray[np.uint32], float]:
    """Return the words of texels (height, width, 3) whose first row is on top, and what a stored 1 stands for.

    Rows start at the bottom; each ends with its first texel once more.
    """
    rows = np.concatenate([texels[::-1], texels[::-1, :1]], axis=1)
    if form is not TexelFormat.HALF:
        red, green, blue = (rows[..., index].astype(np.uint32) for index in range(3))
        return np.asarray(red | green << 8 | blue << 16, np.uint32).ravel(), 1.0
    exponent = int(np.frexp(rows.max())[1]) - _LARGEST_EXPONENT
    halves = np.zeros((*rows.shape[:2], 4), np.float16)
    halves[..., :3] = np.ldexp(rows, -exponent)
    return halves.view(np.uint32).ravel(), 2.0**exponent


def unpacked(
    words: NDArray[np.uint32], size: tuple[int, int], form: TexelFormat
) -> NDArray[np.uint8] | NDArray[np.float16]:
    """Return the texels (height, width, 3), the top row first, that `packed` made words of: bytes or scaled halves."""
    height, width = size
    numbers = words.view(np.float16 if form is TexelFormat.HALF else np.uint8)  # little-endian, as devices are
    return np.asarray(numbers.reshape(height, width + 1, 4)[::-1, :-1, :3])


def linear_mean(texels: Texels, form: TexelFormat) -> NDArray[np.float64]:
    """Return the mean linear colour of texels."""
    if form is TexelFormat.HALF:
        return np.asarray(texels.reshape(-1, 3).mean(axis=0, dtype=np.float64))
    linear = linear_codes(form).astype(np.float64)
    counts = [np.bincount(texels[..., index].ravel(), minlength=256) for index in range(3)]
    return np.array([count @ linear / count.sum() for count in counts])


def linear_codes(form: TexelFormat) -> NDArray[np.float32]:
    """Return the linear values of the 256 codes of a byte."""
    codes = np.arange(256, dtype=np.float32) / np.float32(255)
    return srgb_decoded(codes) if form is TexelFormat.SRGB else codes
