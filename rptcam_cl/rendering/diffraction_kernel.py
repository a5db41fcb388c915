"""What an opening makes of a point of light, pixel by pixel: the kernel of its diffraction.

The light of a wavelength at a film point x is |integral of exp(2 pi i (l x + m y) / wavelength) dl dm|^2 over the open
directions (Fraunhofer). Red, green and blue have each the mean over the wavelengths that make them in white light. A
kernel has no negative values and the sum 1, so that it neither rings nor adds light.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import FilmPupil
from rptcam_cl.colour import WAVELENGTHS_NM, cie_1931, daylight_65, rgb_basis

Array = NDArray[np.float64]

REACH = 64.0  # half width of a kernel, in wavelength over twice the numerical aperture: 99.7 % of an Airy pattern
LEAST_REACH, MOST_REACH = 2, 256  # the same in pixels
KNOWN = 1.5 * REACH  # from where the light is left out: an opening of 144 cells shows its image again 141 away
TAPER = 0.75  # share of the reach from which the kernel fades, so that no square shows about a bright lamp
FINE = 2.5  # points per wavelength over twice the numerical aperture; 2 resolve the light exactly
SHARP, SMOOTH = 1.4, 2.0  # the same in pixels: below the first a pixel averages the light, above the second it samples
WAVES_NM = np.arange(410.0, 700.0, 20.0)
MIDDLE_NM = 550.0


@cache
def shares_of_white(waves_nm: tuple[float, ...]) -> Array:
    """Return the share of each of some wavelengths, evenly spaced [nm], in red, green and blue of daylight, (n, 3)."""
    light = rgb_basis() * (cie_1931().sum(axis=1) * daylight_65())[:, None]
    bands = np.rint((WAVELENGTHS_NM - waves_nm[0]) / (waves_nm[1] - waves_nm[0])).astype(int)
    shares = np.zeros((len(waves_nm), 3))
    np.add.at(shares, np.clip(bands, 0, len(waves_nm) - 1), light)
    return np.asarray(shares / shares.sum(axis=0))


def white_shares() -> Array:
    """Return the share of each of `WAVES_NM` in red, green and blue of daylight, shape (wavelengths, 3)."""
    return shares_of_white(tuple(WAVES_NM.tolist()))


def unit_px(pupil: FilmPupil, pixel_mm: tuple[float, float], nm: float = MIDDLE_NM) -> float:
    """Return wavelength over twice the numerical aperture, which is wavelength times f-number [pixels]."""
    length = nm * 1e-6 / pupil.index
    return float(length / (2 * pupil.aperture) / np.sqrt(pixel_mm[0] * pixel_mm[1]))


def reach_px(unit: float, largest: int) -> int:
    """Return half the width of a kernel [pixels], at most that of the film."""
    return int(min(max(np.ceil(REACH * unit), LEAST_REACH), MOST_REACH, largest))


def fade(radius_px: Array, reach: int) -> Array:
    """Return the share of the light at radii that a kernel keeps; the rest of it is far light."""
    radius = radius_px / (reach + 1)
    return np.asarray(np.cos(np.pi / 2 * np.clip((radius - TAPER) / (1 - TAPER), 0.0, 1.0)) ** 2)


def kernel(pupil: FilmPupil, pixel_mm: tuple[float, float], reach: int) -> Array:
    """Return the kernels of red, green and blue, shape (3, 2 reach + 1, 2 reach + 1), rows by y and columns by x.

    Parameters
    ----------
    pupil : FilmPupil
    pixel_mm : tuple of float
        Width and height of a pixel.
    reach : int
        Pixels on each side of the middle one.
    """
    total = np.zeros((3, 2 * reach + 1, 2 * reach + 1))
    for nm, shares in zip(WAVES_NM, white_shares(), strict=True):
        total += shares[:, None, None] * of_wavelength(pupil, pixel_mm, reach, nm)
    away = np.arange(-reach, reach + 1)
    total *= fade(np.hypot(away[:, None], away[None, :]), reach)
    return np.asarray(total / total.sum(axis=(1, 2), keepdims=True))


def of_wavelength(pupil: FilmPupil, pixel_mm: tuple[float, float], reach: int, nm: float) -> Array:
    """Return the light of a wavelength in each pixel, its sum 1."""
    unit, size = unit_px(pupil, pixel_mm, nm), 2 * reach + 1
    if KNOWN * unit < 0.5:  # all of it in the middle one
        return np.pad(np.ones((1, 1)), reach)
    width = float(np.sqrt(np.clip((SMOOTH - unit) / (SMOOTH - SHARP), 0.0, 1.0)))  # of the square that is averaged
    finer = max(int(np.ceil(FINE / unit * width)), 1)
    within = ((np.arange(finer) + 0.5) / finer - 0.5) * width
    places = (np.arange(-reach, reach + 1)[:, None] + within).ravel()
    known = np.abs(places) <= KNOWN * unit
    turn = 2j * np.pi * pupil.index / (nm * 1e-6)
    columns = np.exp(turn * pixel_mm[0] * np.outer(pupil.cosines_x - pupil.cosines_x.mean(), places[known]))
    rows = np.exp(turn * pixel_mm[1] * np.outer(places[known], pupil.cosines_y - pupil.cosines_y.mean()))
    light = np.zeros((len(places), len(places)))
    light[np.ix_(known, known)] = np.abs(rows @ pupil.coverage @ columns) ** 2
    binned = light.reshape(size, finer, size, finer).sum(axis=(1, 3))
    return np.asarray(binned / binned.sum())
