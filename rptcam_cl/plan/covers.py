"""What the dielectric cover of a plastic lets in and out, by quadrature in float64."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_GRID = 96  # points along each side of the square of facet normals
_COSINES = np.concatenate([[0.02, 0.05], np.linspace(0.1, 1.0, 25)])
_DEGREE = 4  # of kernels/material/cover.h


def fresnel(cosine: Array, index: float) -> Array:
    """Return the unpolarised reflectance of a smooth dielectric of index >= 1 from outside."""
    inside = np.sqrt(1 - (1 - cosine**2) / index**2)
    s, p = (cosine - index * inside) / (cosine + index * inside), (index * cosine - inside) / (index * cosine + inside)
    return np.asarray((s**2 + p**2) / 2)


def rough_albedo(cosine: float, alpha: tuple[float, float], index: float) -> float:
    """Return the share of light from a direction that GGX facets of a dielectric reflect once.

    Over visible normals (Heitz 2014) on a midpoint grid of their spherical cap (Dupuy and Benyoub 2023); with two
    alphas, for their geometric mean.
    """
    a = float(np.sqrt(alpha[0] * alpha[1]))
    u, v = np.meshgrid(*[(np.arange(_GRID) + 0.5) / _GRID] * 2)
    wi = np.array([np.sqrt(1 - cosine**2), 0.0, cosine])
    w = wi * (a, a, 1)
    w /= np.linalg.norm(w)
    z = (1 - v) * (1 + w[2]) - w[2]
    r = np.sqrt(np.clip(1 - z**2, 0, None))
    h = np.stack([r * np.cos(2 * np.pi * u) + w[0], r * np.sin(2 * np.pi * u), z + w[2]], axis=-1) * (a, a, 1)
    h /= np.linalg.norm(h, axis=-1, keepdims=True)
    c = h @ wi
    up = 2 * c * h[..., 2] - cosine
    z = np.where(up > 0, up, 1.0)
    stretch_i, stretch_o = (np.sqrt(x**2 + a**2 * (1 - x**2)) for x in (cosine, z))
    passed = z * (cosine + stretch_i) / (z * stretch_i + cosine * stretch_o)
    return float(np.where(up > 0, passed * fresnel(c, index), 0.0).mean())


@lru_cache(maxsize=256)
def rough_cover(alpha: tuple[float, float], index: float) -> tuple[float, ...]:
    """Return the coefficients of the share that a rough cover reflects: a quartic in 1 - cosine, from above."""
    share = np.array([rough_albedo(cosine, alpha, index) for cosine in _COSINES])
    powers = (1 - _COSINES)[:, None] ** np.arange(_DEGREE + 1)
    weight = np.sqrt(_COSINES)
    fit = np.linalg.lstsq(powers * weight[:, None], share * weight, rcond=None)[0]
    for power, part in ((0, _COSINES > 0.5), (_DEGREE, _COSINES <= 0.5)):  # lifted until nothing is too low
        fit[power] += max(float(np.max((share - powers @ fit)[part] / powers[part, power])), 0.0)
    return tuple(map(float, fit))


def cover_mean(cover: tuple[float, ...]) -> float:
    """Return the share of even light that a cover reflects: the integral of 2 mu E(mu)."""
    return float(sum(2 * c / ((i + 1) * (i + 2)) for i, c in enumerate(cover)))


@lru_cache(maxsize=256)
def smooth_mean(index: float) -> float:
    """Return the share of even light that a smooth cover reflects from outside."""
    cosines = (np.arange(4096) + 0.5) / 4096
    return float(np.mean(2 * cosines * fresnel(cosines, index)))


def internal_reflectance(outside: float, index: float) -> float:
    """Return the share of diffuse light from inside that a cover reflects, given the share from outside.

    As much light passes an interface either way: (1 - inside) index^2 = 1 - outside.
    """
    return 1 - (1 - outside) / index**2
