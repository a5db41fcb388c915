"""Spectra that the scene's colours are known by, constants of its metals, indices of its solids.

The colour at normal incidence is the reflectance of the spectrum under daylight D65 as the CIE 1931 observer sees it,
in linear sRGB; n and k of a channel are those that have this reflectance there and come nearest to the spectrum's at
slant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.cameras import fewest_terms, fit_nodes
from rptcam_cl.colour import LINE_C_NM, LINE_D_NM, LINE_F_NM, Spectrum, metal_optics, srgb_from_reflectance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import DISPERSION_NM, DISPERSION_SCALE, DISPERSION_SHIFT
from rptcam_cl.optics import held_index, known_range
from rptcam_cl.scene import Dielectric, MetalSpectrum, SpectralColour


@dataclass
class KnownSpectra:
    """Spectra in the order of their numbers, from 1.

    Attributes
    ----------
    samples : list of arrays (401,)
        At `rptcam_cl.colour.WAVELENGTHS_NM`.
    lights : list of arrays (401,)
        Those of them that shine.
    colours : int
        How many times a colour of the scene was given as a spectrum.
    """

    samples: list[NDArray[np.float64]] = field(default_factory=list)
    lights: list[NDArray[np.float64]] = field(default_factory=list)
    colours: int = 0
    _numbers: dict[bytes, int] = field(default_factory=dict)

    def copied(self) -> KnownSpectra:
        """Return these to be added to."""
        return KnownSpectra(self.samples.copy(), self.lights.copy(), self.colours, self._numbers.copy())

    def number(self, value: Any, *, light: bool = False, gain: float = 1.0) -> int:
        """Return the number of a colour's spectrum, times a gain; 0 for a colour that has none."""
        if not isinstance(value, SpectralColour):
            return 0
        self.colours += 1
        samples = gain * value.samples
        if light:
            self.lights.append(samples)
        return self.add(samples)

    def add(self, samples: NDArray[np.float64]) -> int:
        """Return the number of samples."""
        key = samples.tobytes()
        if key not in self._numbers:
            self.samples.append(samples)
            self._numbers[key] = len(self.samples)
        return self._numbers[key]


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


Index = Callable[[ArrayLike], NDArray[np.float64]]


def is_dispersive(material: object) -> bool:
    """Return whether a material bends wavelengths by different angles."""
    if not isinstance(material, Dielectric) or material.glass is None:
        return False
    first, *others = dielectric_index(material)([LINE_F_NM, LINE_D_NM, LINE_C_NM])
    return any(other != first for other in others)


def dielectric_index(material: Dielectric) -> Index:
    """Return what gives the refractive index at wavelengths [nm]; beyond those of a glass's law, that of its end."""
    if material.glass is None:
        return lambda wavelength_nm: np.full(np.shape(wavelength_nm), material.index)
    glass = material.glass
    return lambda wavelength_nm: held_index(glass, wavelength_nm)


def fill_index(record: np.void, material: Dielectric) -> None:
    """Write the index of a material, and the polynomial over the inverse wavelength where it has a dispersion."""
    record["parameter"] = material.n_d
    if material.glass is None or not is_dispersive(material):
        return
    low, high = known_range(material.glass) or DISPERSION_NM
    low, high = max(low, DISPERSION_NM[0]), min(high, DISPERSION_NM[1])
    wavelengths = fit_nodes(low, high)
    (coefficients,) = fewest_terms(material.glass.index(wavelengths)[None], wavelengths)
    record["dispersion_terms"] = len(coefficients)
    record["dispersion"][: len(coefficients)] = coefficients
    record["dispersion_low"], record["dispersion_high"] = (
        DISPERSION_SCALE / nm - DISPERSION_SHIFT for nm in (high, low)
    )
