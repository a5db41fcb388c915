"""Media between the surfaces: refractive index against wavelength, each law with its valid range.

Wavelengths are in nanometres in air, indices relative to air. Dispersion formulas take the wavelength in micrometres.
"""

from __future__ import annotations

from dataclasses import field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.colour import LINE_C_NM, LINE_D_NM, LINE_F_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.absorption import Absorption
from rptcam_cl.optics.thermal import Thermal

Array = NDArray[np.float64]
Range = tuple[float, float]

NO_DISPERSION = 1e6  # V_d by which files say that an index is the same at every wavelength
VISIBLE_NM = (400.0, 700.0)  # within which laws that end are continued
MARGIN_NM = 50.0  # by at most so much
FIT_POINTS = 8  # of a table, from its end, by which it is continued


class Medium(Protocol):
    """What fills the space after a surface."""

    @property
    def name(self) -> str:
        """Short text for tables and messages."""

    @property
    def absorption(self) -> Absorption | None:
        """What it swallows; None when that is not known."""

    def index(self, wavelength_nm: ArrayLike) -> Array:
        """Return the refractive index, of the shape of the wavelengths [nm]."""


@dataclass(frozen=True, kw_only=True)
class Absorbing:
    """A medium whose absorption, and what heat does to it, may be known."""

    absorption: Absorption | None = field(default=None, repr=False)
    thermal: Thermal | None = field(default=None, repr=False)


@dataclass(frozen=True)
class ConstantIndex(Absorbing):
    """The same index at every wavelength."""

    value: float
    name: str = ""

    def index(self, wavelength_nm: ArrayLike) -> Array:
        """Return the index at each wavelength [nm]."""
        return np.full(np.shape(wavelength_nm), self.value)


AIR = ConstantIndex(1.0, "air")


@dataclass(frozen=True)
class AbbeCauchy(Absorbing):
    """Two-term Cauchy law n = A + B / L^2 through n_d and V_d = (n_d - 1) / (n_F - n_C), close to real glass."""

    nd: float
    vd: float
    name: str = ""

    def index(self, wavelength_nm: ArrayLike) -> Array:
        """Return the index at each wavelength [nm]."""
        squares = (1e3 / np.array([LINE_F_NM, LINE_C_NM, LINE_D_NM])) ** 2
        b = (self.nd - 1) / self.vd / (squares[0] - squares[1])
        a = self.nd - b * squares[2]
        return np.asarray(a + b * _inverse_square(wavelength_nm), dtype=np.float64)


@dataclass(frozen=True)
class AbbeLinear(Absorbing):
    """Index linear in wavelength: n = n_D + (n_D - 1) / V * (589.3 - L) / (656.3 - 486.1).

    The dispersion of the rptcam paper (Kumar, Kumar, Meng, Yu 2024, eq. 2), kept for its figures; not that of glass.
    """

    n: float
    v: float
    name: str = ""

    def index(self, wavelength_nm: ArrayLike) -> Array:
        """Return the index at each wavelength [nm]."""
        wavelength = np.asarray(wavelength_nm, dtype=np.float64)
        return np.asarray(self.n + (self.n - 1) / self.v * (589.3 - wavelength) / (656.3 - 486.1), dtype=np.float64)


@dataclass(frozen=True)
class Sellmeier(Absorbing):
    """n^2 = 1 + c0 + sum of b L^2 / (L^2 - c), L in micrometres and c in square micrometres."""

    b: tuple[float, ...]
    c: tuple[float, ...]
    c0: float = 0.0
    range_nm: Range | None = None
    name: str = ""

    def index(self, wavelength_nm: ArrayLike) -> Array:
        """Return the index at each wavelength [nm]."""
        square = (_in_range(wavelength_nm, self.range_nm, self.name) / 1e3) ** 2
        total = 1.0 + self.c0 + sum(b * square / (square - c) for b, c in zip(self.b, self.c, strict=True))
        return _root(total, self.name)


