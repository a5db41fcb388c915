"""Pictures of the whole sphere for tests, and what they must look like: bilinear in float64."""

from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray

Array = NDArray[np.float64]


def save_exr(path: Path, pixels: Array) -> None:
    """Write linear colours (height, width, 3) as OpenEXR."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": np.ascontiguousarray(pixels, dtype=np.float32)}) as file:
        file.write(str(path))


def rough_sky(height: int = 32, width: int = 64) -> Array:
    """Return a picture with noise, a small bright sun, a bright column and coloured poles."""
    pixels = 0.2 + 0.2 * np.random.default_rng(1).random((height, width, 3))
    pixels[height // 4, width // 4 : width // 4 + 2] = [300, 200, 100]
    pixels[:, width // 2] = [0, 3, 0]
    pixels[0] = [5, 0, 0]
    pixels[-1] = [0, 0, 5]
    return pixels


def bilinear(pixels: Array, u: Array, v: Array) -> Array:
    """Return colours at u (from the left) and v (from the top), both 0 to 1: round about in u, ending in v."""
    height, width = pixels.shape[:2]
    x, y = u * width - 0.5, np.clip(v * height - 0.5, 0, height - 1)
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    below = np.minimum(top + 1, height - 1)
    right_share, below_share = (x - left)[..., None], (y - top)[..., None]

    def row(index: NDArray[np.int64]) -> Array:
        here, next_one = pixels[index, left % width], pixels[index, (left + 1) % width]
        return np.asarray(here + right_share * (next_one - here))

    return np.asarray(row(top) + below_share * (row(below) - row(top)))


def direction_of(u: Array, v: Array) -> Array:
    """Return the directions at u and v of a picture with +y up: its middle lies at -z, +x to the right."""
    longitude, polar = 2 * np.pi * (u - 0.5), np.pi * v
    return np.stack([np.sin(polar) * np.sin(longitude), np.cos(polar), -np.sin(polar) * np.cos(longitude)], axis=-1)


def irradiance(pixels: Array, normal: Array, finer: int = 12) -> Array:
    """Return the irradiance on a surface by quadrature over texels parted ``finer`` times each way."""
    height, width = pixels.shape[0] * finer, pixels.shape[1] * finer
    v, u = np.meshgrid((np.arange(height) + 0.5) / height, (np.arange(width) + 0.5) / width, indexing="ij")
    weight = np.maximum(direction_of(u, v) @ normal, 0) * np.sin(np.pi * v) * (np.pi / height) * (2 * np.pi / width)
    return np.asarray((bilinear(pixels, u, v) * weight[..., None]).sum(axis=(0, 1)))
