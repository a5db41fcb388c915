"""How much light a medium swallows on the way: its absorption coefficient against wavelength."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError

Array = NDArray[np.float64]

OPAQUE = 1e-6  # an internal transmittance that a catalogue rounds to 0 counts as this


@dataclass(frozen=True)
class Absorption:
    """The coefficient a of Beer's law: the share exp(-a d) of the light comes through a thickness d.

    Attributes
    ----------
    wavelengths_nm : tuple of float
        Where it was measured, rising.
    per_mm : tuple of float
        a [1/mm]; straight lines join the values.
    """

    wavelengths_nm: tuple[float, ...]
    per_mm: tuple[float, ...]

    @classmethod
    def from_transmittance(
        cls, wavelengths_nm: Sequence[float], transmittances: Sequence[float], thickness_mm: ArrayLike
    ) -> Absorption:
        """Return the absorption that gives internal transmittances (surfaces left out) over a thickness [mm]."""
        inside = np.maximum(np.asarray(transmittances, dtype=np.float64), OPAQUE)
        per_mm = np.maximum(-np.log(inside), 0.0) / np.asarray(thickness_mm, dtype=np.float64)
        return cls(tuple(float(w) for w in wavelengths_nm), tuple(per_mm.tolist()))

    def at(self, wavelength_nm: ArrayLike, name: str = "") -> Array:
        """Return the coefficient [1/mm] at each wavelength [nm]; `name` is that of the medium, for messages."""
        return interpolated(wavelength_nm, self.wavelengths_nm, self.per_mm, f"absorption of {name or 'a glass'}")


def interpolated(
    wavelength_nm: ArrayLike, wavelengths_nm: tuple[float, ...], values: tuple[float, ...], what: str
) -> Array:
    """Return tabulated values at wavelengths [nm], by straight lines; a single value holds at every wavelength."""
    wavelength = np.asarray(wavelength_nm, dtype=np.float64)
    low, high = wavelengths_nm[0], wavelengths_nm[-1]
    outside = (wavelength < low) | (wavelength > high)
    if len(wavelengths_nm) > 1 and np.any(outside):
        bad = float(np.extract(outside, wavelength)[0])
        raise InputError(f"the {what} is known from {low:g} to {high:g} nm (requested {bad:g} nm)")
    return np.asarray(np.interp(wavelength, wavelengths_nm, values), dtype=np.float64)
