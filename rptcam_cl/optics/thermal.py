"""How heat changes air and glass: indices by temperature and pressure, and linear expansion."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.dataclass import dataclass

Array = NDArray[np.float64]

STANDARD_C, STANDARD_HPA = 20.0, 1013.25  # of catalogues


@dataclass(frozen=True)
class Thermal:
    """What a maker says about a glass under heat.

    Attributes
    ----------
    dispersion : tuple of float, or None
        Schott's D0 [1/K], D1 [1/K^2], D2 [1/K^3], E0 [um^2/K], E1 [um^2/K^2] and lambda_TK [um].
    expansion_per_k : float or None
        Linear expansion [1/K].
    reference_c : float
        Temperature of the index in the catalogue, from which the dispersion counts [degrees Celsius].
    """

    dispersion: tuple[float, ...] | None = None
    expansion_per_k: float | None = None
    reference_c: float = STANDARD_C

    def index(self, at_reference: ArrayLike, wavelength_nm: ArrayLike, celsius: float, pressure_hpa: float) -> Array:
        """Return the index relative to air of a temperature and pressure, of that relative to air of the catalogue.

        With t from the reference temperature, the absolute index n changes by (n^2 - 1) / (2 n) times
        D0 t + D1 t^2 + D2 t^3 + (E0 t + E1 t^2) / (L^2 - L_TK^2) (Schott, TIE-19: Temperature Coefficient of the
        Refractive Index, 2016).
        """
        assert self.dispersion is not None
        d0, d1, d2, e0, e1, resonance = self.dispersion
        cold_air = air_index(wavelength_nm, self.reference_c, STANDARD_HPA)
        absolute = np.asarray(at_reference) * cold_air
        t, square = celsius - self.reference_c, (np.asarray(wavelength_nm) * cold_air / 1e3) ** 2
        terms = t * (d0 + t * (d1 + t * d2) + (e0 + t * e1) / (square - resonance * resonance))
        change = (absolute * absolute - 1.0) / (2.0 * absolute) * terms
        return np.asarray((absolute + change) / air_index(wavelength_nm, celsius, pressure_hpa))


def air_index(wavelength_nm: ArrayLike, celsius: float, pressure_hpa: float) -> Array:
    """Return the index of dry air (Kohlrausch, Praktische Physik, 1968, as in Schott's TIE-19), wavelengths in air."""
    square = (np.asarray(wavelength_nm, dtype=np.float64) / 1e3) ** 2
    at_15 = 1e-8 * (6432.8 + 2949810.0 * square / (146.0 * square - 1.0) + 25540.0 * square / (41.0 * square - 1.0))
    return np.asarray(1.0 + at_15 / (1.0 + 3.4785e-3 * (celsius - 15.0)) * (pressure_hpa / STANDARD_HPA))