@dataclass(frozen=True)
class PowerSeries(Absorbing):
    """n or n^2 as a sum of coefficient * L^power, L in micrometres: Cauchy, Schott and similar polynomials."""

    terms: tuple[tuple[float, float], ...]
    squared: bool
    range_nm: Range | None = None
    name: str = ""

    def index(self, wavelength_nm: ArrayLike) -> Array:
        """Return the index at each wavelength [nm]."""
        length = _in_range(wavelength_nm, self.range_nm, self.name) / 1e3
        total = np.zeros_like(length)
        for power, coefficient in self.terms:
            total = total + coefficient * length**power
        return _root(total, self.name) if self.squared else total


@dataclass(frozen=True)
class TabulatedIndex(Absorbing):
    """Index interpolated linearly between measured wavelengths [nm], which rise.

    Beyond them it goes on as A + B / L^2 + C / L^4 through the nearest ones, shifted to meet the last.
    """

    wavelengths_nm: tuple[float, ...]
    values: tuple[float, ...]
    name: str = ""

    def index(self, wavelength_nm: ArrayLike) -> Array:
        """Return the index at each wavelength [nm]."""
        limits = (self.wavelengths_nm[0], self.wavelengths_nm[-1])
        wavelength = _in_range(wavelength_nm, limits, self.name)
        found = np.asarray(np.interp(wavelength, self.wavelengths_nm, self.values), dtype=np.float64)
        for end, outside in ((0, wavelength < limits[0]), (-1, wavelength > limits[1])):
            if np.any(outside):
                places = slice(None, FIT_POINTS) if end == 0 else slice(-FIT_POINTS, None)
                known, values = self.wavelengths_nm[places], self.values[places]
                curve = np.polynomial.Polynomial.fit(_inverse_square(known), values, min(2, len(known) - 1))
                beyond = self.values[end] + curve(_inverse_square(wavelength)) - curve(_inverse_square(limits[end]))
                found = np.where(outside, beyond, found)
        return found


@dataclass(frozen=True)
class Melt(Absorbing):
    """A glass as one melt has it.

    Attributes
    ----------
    glass : Law
        What was ordered.
    shift : float
        By which the index is higher, at every wavelength.
    share : float
        By which share the Abbe number is higher: differences of the index are divided by 1 + share.
    """

    glass: Law
    shift: float = 0.0
    share: float = 0.0
    name: str = ""

    @classmethod
    def of(cls, glass: Law, shift: float, share: float) -> Melt:
        """Return a melt of a glass, which absorbs and is called as it is."""
        return cls(glass, shift, share, glass.name, absorption=glass.absorption)

    def index(self, wavelength_nm: ArrayLike) -> Array:
        """Return the index at each wavelength [nm]."""
        found = self.glass.index(wavelength_nm) + self.shift
        if self.share == 0:
            return found
        off_d = self.glass.index(wavelength_nm) - self.glass.index(LINE_D_NM)
        return np.asarray(found + off_d * (1.0 / (1.0 + self.share) - 1.0))


@dataclass(frozen=True)
class Heated(Absorbing):
    """A glass at another temperature, relative to the air around it.

    Attributes
    ----------
    glass : Law
        As its catalogue has it.
    by : Thermal
        What the catalogue says of heat.
    celsius, pressure_hpa : float
        Of glass and air.
    """

    glass: Law
    by: Thermal
    celsius: float
    pressure_hpa: float
    name: str = ""

    @classmethod
    def of(cls, glass: Law, by: Thermal, celsius: float, pressure_hpa: float) -> Heated:
        """Return a glass under heat, which absorbs and is called as it is."""
        return cls(glass, by, celsius, pressure_hpa, glass.name, absorption=glass.absorption)

    def index(self, wavelength_nm: ArrayLike) -> Array:
        """Return the index at each wavelength [nm]."""
        return self.by.index(self.glass.index(wavelength_nm), wavelength_nm, self.celsius, self.pressure_hpa)


