"""Media between surfaces: index against wavelength, absorption, heat, and the glasses that files may name.

Then the interfaces between them: the light that bare and coated ones let through.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import field
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core import LINE_C_NM, LINE_D_NM, LINE_F_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError

# How heat changes air and glass: indices by temperature and pressure, and linear expansion.

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


# How much light a medium swallows on the way: its absorption coefficient against wavelength.

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

    @classmethod
    def from_extinction(cls, wavelengths_um: Array, extinctions: Array) -> Absorption:
        """Return the absorption 4 pi k / L of extinction coefficients k at wavelengths L [um]."""
        per_mm = 4e3 * np.pi * extinctions / wavelengths_um
        return cls(tuple((1e3 * wavelengths_um).tolist()), tuple(per_mm.tolist()))

    def at(self, wavelength_nm: ArrayLike, name: str = "") -> Array:
        """Return the coefficient [1/mm] at each wavelength [nm]; `name` is that of the medium, for messages."""
        return interpolate(wavelength_nm, self.wavelengths_nm, self.per_mm, f"absorption of {name or 'a glass'}")


def interpolate(
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


#
# Media between the surfaces: refractive index against wavelength, each law with its valid range.
#
# Wavelengths are in nanometres in air, indices relative to air. Dispersion formulas take the wavelength in
# micrometres.

Range = tuple[float, float]

NO_DISPERSION = 1e6  # V_d by which files say that an index is the same at every wavelength
_VISIBLE_NM = (400.0, 700.0)  # within which laws that end are continued
_MARGIN_NM = 50.0  # by at most so much
_FIT_POINTS = 8  # of a table, from its end, by which it is continued


@dataclass(frozen=True, kw_only=True)
class Medium(ABC):
    """What fills the space after a surface.

    Attributes
    ----------
    absorption : Absorption or None
        What it swallows; None when that is not known.
    thermal : Thermal or None
        What heat does to it, where that is known.
    """

    absorption: Absorption | None = field(default=None, repr=False)
    thermal: Thermal | None = field(default=None, repr=False)

    @property
    @abstractmethod
    def name(self) -> str:
        """Short text for tables and messages."""

    @abstractmethod
    def index(self, wavelength_nm: ArrayLike) -> Array:
        """Return the refractive index, of the shape of the wavelengths [nm]."""


@dataclass(frozen=True)
class ConstantIndex(Medium):
    """The same index at every wavelength."""

    value: float
    name: str = ""

    def index(self, wavelength_nm: ArrayLike) -> Array:
        """Return the index at each wavelength [nm]."""
        return np.full(np.shape(wavelength_nm), self.value)


AIR = ConstantIndex(1.0, "air")


@dataclass(frozen=True)
class AbbeCauchy(Medium):
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
class AbbeLinear(Medium):
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
class Sellmeier(Medium):
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
class PowerSeries(Medium):
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
class TabulatedIndex(Medium):
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
        value = np.asarray(np.interp(wavelength, self.wavelengths_nm, self.values), dtype=np.float64)
        for end, outside in ((0, wavelength < limits[0]), (-1, wavelength > limits[1])):
            if np.any(outside) and len(self.values) > 1:
                places = slice(None, _FIT_POINTS) if end == 0 else slice(-_FIT_POINTS, None)
                known, values = self.wavelengths_nm[places], self.values[places]
                curve = np.polynomial.Polynomial.fit(_inverse_square(known), values, min(2, len(known) - 1))
                beyond = self.values[end] + curve(_inverse_square(wavelength)) - curve(_inverse_square(limits[end]))
                value = np.where(outside, beyond, value)
        return value


@dataclass(frozen=True)
class Melt(Medium):
    """A glass as one melt has it.

    Attributes
    ----------
    glass : Medium
        What was ordered.
    shift : float
        By which the index is higher, at every wavelength.
    share : float
        By which share the Abbe number is higher: differences of the index are divided by 1 + share.
    """

    glass: Medium
    shift: float = 0.0
    share: float = 0.0
    name: str = ""

    @classmethod
    def of(cls, glass: Medium, shift: float, share: float) -> Melt:
        """Return a melt of a glass, which absorbs and is called as it is."""
        return cls(glass, shift, share, glass.name, absorption=glass.absorption)

    def index(self, wavelength_nm: ArrayLike) -> Array:
        """Return the index at each wavelength [nm]."""
        value = self.glass.index(wavelength_nm) + self.shift
        if self.share == 0:
            return value
        off_d = self.glass.index(wavelength_nm) - self.glass.index(LINE_D_NM)
        return np.asarray(value + off_d * (1.0 / (1.0 + self.share) - 1.0))


@dataclass(frozen=True)
class Heated(Medium):
    """A glass at another temperature, relative to the air around it.

    Attributes
    ----------
    glass : Medium
        As its catalogue has it.
    by : Thermal
        What the catalogue says of heat.
    celsius, pressure_hpa : float
        Of glass and air.
    """

    glass: Medium
    by: Thermal
    celsius: float
    pressure_hpa: float
    name: str = ""

    @classmethod
    def of(cls, glass: Medium, by: Thermal, celsius: float, pressure_hpa: float) -> Heated:
        """Return a glass under heat, which absorbs and is called as it is."""
        return cls(glass, by, celsius, pressure_hpa, glass.name, absorption=glass.absorption)

    def index(self, wavelength_nm: ArrayLike) -> Array:
        """Return the index at each wavelength [nm]."""
        return self.by.index(self.glass.index(wavelength_nm), wavelength_nm, self.celsius, self.pressure_hpa)


def held_index(medium: Medium, wavelength_nm: ArrayLike) -> Array:
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

    A law that ends inside of `_VISIBLE_NM` is continued towards its end, by `_MARGIN_NM` at most.
    """
    stated = stated_range(medium)
    return None if stated is None else _extend_range(stated)


