"""Refractive index of the scene's solids against wavelength."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.cameras.dispersion import fewest_terms, fit_nodes
from rptcam_cl.optics.glass import held_index, known_range
from rptcam_cl.records import DISPERSION_NM, DISPERSION_SCALE, DISPERSION_SHIFT
from rptcam_cl.scene.dielectric import Dielectric

Index = Callable[[ArrayLike], NDArray[np.float64]]


def is_dispersive(material: object) -> bool:
    """Return whether a material bends wavelengths by different angles."""
    if not isinstance(material, Dielectric) or material.glass is None:
        return False
    first, *others = dielectric_index(material)([486.1327, 587.5618, 656.2725])
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
