"""Exposure, ISO speed and system gain of a sensor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LUMENS_PER_WATT = 683.0

# ISO 12232, saturation-based speed: S = 78 / H, where H [lx s] is the exposure that just saturates.
SATURATION_LUX_SECONDS = 78.0


def white_electrons_at_iso(electrons_per_joule: NDArray[np.float64], pixel_area_m2: float, iso: float) -> float:
    """Return the electrons that white light of the saturating exposure of an ISO speed gives the fullest channel.

    Parameters
    ----------
    electrons_per_joule : (film, sensor) array
        Electrons [1/J] in each channel of the sensor for light in each channel of the film.
    pixel_area_m2 : float
        Area on which a pixel gathers light [m²].
    iso : float
    """
    joules_per_m2 = SATURATION_LUX_SECONDS / iso / LUMENS_PER_WATT
    return float(electrons_per_joule.sum(axis=0).max() * pixel_area_m2 * joules_per_m2)


def system_gain(top_dn: float, black_level_dn: float, saturation_e: float) -> float:
    """Return the gain [DN/electron] with which a number of electrons just reaches the converter's highest number."""
    return (top_dn - black_level_dn) / saturation_e