def continued_words(medium: Medium) -> str | None:
    """Return a warning about a medium whose law is continued within `_VISIBLE_NM`; None for others."""
    stated, known = stated_range(medium), known_range(medium)
    if stated is None or stated == known or known is None:
        return None
    ends = " and ".join(f"{nm:g} nm" for nm, end in zip(known, stated, strict=True) if nm != end)
    span = f"{stated[0]:g} to {stated[1]:g} nm"
    return f"glass {medium.name or '(unnamed)'} is known from {span}; its law is continued to {ends}"


def _extend_range(stated: Range) -> Range:
    (low, high), (blue, red) = stated, _VISIBLE_NM
    if blue < low <= red:
        low = max(blue, low - _MARGIN_NM)
    if blue <= high < red:
        high = min(red, high + _MARGIN_NM)
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
    limits = None if limits is None else _extend_range(limits)
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


#
# Media that lens files may name: Sellmeier coefficients b, c [square micrometres], valid range [nm], transmittance.
#
# Glasses: SCHOTT catalogue of 2017-01-20, as collected by refractiveindex.info (public domain); internal
# transmittance turned back from its extinction coefficients k by tau = exp(-4 pi k d / L): every number came out as
# the catalogue's decimals to within 5e-5, and glasses without one have none published. Others: fused silica,
# Malitson, J. Opt. Soc. Am. 55, 1205 (1965); calcium fluoride, Malitson, Appl. Opt. 2, 1103 (1963); water at 20
# degrees, Daimon and Masumura, Appl. Opt. 46, 3811 (2007).

