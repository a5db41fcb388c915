"""Spectra as linear sRGB: the eye's matching functions, black bodies, standard illuminants."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.pbrt.colour_spaces import ACES_WHITE, D65, SRGB_FROM_XYZ, srgb_of_white

Array = NDArray[np.float64]

WAVELENGTHS_NM = np.arange(360.0, 831.0)

# Lobes (height, centre [nm], width below and above it [nm]) of the fit to the CIE 1931 matching functions by
# Wyman, Sloan and Shirley, "Simple analytic approximations to the CIE XYZ color matching functions", JCGT 2 (2), 2013.
_LOBES = (
    ((1.056, 599.8, 37.9, 31.0), (0.362, 442.0, 16.0, 26.7), (-0.065, 501.1, 20.4, 26.2)),
    ((0.821, 568.8, 46.9, 40.5), (0.286, 530.9, 16.3, 31.1)),
    ((1.217, 437.0, 11.8, 36.0), (0.681, 459.0, 26.0, 13.8)),
)

# Second radiation constant h c / k [nm K].
_C2 = 1.438776877e7

# Chromaticities x, y of standard illuminants, 2 degrees (CIE 15:2004, table T.3 and T.5); ACES: SMPTE ST 2065-1.
ILLUMINANTS = {
    "stdillum-A": (0.44758, 0.40745), "stdillum-D50": (0.34567, 0.35851), "stdillum-D65": D65,
    "stdillum-F1": (0.3131, 0.3371), "stdillum-F2": (0.3721, 0.3751), "stdillum-F3": (0.4091, 0.3941),
    "stdillum-F4": (0.4402, 0.4031), "stdillum-F5": (0.3138, 0.3452), "stdillum-F6": (0.3779, 0.3882),
    "stdillum-F7": (0.3129, 0.3292), "stdillum-F8": (0.3458, 0.3586), "stdillum-F9": (0.3741, 0.3727),
    "stdillum-F10": (0.3458, 0.3588), "stdillum-F11": (0.3805, 0.3769), "stdillum-F12": (0.4370, 0.4042),
    "illum-acesD60": ACES_WHITE,
}  # fmt: skip


def _matching_functions() -> Array:
    rows = []
    for lobes in _LOBES:
        total = np.zeros_like(WAVELENGTHS_NM)
        for height, centre, below, above in lobes:
            width = np.where(centre > WAVELENGTHS_NM, below, above)
            total += height * np.exp(-0.5 * ((WAVELENGTHS_NM - centre) / width) ** 2)
        rows.append(total)
    return np.stack(rows)


MATCHING = _matching_functions()
LUMINOUS = float(MATCHING[1].sum())


def xyz_of_samples(wavelengths_nm: ArrayLike, values: ArrayLike) -> Array:
    """Return X, Y, Z of a spectrum, linear between its samples; one that is 1 everywhere has Y = 1.

    Beyond its first and last sample a spectrum keeps their values.
    """
    order = np.argsort(np.asarray(wavelengths_nm, np.float64), kind="stable")
    samples = np.interp(WAVELENGTHS_NM, np.asarray(wavelengths_nm)[order], np.asarray(values)[order])
    return np.asarray(MATCHING @ samples / LUMINOUS)


def reflectance_srgb(wavelengths_nm: ArrayLike, values: ArrayLike) -> Array:
    """Return linear sRGB of a reflectance spectrum; one that reflects everything is (1, 1, 1)."""
    white = SRGB_FROM_XYZ @ xyz_of_samples([500.0], [1.0])
    return np.asarray(SRGB_FROM_XYZ @ xyz_of_samples(wavelengths_nm, values) / white)


def light_srgb(wavelengths_nm: ArrayLike, values: ArrayLike, *, luminance: float | None = None) -> Array:
    """Return linear sRGB of a light's spectrum, scaled to a luminance if one is given."""
    xyz = xyz_of_samples(wavelengths_nm, values)
    if luminance is not None:
        xyz = xyz * (luminance / xyz[1]) if xyz[1] > 0 else np.zeros(3)
    return np.asarray(SRGB_FROM_XYZ @ xyz)


def planck(kelvin: float) -> Array:
    """Return a black body's radiance at `WAVELENGTHS_NM`, 1 at the peak that Wien's law gives."""

    def radiance(wavelength_nm: Array) -> Array:
        return wavelength_nm**-5.0 / np.expm1(np.minimum(_C2 / (wavelength_nm * kelvin), 700.0))

    peak = np.array([2.897771955e6 / kelvin])
    return np.asarray(radiance(WAVELENGTHS_NM) / radiance(peak))


def black_body_srgb(kelvin: float, *, luminance: float | None) -> Array:
    """Return linear sRGB of a black body of a temperature [K]: of a luminance, or with its spectrum's peak at 1."""
    return light_srgb(WAVELENGTHS_NM, planck(kelvin), luminance=luminance)


def illuminant_srgb(name: str) -> Array:
    """Return linear sRGB of a standard illuminant of luminance 1."""
    return srgb_of_white(ILLUMINANTS[name])