Law = ConstantIndex | AbbeCauchy | AbbeLinear | Sellmeier | PowerSeries | TabulatedIndex | Melt | Heated


def held_index(medium: Law, wavelength_nm: ArrayLike) -> Array:
    """Return the index at each wavelength [nm]; beyond those at which it is known, that of the nearest of them."""
    wavelength = np.asarray(wavelength_nm, dtype=np.float64)
    limits = known_range(medium)
    return medium.index(wavelength if limits is None else np.clip(wavelength, *limits))


def stated_range(medium: Medium) -> Range | None:
    """Return the shortest and longest wavelength that are stated for a law [nm], None where it holds everywhere."""
    match medium:
        case Sellmeier() | PowerSeries():
            return medium.range_nm
        case TabulatedIndex():
            return medium.wavelengths_nm[0], medium.wavelengths_nm[-1]
        case Melt() | Heated():
            return stated_range(medium.glass)
    return None


def known_range(medium: Medium) -> Range | None:
    """Return the shortest and longest wavelength at which an index is given [nm], None where it is everywhere.

    A law that ends inside of `VISIBLE_NM` is continued towards its end, by `MARGIN_NM` at most.
    """
    stated = stated_range(medium)
    return None if stated is None else _continued(stated)


def continued_words(medium: Medium) -> str | None:
    """Return what to say of a medium whose law is continued within `VISIBLE_NM`; None of others."""
    stated, known = stated_range(medium), known_range(medium)
    if stated is None or stated == known or known is None:
        return None
    ends = " and ".join(f"{nm:g} nm" for nm, end in zip(known, stated, strict=True) if nm != end)
    span = f"{stated[0]:g} to {stated[1]:g} nm"
    return f"glass {medium.name or '(unnamed)'} is known from {span}; its law is continued to {ends}"


def _continued(stated: Range) -> Range:
    (low, high), (blue, red) = stated, VISIBLE_NM
    if blue < low <= red:
        low = max(blue, low - MARGIN_NM)
    if blue <= high < red:
        high = min(red, high + MARGIN_NM)
    return low, high


def abbe_number(medium: Medium) -> float:
    """Return V_d = (n_d - 1) / (n_F - n_C), infinite without dispersion."""
    d, f, c = medium.index([LINE_D_NM, LINE_F_NM, LINE_C_NM])
    return float((d - 1) / (f - c)) if f != c else float("inf")


def attenuation(medium: Medium, wavelength_nm: ArrayLike) -> Array:
    """Return the absorption coefficient of a medium [1/mm] at each wavelength [nm]; 0 where it is not known."""
    if medium.absorption is None:
        return np.zeros(np.shape(wavelength_nm))
    return medium.absorption.at(wavelength_nm, medium.name)


def _inverse_square(wavelength_nm: ArrayLike) -> Array:
    return (1e3 / np.asarray(wavelength_nm, dtype=np.float64)) ** 2


def _in_range(wavelength_nm: ArrayLike, limits: Range | None, name: str) -> Array:
    wavelength = np.asarray(wavelength_nm, dtype=np.float64)
    limits = None if limits is None else _continued(limits)
    if limits is not None and (np.any(wavelength < limits[0]) or np.any(wavelength > limits[1])):
        bad = float(np.extract((wavelength < limits[0]) | (wavelength > limits[1]), wavelength)[0])
        raise InputError(
            f"glass {name or '(unnamed)'} is known from {limits[0]:g} to {limits[1]:g} nm (requested {bad:g} nm)"
        )
    return wavelength


def _root(square: ArrayLike, name: str) -> Array:
    value = np.asarray(square, dtype=np.float64)
    if not np.all(value > 0):
        raise InputError(f"glass {name or '(unnamed)'} has no real index at a requested wavelength")
    return np.sqrt(value)