_SELLMEIER: dict[str, tuple[tuple[float, ...], tuple[float, ...], tuple[float, float]]] = {
    "N-BK7": ((1.03961212, 0.231792344, 1.01046945), (0.00600069867, 0.0200179144, 103.560653), (300, 2500)),
    "K10": ((1.15687082, 0.0642625444, 0.872376139), (0.00809424251, 0.0386051284, 104.74773), (300, 2500)),
    "N-BAK1": ((1.12365662, 0.309276848, 0.881511957), (0.00644742752, 0.0222284402, 107.297751), (300, 2500)),
    "N-BALF4": ((1.31004128, 0.142038259, 0.964929351), (0.0079659645, 0.0330672072, 109.19732), (350, 2500)),
    "N-SK2": ((1.28189012, 0.257738258, 0.96818604), (0.0072719164, 0.0242823527, 110.377773), (310, 2500)),
    "N-SK4": ((1.32993741, 0.228542996, 0.988465211), (0.00716874107, 0.0246455892, 100.886364), (334, 2500)),
    "N-SK11": ((1.17963631, 0.229817295, 0.935789652), (0.00680282081, 0.0219737205, 101.513232), (300, 2500)),
    "N-SK15": ((1.30417786, 0.28584116, 0.974781572), (0.00695051276, 0.0232023703, 99.016884), (334, 2500)),
    "N-SK16": ((1.34317774, 0.241144399, 0.994317969), (0.00704687339, 0.0229005, 92.7508526), (310, 2500)),
    "N-SSK2": ((1.4306027, 0.153150554, 1.01390904), (0.00823982975, 0.0333736841, 106.870822), (350, 2500)),
    "N-LAK12": ((1.17365704, 0.588992398, 0.978014394), (0.00577031797, 0.0200401678, 95.4873482), (320, 2500)),
    "LLF1": ((1.21640125, 0.13366454, 0.883399468), (0.00857807248, 0.0420143003, 107.59306), (310, 2500)),
    "LF5": ((1.28035628, 0.163505973, 0.893930112), (0.00929854416, 0.0449135769, 110.493685), (320, 2325)),
    "F2": ((1.34533359, 0.209073176, 0.937357162), (0.00997743871, 0.0470450767, 111.886764), (320, 2500)),
    "F5": ((1.3104463, 0.19603426, 0.96612977), (0.00958633048, 0.0457627627, 115.011883), (320, 2500)),
    "SF1": ((1.55912923, 0.284246288, 0.968842926), (0.0121481001, 0.0534549042, 112.174809), (350, 2500)),
    "SF4": ((1.61957826, 0.339493189, 1.02566931), (0.0125502104, 0.0544559822, 117.652222), (365, 2500)),
    "SF5": ((1.46141885, 0.247713019, 0.949995832), (0.0111826126, 0.0508594669, 112.041888), (350, 2500)),
    "SF6": ((1.72448482, 0.390104889, 1.04572858), (0.0134871947, 0.0569318095, 118.557185), (365, 2500)),
    "SF10": ((1.61625977, 0.259229334, 1.07762317), (0.0127534559, 0.0581983954, 116.60768), (380, 2500)),
    "SF11": ((1.73848403, 0.311168974, 1.17490871), (0.0136068604, 0.0615960463, 121.922711), (390, 2500)),
    "N-FK51A": ((0.971247817, 0.216901417, 0.904651666), (0.00472301995, 0.0153575612, 168.68133), (290, 2500)),
    "N-KZFS4": ((1.35055424, 0.197575506, 1.09962992), (0.0087628207, 0.0371767201, 90.3866994), (334, 2500)),
    "fused silica": ((0.6961663, 0.4079426, 0.8974794), (0.0684043**2, 0.1162414**2, 9.896161**2), (210, 6700)),
    "CaF2": ((0.5675888, 0.4710914, 3.8484723), (0.050263605**2, 0.1003909**2, 34.649040**2), (230, 9700)),
    "water": (
        (0.5684027565, 0.1726177391, 0.02086189578, 0.1130748688),
        (0.005101829712, 0.01821153936, 0.02620722293, 10.69792721),
        (182, 1129),
    ),
}

_THICKNESS_MM = 25.0

