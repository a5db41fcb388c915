"""Metals by their optical constants, from the literature."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour.spectrum import WAVELENGTHS_NM, Spectrum
from rptcam_cl.core.dataclass import dataclass

HC = 1239.84198  # photon energy times wavelength [eV nm]


@dataclass(frozen=True)
class OpticalTable:
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
METALS: dict[str, OpticalTable | LorentzDrude] = {
    "copper": OpticalTable(
        _NOBLE,
        (0.26, 0.24, 0.21, 0.22, 0.30, 0.70, 1.02, 1.18, 1.22, 1.25, 1.24, 1.25, 1.28, 1.32, 1.33),
        (5.180, 4.665, 4.205, 3.747, 3.205, 2.704, 2.577, 2.608, 2.564, 2.483, 2.397, 2.305, 2.207, 2.116, 2.045),
    ),
    "gold": OpticalTable(
        _NOBLE,
        (0.16, 0.14, 0.13, 0.14, 0.21, 0.29, 0.43, 0.62, 1.04, 1.31, 1.38, 1.45, 1.46, 1.47, 1.46),
        (5.083, 4.542, 4.103, 3.697, 3.272, 2.863, 2.455, 2.081, 1.833, 1.849, 1.914, 1.948, 1.958, 1.952, 1.933),
    ),
    "silver": OpticalTable(
        _NOBLE,
        (0.04, 0.03, 0.04, 0.05, 0.06, 0.05, 0.06, 0.05, 0.05, 0.05, 0.04, 0.04, 0.05, 0.05, 0.05),
        (5.727, 5.242, 4.838, 4.483, 4.152, 3.858, 3.586, 3.324, 3.093, 2.869, 2.657, 2.462, 2.275, 2.070, 1.864),
    ),
    # P. B. Johnson and R. W. Christy, Phys. Rev. B 9, 5056 (1974), at 650, 550 and 450 nm.
    "iron": OpticalTable((1.907, 2.254, 2.755), (2.87, 2.95, 2.65), (3.12, 2.93, 2.77)),
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


def metal_optics(name: str) -> tuple[Spectrum, Spectrum]:
    """Return real and imaginary part of the refractive index n + i k of a metal (401,), by its name in `METALS`."""
    index = METALS[name].index(WAVELENGTHS_NM)
    return index.real, index.imag
