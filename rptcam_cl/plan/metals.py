"""Metals by their optical constants: spectra from the literature, and what three channels see of them.

The colour at normal incidence is the reflectance of the spectrum under daylight D65 as the CIE 1931 observer sees it,
in linear sRGB; n and k of a channel are those that have this reflectance there and come nearest to the spectrum's at
slant.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

Spectrum = NDArray[np.float64]
HC = 1239.84198  # photon energy times wavelength [eV nm]

WAVELENGTHS = np.arange(380.0, 781.0, 10.0)  # [nm]
# Relative power of daylight D65 at these wavelengths (CIE 15).
DAYLIGHT = np.array([
    49.98, 54.65, 82.75, 91.49, 93.43, 86.68, 104.86, 117.01, 117.81, 114.86, 115.92, 108.81, 109.35, 107.80, 104.79,
    107.69, 104.41, 104.05, 100.00, 96.33, 95.79, 88.69, 90.01, 89.60, 87.70, 83.29, 83.70, 80.03, 80.21, 82.28, 78.28,
    69.72, 71.61, 74.35, 61.60, 69.89, 75.09, 63.59, 46.42, 66.81, 63.38,
])  # fmt: skip
RGB_FROM_XYZ = np.array([
    [3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252],
])  # fmt: skip
LARGEST_N = 20.0  # far above any metal's
SLANTS = np.arange(1, 10) / 10  # cosines at which channels are compared with the spectrum


@dataclass(frozen=True)
class Table:
    """Refractive index n + i k at photon energies [eV]."""

    energy: tuple[float, ...]
    n: tuple[float, ...]
    k: tuple[float, ...]

    def index(self, wavelength_nm: Spectrum) -> NDArray[np.complex128]:
        """Return the complex refractive index, linear in photon energy between the rows."""
        energy = HC / wavelength_nm
        return np.interp(energy, self.energy, self.n) + 1j * np.interp(energy, self.energy, self.k)


@dataclass(frozen=True)
class LorentzDrude:
    """A Drude term and Lorentz oscillators (strength, width, resonance) [eV] about a plasma energy [eV]."""

    plasma: float
    drude: tuple[float, float]
    oscillators: tuple[tuple[float, float, float], ...]

    def index(self, wavelength_nm: Spectrum) -> NDArray[np.complex128]:
        """Return the complex refractive index."""
        energy = HC / wavelength_nm
        strength, width = self.drude
        permittivity = 1 - strength * self.plasma**2 / (energy * (energy + 1j * width))
        for strength, width, resonance in self.oscillators:
            permittivity += strength * self.plasma**2 / (resonance**2 - energy**2 - 1j * energy * width)
        return np.asarray(np.sqrt(permittivity))


# P. B. Johnson and R. W. Christy, Phys. Rev. B 6, 4370 (1972).
_NOBLE = (1.51, 1.64, 1.76, 1.88, 2.01, 2.13, 2.26, 2.38, 2.50, 2.63, 2.75, 2.88, 3.00, 3.12, 3.25)
METALS: dict[str, Table | LorentzDrude] = {
    "copper": Table(
        _NOBLE,
        (0.26, 0.24, 0.21, 0.22, 0.30, 0.70, 1.02, 1.18, 1.22, 1.25, 1.24, 1.25, 1.28, 1.32, 1.33),
        (5.180, 4.665, 4.205, 3.747, 3.205, 2.704, 2.577, 2.608, 2.564, 2.483, 2.397, 2.305, 2.207, 2.116, 2.045),
    ),
    "gold": Table(
        _NOBLE,
        (0.16, 0.14, 0.13, 0.14, 0.21, 0.29, 0.43, 0.62, 1.04, 1.31, 1.38, 1.45, 1.46, 1.47, 1.46),
        (5.083, 4.542, 4.103, 3.697, 3.272, 2.863, 2.455, 2.081, 1.833, 1.849, 1.914, 1.948, 1.958, 1.952, 1.933),
    ),
    "silver": Table(
        _NOBLE,
        (0.04, 0.03, 0.04, 0.05, 0.06, 0.05, 0.06, 0.05, 0.05, 0.05, 0.04, 0.04, 0.05, 0.05, 0.05),
        (5.727, 5.242, 4.838, 4.483, 4.152, 3.858, 3.586, 3.324, 3.093, 2.869, 2.657, 2.462, 2.275, 2.070, 1.864),
    ),
    # P. B. Johnson and R. W. Christy, Phys. Rev. B 9, 5056 (1974), at 650, 550 and 450 nm.
    "iron": Table((1.907, 2.254, 2.755), (2.87, 2.95, 2.65), (3.12, 2.93, 2.77)),
    # A. D. Rakic et al., Appl. Opt. 37, 5271 (1998), tables 2 and 3.
    "aluminium": LorentzDrude(14.98, (0.523, 0.047), (
        (0.227, 0.333, 0.162), (0.050, 0.312, 1.544), (0.166, 1.351, 1.808), (0.030, 3.382, 3.473))),
    "chromium": LorentzDrude(10.75, (0.168, 0.047), (
        (0.151, 3.175, 0.121), (0.150, 1.305, 0.543), (1.149, 2.676, 1.970), (0.825, 1.335, 8.775))),
    "nickel": LorentzDrude(15.92, (0.096, 0.048), (
        (0.100, 4.511, 0.174), (0.135, 1.334, 0.582), (0.106, 2.178, 1.597), (0.729, 6.292, 6.089))),
    "platinum": LorentzDrude(9.59, (0.333, 0.080), (
        (0.191, 0.517, 0.780), (0.659, 1.838, 1.314), (0.547, 3.668, 3.141), (3.576, 8.517, 9.249))),
    "tungsten": LorentzDrude(13.22, (0.206, 0.064), (
        (0.054, 0.530, 1.004), (0.166, 1.281, 1.917), (0.706, 3.332, 3.580), (2.590, 5.836, 7.498))),
}  # fmt: skip


def observer(wavelength_nm: Spectrum) -> NDArray[np.float64]:
    """Return the CIE 1931 colour matching functions (3, n), fitted by Wyman, Sloan and Shirley, JCGT 2(2) 2013."""

    def lobe(height: float, centre: float, left: float, right: float) -> Spectrum:
        slope = np.where(wavelength_nm < centre, left, right)
        return np.asarray(height * np.exp(-0.5 * ((wavelength_nm - centre) * slope) ** 2))

    x = lobe(0.362, 442.0, 0.0624, 0.0374) + lobe(1.056, 599.8, 0.0264, 0.0323) - lobe(0.065, 501.1, 0.0490, 0.0382)
    y = lobe(0.821, 568.8, 0.0213, 0.0247) + lobe(0.286, 530.9, 0.0613, 0.0322)
    z = lobe(1.217, 437.0, 0.0845, 0.0278) + lobe(0.681, 459.0, 0.0385, 0.0725)
    return np.stack([x, y, z])


@cache
def _channel_weights() -> NDArray[np.float64]:
    """Weights (3, n) that take a reflectance spectrum to linear sRGB; each row sums to 1, so that white is white."""
    weights = RGB_FROM_XYZ @ (observer(WAVELENGTHS) * DAYLIGHT)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def reflectance(index: NDArray[np.complex128], cosine: ArrayLike = 1.0) -> NDArray[np.float64]:
    """Return the unpolarised Fresnel reflectance of a metal."""
    c = np.asarray(cosine, np.float64)
    inside = np.sqrt(1 - (1 - c * c) / index**2)
    s, p = (c - index * inside) / (c + index * inside), (index * c - inside) / (index * c + inside)
    return np.asarray((np.abs(s) ** 2 + np.abs(p) ** 2) / 2)


def metal_colour(name: str, cosine: float = 1.0) -> NDArray[np.float64]:
    """Return the reflectance of a metal in linear sRGB, cut to 0 … 1."""
    spectrum = reflectance(METALS[name].index(WAVELENGTHS), cosine)
    return np.clip(_channel_weights() @ spectrum, 0.0, 1.0)


@cache
def metal_constants(name: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return n and k of a metal per channel."""
    colour = np.minimum(metal_colour(name), 0.999)
    # n solves ((n - 1)^2 + k^2) / ((n + 1)^2 + k^2) = colour, in two ways, for every k up to a largest.
    middle = (1 + colour) / (1 - colour)
    k = np.linspace(0.0, 1.0, 801)[:, None] * np.sqrt(middle**2 - 1)
    spread = np.sqrt(np.maximum(middle**2 - 1 - k**2, 0.0))
    index = np.concatenate([middle - spread + 1j * k, middle + spread + 1j * k])
    errors = [np.square(reflectance(index, cosine) - metal_colour(name, cosine)) for cosine in SLANTS]
    best = np.where(index.real < LARGEST_N, np.sum(errors, axis=0), np.inf).argmin(axis=0)
    chosen = index[best, np.arange(3)]
    return tuple(map(float, chosen.real)), tuple(map(float, chosen.imag))