_PER_TEN_THOUSAND = """
nm        300  310  320  334  350  365  370  380  390  400  405  420  436  460  500  546  580  620  660  700 1060
N-BK7     500 2500 5200 7800 9200 9710 9770 9830 9890 9920 9930 9930 9920 9930 9940 9960 9950 9940 9940 9960 9970
K10       200 1300 3100 7200 9100 9580 9660 9730 9820 9860 9870 9880 9880 9900 9910 9920 9930 9930 9940 9970 9960
N-BAK1    700 2900 5700 8200 9300 9690 9770 9830 9880 9900 9900 9900 9890 9900 9920 9950 9950 9950 9950 9970 9960
N-BALF4     -    -    -    - 3800 7500 8200 9000 9400 9640 9700 9810 9830 9860 9930 9950 9960 9950 9950 9970 9930
N-SK2       -  400 1800 4900 7800 9200 9400 9700 9790 9840 9850 9840 9820 9830 9900 9950 9950 9940 9940 9950 9950
N-SK4       -    -    - 2000 6100 8300 8700 9300 9600 9750 9790 9830 9830 9850 9920 9950 9950 9950 9950 9960 9930
N-SK11    200 1600 4100 7100 8800 9400 9500 9630 9700 9750 9800 9850 9880 9900 9940 9970 9960 9950 9950 9960 9950
N-SK15      -    -    - 1800 5630 8000 8500 9100 9410 9600 9660 9740 9780 9820 9900 9930 9930 9920 9920 9940 9910
N-SK16      -  200 1100 4000 7000 8600 8900 9300 9560 9700 9740 9790 9810 9840 9910 9940 9940 9930 9940 9960 9950
N-SSK2      -    -    -    - 2500 6700 7500 8600 9200 9540 9630 9750 9800 9850 9920 9950 9950 9930 9940 9960 9920
N-LAK12     -    -  100 1500 4600 7300 7900 8700 9200 9400 9430 9520 9580 9680 9860 9910 9900 9880 9890 9930 9920
LLF1        -  100 3000 8100 9550 9810 9840 9880 9920 9933 9940 9950 9960 9960 9960 9970 9970 9960 9960 9970 9960
LF5         -    -  400 5700 8800 9540 9610 9730 9840 9920 9920 9930 9940 9950 9960 9968 9970 9980 9980 9980 9980
F2          -    -    - 2110 7800 9210 9400 9630 9770 9850 9870 9910 9930 9940 9970 9980 9980 9980 9970 9980 9980
F5          -    -    - 3000 7600 9100 9300 9600 9730 9820 9850 9880 9900 9910 9940 9950 9950 9950 9960 9970 9980
SF1         -    -    -    -  300 5000 6400 7900 8700 9200 9300 9610 9760 9840 9930 9960 9960 9950 9950 9960 9960
SF4         -    -    -    -    - 2800 4500 6900 8200 8900 9100 9500 9670 9800 9910 9960 9960 9950 9950 9960 9960
SF5         -    -    -    - 3100 7300 8000 8800 9200 9500 9590 9730 9820 9880 9930 9960 9960 9950 9950 9960 9960
SF6         -    -    -    -    -  300 1300 4400 6600 8000 8400 9200 9550 9780 9910 9960 9964 9954 9955 9965 9990
SF10        -    -    -    -    -    -    -  600 3700 6900 7900 9200 9610 9780 9890 9950 9950 9930 9930 9950 9970
SF11        -    -    -    -    -    -    -    -  100 2000 3400 7000 8600 9400 9760 9890 9910 9910 9910 9930 9970
N-FK51A   350 1200 3000 6300 8750 9630 9760 9880 9920 9930 9930 9920 9920 9930 9960 9970 9970 9960 9950 9950 9940
N-KZFS4     -    -    - 1500 6000 8200 8600 9100 9300 9480 9520 9610 9680 9760 9870 9920 9930 9920 9930 9940 9960
"""


def _absorptions() -> dict[str, Absorption]:
    """Return the absorption of each glass by its name."""
    head, *rows = (line.split() for line in _PER_TEN_THOUSAND.strip().splitlines())
    result = {}
    for name, *values in rows:
        known = [(float(nm), int(value) / 1e4) for nm, value in zip(head[1:], values, strict=True) if value != "-"]
        wavelengths, transmittances = zip(*known, strict=True)
        result[name] = Absorption.from_transmittance(wavelengths, transmittances, _THICKNESS_MM)
    return result


_ABSORPTIONS = _absorptions()
GLASSES = {
    name: Sellmeier(b, c, range_nm=limits, name=name, absorption=_ABSORPTIONS.get(name))
    for name, (b, c, limits) in _SELLMEIER.items()
}


# Light that an interface lets through: bare (Fresnel), with a quarter-wave layer, or with a measured coating.
#
# Nothing is swallowed at an interface, so what is not reflected passes, and light may be followed either way (Stokes):
# swapping the two sides changes nothing. `transmittance` is for unpolarised light: the mean of both polarisations.
# `polarised` has the complex amplitudes of each, for light that is followed through several surfaces.

