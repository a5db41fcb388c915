"""Spectra of lights: standard illuminants, daylight of any temperature, black bodies."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from rptcam_cl.colour.spectrum import WAVELENGTHS_NM, Spectrum, cie_1931, columns, table
from rptcam_cl.core.constants import BOLTZMANN, LIGHT_SPEED, PLANCK
from rptcam_cl.core.errors import InputError

COOLEST_DAYLIGHT, HOTTEST_DAYLIGHT = 4000.0, 25000.0  # [K], CIE 15

ILLUMINANTS = ("A", "D50", "D55", "D65", "D75", "E", "F2", "F7", "F11", "LED-B1", "LED-B2", "LED-B3", "LED-B4",
               "LED-B5")  # fmt: skip


def illuminant(name: str) -> Spectrum:
    """Return a CIE illuminant of luminance 1 (401,) [1/nm].

    Raises
    ------
    InputError
        When no illuminant has this name.
    """
    if name == "A":
        # CIE 15: a temperature of 2848 K with the constant of 1931, 14350 um K, stands for 2856 K.
        return _of_luminance_1(WAVELENGTHS_NM**-5 / np.expm1(1.435e7 / (2848 * WAVELENGTHS_NM)))
    if name == "E":
        return _of_luminance_1(np.ones_like(WAVELENGTHS_NM))
    if name not in ILLUMINANTS:
        raise InputError(f"is not a known illuminant (got {name!r}; allowed: {', '.join(ILLUMINANTS)})")
    return _of_luminance_1(columns("illuminants")[name])


@cache
def daylight_65() -> Spectrum:
    """Return illuminant D65 of luminance 1 (401,) [1/nm]."""
    return illuminant("D65")


def daylight(kelvin: float) -> Spectrum:
    """Return daylight of a correlated colour temperature [K], of luminance 1 (401,) [1/nm]; CIE 15:2018, 4.1.2.

    The temperature is that of today's scale: D65 is `daylight(6504)`.

    Raises
    ------
    InputError
        When the temperature is outside 4000 to 25000 K.
    """
    if not COOLEST_DAYLIGHT <= kelvin <= HOTTEST_DAYLIGHT:
        raise InputError(
            f"is no temperature of daylight (got {kelvin:g}; allowed: {COOLEST_DAYLIGHT:g} to {HOTTEST_DAYLIGHT:g} K)"
        )
    if kelvin <= 7000:
        x = -4.6070e9 / kelvin**3 + 2.9678e6 / kelvin**2 + 0.09911e3 / kelvin + 0.244063
    else:
        x = -2.0064e9 / kelvin**3 + 1.9018e6 / kelvin**2 + 0.24748e3 / kelvin + 0.237040
    y = -3.000 * x**2 + 2.870 * x - 0.275
    scale = 0.0241 + 0.2562 * x - 0.7341 * y
    weights = (1.0, (-1.3515 - 1.7703 * x + 5.9114 * y) / scale, (0.0300 - 31.4424 * x + 30.0717 * y) / scale)
    return _of_luminance_1(np.maximum(table("daylight") @ np.array(weights), 0.0))


def blackbody(kelvin: float) -> Spectrum:
    """Return the radiance of a black body of a temperature [K] (401,) [W/(m² sr nm)]."""
    return planck_radiance(WAVELENGTHS_NM, kelvin)


def planck_radiance(wavelength_nm: ArrayLike, kelvin: float) -> Spectrum:
    """Return the radiance of a black body of a temperature [K] in vacuum [W/(m² sr nm)], by Planck's law."""
    metres = np.asarray(wavelength_nm, np.float64) * 1e-9
    # Beyond the exponent 700 the radiance is below 1e-290 of anything visible; larger ones overflow.
    exponent = np.minimum(PLANCK * LIGHT_SPEED / (BOLTZMANN * kelvin * metres), 700.0)
    return np.asarray(2 * PLANCK * LIGHT_SPEED**2 / metres**5 / np.expm1(exponent) * 1e-9)


def _of_luminance_1(spectrum: Spectrum) -> Spectrum:
    return np.asarray(spectrum / (cie_1931()[:, 1] @ spectrum))
