"""How sensors respond to light: published curves of cameras, and the electrons that light on the film sets free.

An amount of film irradiance is as in a scene: 1 in every channel is white light D65 of 683 lx.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour.illuminants import daylight_65
from rptcam_cl.colour.spectrum import WAVELENGTHS_NM, on_grid, rgb_basis
from rptcam_cl.core.constants import LIGHT_SPEED, PLANCK
from rptcam_cl.core.resources import response_curves_dir

Array = NDArray[np.float64]

RESPONSES = ("nikon_d5100", "canon_eos_5d_mark_ii", "sigma_sd_merrill")

# Wavelengths that stand for the channels where no curves are given [nm]: near sRGB's primaries, and near
# those at which data sheets give the efficiencies of colour sensors.
CHANNEL_NM = np.array([610.0, 545.0, 465.0])


@cache
def response(name: str) -> Array:
    """Return the curves of a camera, electrons per joule up to a factor (401, 3), highest value 1; read-only.

    Parameters
    ----------
    name : str
        One of `RESPONSES`; its file under ``curves/`` names the source.
    """
    text = (response_curves_dir() / f"{name}.csv").read_text("utf-8")
    rows = np.array([line.split(",") for line in text.splitlines() if line[0].isdigit()], np.float64)
    curves = np.stack([on_grid(rows[:, 0], column, beyond=0.0) for column in rows[:, 1:].T], axis=1)
    curves /= curves.max()
    curves.setflags(write=False)
    return curves


@cache
def response_curves(name: str) -> Array:
    """Return the weights (401, 3) with which a camera makes linear sRGB of the spectrum of a light; read-only.

    They are its curves after white balance and colour matrix, so that D65 of luminance 1 gives (1, 1, 1) and light of
    any RGB colour that colour. Other spectra become what that camera takes them for.
    """
    curves = response(name)
    seen = (rgb_basis() * daylight_65()[:, None]).T @ curves
    weights = np.asarray(curves @ np.linalg.inv(seen))
    weights.setflags(write=False)
    return weights


def photons_per_joule(wavelengths_nm: Array) -> Array:
    """Return the number of photons in a joule of light of given wavelengths [nm]."""
    return np.asarray(wavelengths_nm * 1e-9 / (PLANCK * LIGHT_SPEED))


def electrons_per_joule(name: str | None, quantum_efficiency: tuple[float, float, float]) -> Array:
    """Return the electrons [1/J] in each channel of a sensor for light in each channel of the film, (film, sensor).

    With curves, light of a colour is the basis of reflectances of that colour under D65, and every curve sees it;
    without, each channel of the film is light of one of `CHANNEL_NM`, and its own channel of the sensor sees it.

    Parameters
    ----------
    name : str, optional
        One of `RESPONSES`.
    quantum_efficiency : (3,) floats
        Electrons per photon in red, green and blue, with curves where each of these is highest.
    """
    if name is None:
        return np.diag(photons_per_joule(CHANNEL_NM) * quantum_efficiency)
    efficiency = response(name) / photons_per_joule(WAVELENGTHS_NM)[:, None]
    electrons = response(name) * quantum_efficiency / efficiency.max(axis=0)
    return np.asarray((rgb_basis() * daylight_65()[:, None]).T @ electrons)