Amplitude = NDArray[np.float64] | NDArray[np.complex128]


class Interface(NamedTuple):
    """Rays that cross from one medium into another; arrays that broadcast together.

    Attributes
    ----------
    before, after : float or array
        Indices of refraction.
    cosine_before, cosine_after : array
        Of the angles to the normal on both sides, by Snell's law.
    """

    before: ArrayLike
    after: ArrayLike
    cosine_before: ArrayLike = 1.0
    cosine_after: ArrayLike = 1.0

    @property
    def head_on(self) -> Interface:
        """The same two media met at a right angle."""
        return Interface(self.before, self.after)


class Polarised(NamedTuple):
    """What an interface makes of light of both linear polarisations: factors of its amplitude.

    The square of a factor is a share of the light, so those of reflected and passed light add up to 1. With s across
    the plane of incidence, p = direction x s before and behind the interface; complex where a layer or total
    reflection turns the phase, of light whose phase grows with the path.
    """

    reflected_s: Amplitude
    reflected_p: Amplitude
    passed_s: Amplitude
    passed_p: Amplitude


class Coating(Protocol):
    """What lies on a surface."""

    def transmittance(self, interface: Interface, wavelength_nm: ArrayLike) -> Array:
        """Return the share of unpolarised light that passes, at wavelengths [nm]."""

    def polarised(self, interface: Interface, wavelength_nm: float) -> Polarised:
        """Return the amplitudes of both polarisations at a wavelength [nm]; the cosine behind may be imaginary."""


def amplitudes(interface: Interface) -> tuple[Array, Array]:
    """Return the reflected amplitudes of s and p polarised light (Born and Wolf, Principles of Optics, 1.5.2)."""
    n, m, c, d = (np.asarray(value) for value in interface)
    return (n * c - m * d) / (n * c + m * d), (m * c - n * d) / (m * c + n * d)


@dataclass(frozen=True)
class Bare:
    """No coating: Fresnel's equations."""

    def transmittance(self, interface: Interface, wavelength_nm: ArrayLike) -> Array:
        """Return the share of unpolarised light that passes; it depends on the wavelength by the indices alone."""
        s, p = amplitudes(interface)
        return np.asarray(1.0 - (s * s + p * p) / 2 + np.zeros(np.shape(wavelength_nm)))

    def polarised(self, interface: Interface, wavelength_nm: float) -> Polarised:
        """Return the amplitudes of both polarisations; all light is reflected where these are complex."""
        s, p = amplitudes(interface)
        return Polarised(s, p, *(np.sqrt(np.maximum(1.0 - np.abs(r) ** 2, 0.0)) for r in (s, p)))


BARE = Bare()


@dataclass(frozen=True)
class QuarterWave:
    """One layer whose optical thickness is a quarter of a wavelength.

    The film of the textbooks (Born and Wolf, 1.6.4): with the amplitudes r and t at its two faces and the phase
    2 b = 4 pi n d cos(theta) / L, it reflects (r^2 + t^2 + 2 r t cos 2b) / (1 + r^2 t^2 + 2 r t cos 2b).

    Attributes
    ----------
    index : float
        Of the layer, at every wavelength; not below those of both media.
    wavelength_nm : float
        Four times the index times the thickness [nm].
    """

    index: float
    wavelength_nm: float

    def transmittance(self, interface: Interface, wavelength_nm: ArrayLike) -> Array:
        """Return the share of unpolarised light that passes, at wavelengths [nm]."""
        n, m, c, d = (np.asarray(value, dtype=np.float64) for value in interface)
        inside = np.sqrt(np.maximum(1.0 - (n / self.index) ** 2 * (1.0 - c * c), 0.0))
        front, back = amplitudes(Interface(n, self.index, c, inside)), amplitudes(Interface(self.index, m, inside, d))
        turn = np.cos(np.pi * (self.wavelength_nm / np.asarray(wavelength_nm, dtype=np.float64)) * inside)
        passed: Array = np.zeros(())
        for r, t in zip(front, back, strict=True):
            both = r * t
            passed = passed + (1.0 - r * r) * (1.0 - t * t) / (1.0 + both * both + 2.0 * both * turn) / 2
        return passed

    def polarised(self, interface: Interface, wavelength_nm: float) -> Polarised:
        """Return the amplitudes of both polarisations: the sum over all ways within the layer (Airy)."""
        n, m, c, d = (np.asarray(value) for value in interface)
        square = 1.0 - (n / self.index) ** 2 * (1.0 - c * c)
        inside = np.sqrt(square + 0j if np.any(square < 0) else square)
        front, back = amplitudes(Interface(n, self.index, c, inside)), amplitudes(Interface(self.index, m, inside, d))
        half_turn = np.exp(0.5j * np.pi * (self.wavelength_nm / wavelength_nm) * inside)
        reflected, passed = [], []
        for r, t in zip(front, back, strict=True):
            round_trips = 1.0 + r * t * half_turn**2
            reflected.append((r + t * half_turn**2) / round_trips)
            passed.append(np.sqrt((1.0 - r * r) * (1.0 - t * t) + 0j) * half_turn / round_trips)
        return Polarised(*reflected, *passed)


