"""What three channels see of metals.

The colour at normal incidence is the reflectance of the spectrum under daylight D65 as the CIE 1931 observer sees it,
in linear sRGB; n and k of a channel are those that have this reflectance there and come nearest to the spectrum's at
slant.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.scene.metal import MetalSpectrum
from rptcam_cl.spectra import Spectrum, metal_optics, srgb_from_reflectance

LARGEST_N = 20.0  # far above any metal's
SLANTS = np.arange(1, 10) / 10  # cosines at which channels are compared with the spectrum


def reflectance(index: NDArray[np.complex128], cosine: ArrayLike = 1.0) -> NDArray[np.float64]:
    """Return the unpolarised Fresnel reflectance of a metal."""
    c = np.asarray(cosine, np.float64)
    inside = np.sqrt(1 - (1 - c * c) / index**2)
    s, p = (c - index * inside) / (c + index * inside), (index * c - inside) / (index * c + inside)
    return np.asarray((np.abs(s) ** 2 + np.abs(p) ** 2) / 2)


def metal_spectra(metal: str | MetalSpectrum) -> tuple[Spectrum, Spectrum]:
    """Return n and k of a metal (401,), which is a name or a table."""
    return (metal.n, metal.k) if isinstance(metal, MetalSpectrum) else metal_optics(metal)


def metal_colour(metal: str | MetalSpectrum, cosine: float = 1.0) -> NDArray[np.float64]:
    """Return the reflectance of a metal in linear sRGB, cut to 0 … 1."""
    n, k = metal_spectra(metal)
    return np.clip(srgb_from_reflectance(reflectance(n + 1j * k, cosine)), 0.0, 1.0)


@lru_cache(maxsize=64)
def metal_constants(metal: str | MetalSpectrum) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return n and k of a metal per channel."""
    colour = np.minimum(metal_colour(metal), 0.999)
    # n solves ((n - 1)^2 + k^2) / ((n + 1)^2 + k^2) = colour, in two ways, for every k up to a largest.
    middle = (1 + colour) / (1 - colour)
    k = np.linspace(0.0, 1.0, 801)[:, None] * np.sqrt(middle**2 - 1)
    spread = np.sqrt(np.maximum(middle**2 - 1 - k**2, 0.0))
    index = np.concatenate([middle - spread + 1j * k, middle + spread + 1j * k])
    errors = [np.square(reflectance(index, cosine) - metal_colour(metal, cosine)) for cosine in SLANTS]
    best = np.where(index.real < LARGEST_N, np.sum(errors, axis=0), np.inf).argmin(axis=0)
    chosen = index[best, np.arange(3)]
    return tuple(map(float, chosen.real)), tuple(map(float, chosen.imag))
