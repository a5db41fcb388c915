"""How much light the sheen of cloth sends back, by quadrature in float64 (Estevez and Kulla 2017)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass

Array = NDArray[np.float64]
_GRID = 128  # points along each side of the square of directions
_ROOTS = (np.arange(32) + 0.5) / 32  # of the cosines where the albedo is fitted
_SHALLOW = np.geomspace(1e-4, 0.2, 25)  # cosines among which the albedo is largest
_DEGREE = 4  # of kernels/material/sheen.h
# Their fit of Smith's Lambda at alpha 0 and 1: a, b, c, d, e of a / (1 + b x^c) + d x + e.
_FIT = np.array([[25.3245, 3.32435, 0.16801, -1.27393, -4.85967], [21.5473, 3.82987, 0.19823, -1.97760, -4.32054]])


@dataclass(frozen=True)
class SheenLobe:
    """What the kernels take of a sheen.

    Attributes
    ----------
    scale : float
        Factor on the formula with which no direction gets back more than arrives: 1 from a roughness of 0.25 on.
    peak : float
        Density of normals in the surface, with the factor.
    half : float
        Logarithm of Smith's Lambda at the cosine 0.5.
    albedo : tuple of float
        Coefficients of the logarithm of the share that a white sheen sends back: a quartic in the root of the cosine,
        from above.
    """

    scale: float
    peak: float
    half: float
    albedo: tuple[float, ...]


def sheen_lambda(cosine: Array, alpha: float) -> Array:
    """Return Smith's Lambda by the fit of Estevez and Kulla."""
    a, b, c, d, e = (1 - alpha) ** 2 * _FIT[0] + (1 - (1 - alpha) ** 2) * _FIT[1]
    x = np.where(cosine < 0.5, cosine, 1 - cosine)
    fit, half = (a / (1 + b * y**c) + d * y + e for y in (x, 0.5))
    return np.asarray(np.exp(np.where(cosine < 0.5, fit, 2 * half - fit)))


def sheen_density(sine: Array, alpha: float) -> Array:
    """Return the density of the fibres' normals by the sine of their angle to the surface's."""
    return np.asarray((2 + 1 / alpha) * sine ** (1 / alpha) / (2 * np.pi))


def sheen_albedo(cosine: float, alpha: float) -> float:
    """Return the share of light from a direction that a white sheen sends back."""
    node, weight = np.polynomial.legendre.leggauss(_GRID)
    root = (node[:, None] + 1) / 2
    z = root**2  # the lobe is narrow where the way out grazes
    turn = (np.arange(_GRID) + 0.5) / _GRID * np.pi
    h = np.stack(
        np.broadcast_arrays(
            np.sqrt(1 - cosine**2) + np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), cosine + z
        ),
        axis=-1,
    )
    sine = np.sqrt(np.clip(1 - h[..., 2] ** 2 / np.sum(h**2, axis=-1), 0, None))
    shadowed = 4 * cosine * (1 + sheen_lambda(np.array(cosine), alpha) + sheen_lambda(z, alpha))
    value = sheen_density(sine, alpha) / shadowed
    return float(2 * np.pi * (value.mean(axis=1) @ (weight * root[:, 0])))


@lru_cache(maxsize=256)
def sheen_lobe(alpha: float) -> SheenLobe:
    """Return what the kernels take of a sheen."""
    share = np.array([sheen_albedo(float(cosine), alpha) for cosine in _ROOTS**2])
    scale = 1 / max(1.0, *share, *(sheen_albedo(float(cosine), alpha) for cosine in _SHALLOW))
    share *= scale
    weight = np.sqrt(np.maximum(share, 1e-4)) * _ROOTS
    powers = _ROOTS[:, None] ** np.arange(_DEGREE + 1)
    wanted = np.log(np.maximum(share, 1e-8))
    fit = np.linalg.lstsq(powers * weight[:, None], wanted * weight, rcond=None)[0]
    counts = share > 0.02  # lifted until nothing that counts is too low
    fit[0] += max(float(np.max((wanted - powers @ fit)[counts])), 0.0)
    peak = scale * float(sheen_density(np.array(1.0), alpha))
    half = float(np.log(sheen_lambda(np.array(0.5), alpha)))
    return SheenLobe(scale, peak, half, tuple(map(float, fit)))