@dataclass(frozen=True)
class MeasuredReflectance:
    """A coating by its reflectance at normal incidence.

    Away from the normal it passes less in the proportion in which the bare surface does:
    T(angle) = (1 - R) F(angle) / F(0), F being Fresnel's transmittance. That keeps the limits (R on the axis, nothing
    at grazing incidence, the same in both directions), but not the shift of a multilayer's colours with the angle.

    Attributes
    ----------
    wavelengths_nm, values : tuple of float
        Reflectance 0 to 1 at rising wavelengths; a single value holds at every wavelength.
    """

    wavelengths_nm: tuple[float, ...]
    values: tuple[float, ...]

    @property
    def range_nm(self) -> tuple[float, float]:
        """Wavelengths that it is known for [nm]."""
        return (self.wavelengths_nm[0], self.wavelengths_nm[-1]) if len(self.values) > 1 else (0.0, np.inf)

    def reflectance(self, wavelength_nm: ArrayLike) -> Array:
        """Return the reflectance at normal incidence at each wavelength [nm]."""
        return interpolate(wavelength_nm, self.wavelengths_nm, self.values, "reflectance of a coating")

    def transmittance(self, interface: Interface, wavelength_nm: ArrayLike) -> Array:
        """Return the share of unpolarised light that passes, at wavelengths [nm]."""
        slanted = BARE.transmittance(interface, wavelength_nm) / BARE.transmittance(interface.head_on, wavelength_nm)
        return (1.0 - self.reflectance(wavelength_nm)) * np.minimum(slanted, 1.0)

    def polarised(self, interface: Interface, wavelength_nm: float) -> Polarised:
        """Return the amplitudes of both polarisations: alike, and in phase with those of the bare surface.

        A measured reflectance says nothing of either.
        """
        bare = amplitudes(interface)
        fresnel = 1.0 - (np.abs(bare[0]) ** 2 + np.abs(bare[1]) ** 2) / 2
        slanted = np.minimum(fresnel / BARE.transmittance(interface.head_on, wavelength_nm), 1.0)
        passed = (1.0 - self.reflectance(wavelength_nm)) * slanted
        phases = [np.where(r == 0, 1.0, r) / np.where(r == 0, 1.0, np.abs(r)) for r in bare]
        back, through = np.sqrt(1.0 - passed), np.sqrt(passed)
        return Polarised(back * phases[0], back * phases[1], through, through)


def constant_reflectance(share: float) -> MeasuredReflectance:
    """Return the coating that reflects a share of the light at normal incidence, at every wavelength."""
    return MeasuredReflectance((0.0,), (share,))


MAGNESIUM_FLUORIDE = QuarterWave(1.38, 550.0)  # Macleod, Thin-Film Optical Filters, 4th ed., table of materials


# Light that several layers on an interface let through and reflect, by their characteristic matrices.

LEAST_COSINE = 1e-9  # in a layer, along which light does not quite travel


