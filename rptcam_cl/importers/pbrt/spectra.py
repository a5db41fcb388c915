"""Spectra and colours of other spaces as linear sRGB (ITU-R BT.709 primaries, white D65)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.colour import WAVELENGTHS_NM, blackbody, cie_1931, planck_radiance

Array = NDArray[np.float64]

D65 = (0.3127, 0.3290)
ACES_WHITE = (0.32168, 0.33767)
# Primaries and white as CIE x, y: BT.709, BT.2020, SMPTE RP 431-2 with D65 as pbrt has it, SMPTE ST 2065-1.
_PRIMARIES = {
    "srgb": ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), D65),
    "rec2020": ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), D65),
    "dci-p3": ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), D65),
    "aces2065-1": ((0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.077), ACES_WHITE),
}


def xyz_of(xy: ArrayLike) -> Array:
    """Return X, Y = 1, Z of a chromaticity."""
    x, y = np.asarray(xy, np.float64)
    return np.array([x / y, 1.0, (1 - x - y) / y])


def _xyz_from_rgb(space: str) -> Array:
    *primaries, white = _PRIMARIES[space]
    columns = np.stack([xyz_of(xy) if xy[1] else np.array([1.0, 0.0, 0.0]) for xy in primaries], axis=1)
    return np.asarray(columns * np.linalg.solve(columns, xyz_of(white)))


XYZ_FROM_SRGB = _xyz_from_rgb("srgb")
SRGB_FROM_XYZ = np.linalg.inv(XYZ_FROM_SRGB)


def srgb_from(space: str, rgb: ArrayLike) -> Array:
    """Return linear sRGB of the colour (…, 3) of a space; white stays white, as in the space's own light."""
    values = np.asarray(rgb, np.float64)
    if space == "srgb":
        return values
    matrix = SRGB_FROM_XYZ @ _xyz_from_rgb(space)
    # scaled per channel so that (1, 1, 1) stays so, also where the whites differ
    return np.asarray(values @ (matrix / (matrix @ np.ones(3))[:, None]).T)


def srgb_of_white(xy: ArrayLike) -> Array:
    """Return linear sRGB of a light of some chromaticity and of luminance 1."""
    return np.asarray(SRGB_FROM_XYZ @ xyz_of(xy))


WIEN = 2.897771955e6  # temperature times the wavelength where a black body is brightest [nm K], CODATA 2018
LUMINOUS = float(cie_1931()[:, 1].sum())

# Chromaticities x, y of standard illuminants, 2 degrees (CIE 15:2004, table T.3 and T.5); ACES: SMPTE ST 2065-1.
ILLUMINANTS = {
    "stdillum-A": (0.44758, 0.40745), "stdillum-D50": (0.34567, 0.35851), "stdillum-D65": D65,
    "stdillum-F1": (0.3131, 0.3371), "stdillum-F2": (0.3721, 0.3751), "stdillum-F3": (0.4091, 0.3941),
    "stdillum-F4": (0.4402, 0.4031), "stdillum-F5": (0.3138, 0.3452), "stdillum-F6": (0.3779, 0.3882),
    "stdillum-F7": (0.3129, 0.3292), "stdillum-F8": (0.3458, 0.3586), "stdillum-F9": (0.3741, 0.3727),
    "stdillum-F10": (0.3458, 0.3588), "stdillum-F11": (0.3805, 0.3769), "stdillum-F12": (0.4370, 0.4042),
    "illum-acesD60": ACES_WHITE,
}  # fmt: skip


def xyz_of_samples(wavelengths_nm: ArrayLike, values: ArrayLike) -> Array:
    """Return X, Y, Z of a spectrum, linear between its samples; one that is 1 everywhere has Y = 1.

    Beyond its first and last sample a spectrum keeps their values.
    """
    order = np.argsort(np.asarray(wavelengths_nm, np.float64), kind="stable")
    samples = np.interp(WAVELENGTHS_NM, np.asarray(wavelengths_nm)[order], np.asarray(values)[order])
    return np.asarray(samples @ cie_1931() / LUMINOUS)


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
    """Return a black body's radiance at `WAVELENGTHS_NM`, 1 at its peak (Wien's law), wherever that lies."""
    return np.asarray(blackbody(kelvin) / planck_radiance(WIEN / kelvin, kelvin))


def black_body_srgb(kelvin: float, *, luminance: float | None) -> Array:
    """Return linear sRGB of a black body of a temperature [K]: of a luminance, or with its spectrum's peak at 1."""
    return light_srgb(WAVELENGTHS_NM, planck(kelvin), luminance=luminance)


def illuminant_srgb(name: str) -> Array:
    """Return linear sRGB of a standard illuminant of luminance 1."""
    return srgb_of_white(ILLUMINANTS[name])