@dataclass(frozen=True)
class Layer:
    """One layer.

    Attributes
    ----------
    index : float
        At every wavelength.
    thickness_nm : float
    extinction : float
        k of the index n + i k, at every wavelength: 0 of a layer that absorbs nothing.
    """

    index: float
    thickness_nm: float
    extinction: float = 0.0


@dataclass(frozen=True)
class LayerStack:
    """Layers on one another.

    The tangential fields in front of a layer follow from those behind it by its matrix (Born and Wolf, 1.6.2; Macleod,
    Thin-Film Optical Filters, chapter 2), here of light whose phase grows with the path.

    Attributes
    ----------
    layers : tuple of Layer
        From the medium of the lower index, such as air, to that of the higher. No index is below those of both media,
        but of layers that absorb.
    """

    layers: tuple[Layer, ...]

    @property
    def absorbs(self) -> bool:
        """Whether any layer does."""
        return any(layer.extinction > 0 for layer in self.layers)

    def from_behind(self, before: ArrayLike, after: ArrayLike) -> tuple[Layer, ...]:
        """Return the layers from the far side, seen by light that crosses from one index to another."""
        return self.layers[::-1] if np.all(np.asarray(before) <= np.asarray(after)) else self.layers

    def transmittance(self, interface: Interface, wavelength_nm: ArrayLike) -> Array:
        """Return the share of unpolarised light that passes, at wavelengths [nm]."""
        (_, s), (_, p) = self._amplitudes(interface, np.asarray(wavelength_nm, dtype=np.float64))
        return np.asarray((np.abs(s) ** 2 + np.abs(p) ** 2) / 2)

    def polarised(self, interface: Interface, wavelength_nm: float) -> Polarised:
        """Return the amplitudes of both polarisations."""
        (s, passed_s), (p, passed_p) = self._amplitudes(interface, np.asarray(wavelength_nm))
        return Polarised(s, p, passed_s, passed_p)

    def _amplitudes(
        self, interface: Interface, wavelength_nm: Array
    ) -> tuple[tuple[Amplitude, Amplitude], tuple[Amplitude, Amplitude]]:
        """Return the reflected and the passed amplitude of s and of p polarised light."""
        n, m, c, d = (np.asarray(value) for value in interface)
        layers: list[tuple[Any, Any, Any]] = []
        for layer in self.from_behind(n, m):
            index = complex(layer.index, layer.extinction) if layer.extinction else layer.index
            inside = np.sqrt(1.0 - (n / index) ** 2 * (1.0 - c * c) + 0j)
            inside = np.where(np.abs(inside) < LEAST_COSINE, LEAST_COSINE, inside)
            layers.append((index, inside, 2 * np.pi * index * layer.thickness_nm / wavelength_nm * inside))
        of_s = _through([(f * cosine, phase) for f, cosine, phase in layers], n * c, m * d)
        return of_s, _through([(cosine / f, phase) for f, cosine, phase in layers], c / n, d / m)


MULTILAYER = LayerStack((Layer(1.38, 99.6), Layer(2.1, 131.0), Layer(1.7, 80.9)))  # quarter, half, quarter of 550 nm


def _through(layers: list[tuple[Amplitude, Amplitude]], front: Array, behind: Array) -> tuple[Amplitude, Amplitude]:
    """Return amplitudes from the admittances and phases of layers, from behind, and the admittances of both media.

    What a layer damps is set apart, so that a thick one leaves numbers of the usual size.
    """
    one, other = np.ones((), dtype=np.complex128), np.asarray(behind, dtype=np.complex128)
    left: Amplitude = np.ones(())
    for admittance, phase in layers:
        if np.any(np.imag(phase)):
            depth = np.imag(phase)
            there, back = np.exp(1j * phase - depth), np.exp(-1j * phase - depth)
            left, cosine, sine = left * np.exp(-depth), (there + back) / 2, (back - there) / 2
        else:
            cosine, sine = np.cos(phase), -1j * np.sin(phase)
        one, other = cosine * one + sine / admittance * other, sine * admittance * one + cosine * other
    whole = front * one + other
    return (front * one - other) / whole, 2.0 * left * np.sqrt(front * np.real(behind)) / whole
