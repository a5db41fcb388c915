"""Spectra from 380 to 780 nm: lights, metals, reflectances, what eyes and sensors make of them, RGB spaces."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from rptcam_cl.core import BOLTZMANN, LIGHT_SPEED, PLANCK
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import response_curves_dir, spectra_dir

#
# The wavelengths at which all spectra are known, tables that come onto them, and spectra for colours.
#
# I. Mallett and C. Yuksel, "Spectral Primary Decomposition for Rendering with sRGB Reflectance", EGSR 2019. The table
# is solved by `benchmarks/rgb_basis.py`.

Spectrum = NDArray[np.float64]

_SHORTEST_NM, _LONGEST_NM = 380, 780
WAVELENGTHS_NM: Spectrum = np.arange(_SHORTEST_NM, _LONGEST_NM + 1, dtype=np.float64)
WAVELENGTHS_NM.setflags(write=False)


def on_grid(wavelengths_nm: ArrayLike, values: ArrayLike, *, beyond: float | None = None) -> Spectrum:
    """Return a table at `WAVELENGTHS_NM`: straight lines between its rows, averaged where it is finer than 1 nm.

    Parameters
    ----------
    wavelengths_nm : (n,) array
        Wavelengths of the rows [nm], rising.
    values : (n,) array
        Values of the rows.
    beyond : float, optional
        Value outside the table; that of its nearest row by default.
    """
    x, y = np.asarray(wavelengths_nm, np.float64), np.asarray(values, np.float64)
    if np.min(np.diff(x), initial=np.inf) >= 1:
        return np.asarray(np.interp(WAVELENGTHS_NM, x, y, left=beyond, right=beyond))
    edges = np.arange(_SHORTEST_NM - 0.5, _LONGEST_NM + 1)
    # The table stays what it is when it is cut at the edges of the cells; only then are sums over cells exact.
    cuts = np.union1d(x, edges)
    heights = np.interp(cuts, x, y, left=beyond, right=beyond)
    area = np.concatenate([[0.0], np.cumsum(np.diff(cuts) * (heights[1:] + heights[:-1]) / 2)])
    return np.asarray(np.diff(np.interp(edges, cuts, area)))


def lines_on_grid(lines: ArrayLike) -> Spectrum:
    """Return lines (wavelength [nm], amount) as densities [1/nm]: each shared by its neighbours on the grid.

    Amount and mean wavelength are kept; lines lie within the grid.
    """
    spectrum = np.zeros_like(WAVELENGTHS_NM)
    for wavelength, amount in np.asarray(lines, np.float64).reshape(-1, 2):
        below = min(int(wavelength), _LONGEST_NM - 1)
        share = wavelength - below
        spectrum[below - _SHORTEST_NM] += amount * (1 - share)
        spectrum[below - _SHORTEST_NM + 1] += amount * share
    return spectrum


@cache
def columns(name: str) -> dict[str, Spectrum]:
    """Return the columns of a table by their headings, at `WAVELENGTHS_NM`; read-only."""
    text = (spectra_dir() / f"{name}.csv").read_text("utf-8")
    heading, *rows = [line for line in text.splitlines() if not line.startswith("#")]
    values = np.array([row.split(",") for row in rows], np.float64).T
    table = {
        title: on_grid(values[0], column) for title, column in zip(heading.split(",")[1:], values[1:], strict=True)
    }
    for column in table.values():
        column.setflags(write=False)
    return table


@cache
def table(name: str) -> Spectrum:
    """Return the columns of a table side by side, shape (wavelengths, columns); read-only."""
    stacked = np.stack(list(columns(name).values()), axis=1)
    stacked.setflags(write=False)
    return stacked


def cie_1931() -> Spectrum:
    """Return the colour matching functions x, y, z of the CIE 1931 observer (401, 3); sums over 1 nm give X, Y, Z."""
    return table("cie_1931")


def rgb_basis() -> NDArray[np.float64]:
    """Return the reflectance spectra of linear sRGB's red, green and blue (401, 3).

    They are not negative, sum to 1 at every wavelength, and give back their colour under D65; so do all mixtures. The
    reflectance of a colour c is ``rgb_basis() @ c``; light of colour c has that times D65 of luminance 1.
    """
    return table("rgb_basis")


def reflectance_from_srgb(srgb: ArrayLike) -> NDArray[np.float64]:
    """Return reflectance spectra (..., 401) of linear sRGB colours (..., 3)."""
    return np.asarray(np.asarray(srgb, np.float64) @ rgb_basis().T)


# Spectra of lights: standard illuminants, daylight of any temperature, black bodies.

COOLEST_DAYLIGHT, HOTTEST_DAYLIGHT = 4000.0, 25000.0  # [K], CIE 15

ILLUMINANTS = ("A", "D50", "D55", "D65", "D75", "E", "F2", "F7", "F11", "LED-B1", "LED-B2", "LED-B3", "LED-B4",
               "LED-B5")  # fmt: skip


def illuminant(name: str) -> Spectrum:
    """Return a CIE illuminant of luminance 1 (401,) [1/nm].

    Raises
    ------
    InputError
        When no illuminant has this name.
    """
    if name == "A":
        # CIE 15: a temperature of 2848 K with the constant of 1931, 14350 um K, stands for 2856 K.
        return _of_luminance_1(WAVELENGTHS_NM**-5 / np.expm1(1.435e7 / (2848 * WAVELENGTHS_NM)))
    if name == "E":
        return _of_luminance_1(np.ones_like(WAVELENGTHS_NM))
    if name not in ILLUMINANTS:
        raise InputError(f"is not a known illuminant (got {name!r}; allowed: {', '.join(ILLUMINANTS)})")
    return _of_luminance_1(columns("illuminants")[name])


@cache
def daylight_65() -> Spectrum:
    """Return illuminant D65 of luminance 1 (401,) [1/nm]."""
    return illuminant("D65")


def daylight(kelvin: float) -> Spectrum:
    """Return daylight of a correlated colour temperature [K], of luminance 1 (401,) [1/nm]; CIE 15:2018, 4.1.2.

    The temperature is that of today's scale: D65 is `daylight(6504)`.

    Raises
    ------
    InputError
        When the temperature is outside 4000 to 25000 K.
    """
    if not COOLEST_DAYLIGHT <= kelvin <= HOTTEST_DAYLIGHT:
        raise InputError(
            f"is no temperature of daylight (got {kelvin:g}; allowed: {COOLEST_DAYLIGHT:g} to {HOTTEST_DAYLIGHT:g} K)"
        )
    if kelvin <= 7000:
        x = -4.6070e9 / kelvin**3 + 2.9678e6 / kelvin**2 + 0.09911e3 / kelvin + 0.244063
    else:
        x = -2.0064e9 / kelvin**3 + 1.9018e6 / kelvin**2 + 0.24748e3 / kelvin + 0.237040
    y = -3.000 * x**2 + 2.870 * x - 0.275
    scale = 0.0241 + 0.2562 * x - 0.7341 * y
    weights = (1.0, (-1.3515 - 1.7703 * x + 5.9114 * y) / scale, (0.0300 - 31.4424 * x + 30.0717 * y) / scale)
    return _of_luminance_1(np.maximum(table("daylight") @ np.array(weights), 0.0))


def blackbody(kelvin: float) -> Spectrum:
    """Return the radiance of a black body of a temperature [K] (401,) [W/(m² sr nm)]."""
    return planck_radiance(WAVELENGTHS_NM, kelvin)


def planck_radiance(wavelength_nm: ArrayLike, kelvin: float) -> Spectrum:
    """Return the radiance of a black body of a temperature [K] in vacuum [W/(m² sr nm)], by Planck's law."""
    metres = np.asarray(wavelength_nm, np.float64) * 1e-9
    # Beyond the exponent 700 the radiance is below 1e-290 of anything visible; larger ones overflow.
    exponent = np.minimum(PLANCK * LIGHT_SPEED / (BOLTZMANN * kelvin * metres), 700.0)
    return np.asarray(2 * PLANCK * LIGHT_SPEED**2 / metres**5 / np.expm1(exponent) * 1e-9)


def _of_luminance_1(spectrum: Spectrum) -> Spectrum:
    return np.asarray(spectrum / (cie_1931()[:, 1] @ spectrum))


#
# CIE XYZ and linear sRGB: of spectra, of one another, and under another white; and the luminance of colours.
#
# Amounts: a spectrum holds radiance [W/(m² sr nm)], or intensity or irradiance per nm. Y = 1 is what light of 555 nm
# and 1 W/(m² sr) gives, 683 cd/m², and the luminance of the colour (1, 1, 1).
#
# The standard rounds the white point to four digits. Spectra have that of the tables, (0.31274, 0.32905), so that D65
# is exactly (1, 1, 1); what is done to finished pictures goes by the standard.

Array = NDArray[np.float64]
Matrix = NDArray[np.float64]
Chromaticity = tuple[float, float]

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear sRGB, ITU-R BT.709-6
SRGB_PRIMARIES: tuple[Chromaticity, ...] = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06))  # ITU-R BT.709-6
SRGB_WHITE: Chromaticity = (0.3127, 0.3290)  # D65 as IEC 61966-2-1 rounds it

# Spaces of linear films: primaries and white. ITU-R BT.2020-2; Academy S-2014-004 (ACEScg).
Primaries = Literal["rec709", "rec2020", "acescg"]
PRIMARIES: dict[Primaries, tuple[tuple[Chromaticity, ...], Chromaticity]] = {
    "rec709": (SRGB_PRIMARIES, SRGB_WHITE),
    "rec2020": (((0.708, 0.292), (0.170, 0.797), (0.131, 0.046)), SRGB_WHITE),
    "acescg": (((0.713, 0.293), (0.165, 0.830), (0.128, 0.044)), (0.32168, 0.33767)),
}

# Cone-like responses of the Bradford transform (K. M. Lam, dissertation, Bradford 1985), in its linear form as in
# ISO 15076-1 (ICC profiles), annex E.
BRADFORD: Matrix = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


def xyz_of(chromaticity: Chromaticity) -> Array:
    """Return the tristimulus values X, Y, Z of luminance 1."""
    x, y = chromaticity
    return np.array([x / y, 1.0, (1.0 - x - y) / y])


def _xyz_from_rgb(white: Array, primaries: Sequence[Chromaticity] = SRGB_PRIMARIES) -> Matrix:
    """Return the matrix whose columns are the primaries, scaled so that their sum is the white (SMPTE RP 177)."""
    columns = np.array([xyz_of(primary) for primary in primaries]).T
    return np.asarray(columns * np.linalg.solve(columns, white))


XYZ_FROM_RGB = _xyz_from_rgb(xyz_of(SRGB_WHITE))
RGB_FROM_XYZ: Matrix = np.asarray(np.linalg.inv(XYZ_FROM_RGB))


@cache
def srgb_from_xyz() -> Matrix:
    """Return the matrix (3, 3) from X, Y, Z to linear sRGB; D65 of luminance 1 becomes exactly (1, 1, 1)."""
    return np.asarray(np.linalg.inv(_xyz_from_rgb(xyz_from_spectrum(daylight_65()))))


def xyz_from_spectrum(spectrum: ArrayLike) -> Array:
    """Return X, Y, Z (..., 3) of spectra (..., 401)."""
    return np.asarray(np.asarray(spectrum, np.float64) @ cie_1931())


def srgb_from_spectrum(spectrum: ArrayLike) -> Array:
    """Return linear sRGB (..., 3) of the spectra of lights (..., 401), negative where they lie outside its gamut."""
    return np.asarray(xyz_from_spectrum(spectrum) @ srgb_from_xyz().T)


def srgb_from_reflectance(reflectance: ArrayLike) -> Array:
    """Return linear sRGB (..., 3) of reflectance spectra (..., 401) under D65; 1 everywhere is (1, 1, 1)."""
    return srgb_from_spectrum(np.asarray(reflectance, np.float64) * daylight_65())


def linear_from_srgb(encoded: Any) -> Any:
    """Return the linear values of sRGB-encoded ones from 0 to 1, numbers or an array (IEC 61966-2-1)."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def within_srgb(srgb: ArrayLike) -> Array:
    """Return linear sRGB colours (..., 3) without negative channels: those become 0, the luminance stays."""
    given = np.asarray(srgb, np.float64)
    kept = np.maximum(given, 0.0)
    bright = exact_luminance(kept)
    factor = np.where(bright > 0, np.maximum(exact_luminance(given), 0.0) / np.where(bright > 0, bright, 1.0), 0.0)
    return np.asarray(kept * factor[..., None])


def exact_luminance(srgb: ArrayLike) -> Array:
    """Return the luminance Y (...) of linear sRGB colours (..., 3) by the tables, as `srgb_from_xyz` has it."""
    return np.asarray(np.asarray(srgb, np.float64) @ np.linalg.inv(srgb_from_xyz())[1])


def luminance(colours: ArrayLike, dtype: DTypeLike = np.float64) -> Any:
    """Return the luminance (...) of linear sRGB colours (..., 3) by the standard, computed in a given precision.

    It is a sum and no product of matrices: those of a large film wake the threads of numpy's linear algebra, which then
    wait for more with the processor on, while a device on that processor goes on with the picture.
    """
    red, green, blue = np.moveaxis(np.asarray(colours, dtype), -1, 0)
    of_red, of_green, of_blue = LUMINANCE.astype(dtype)
    return of_red * red + of_green * green + of_blue * blue


def adaptation(source: Array, target: Array) -> Matrix:
    """Return the Bradford matrix that turns XYZ seen under a white into XYZ seen under another.

    Parameters
    ----------
    source, target
        XYZ of the two whites; their Bradford responses are above 0.
    """
    responses = BRADFORD @ target / (BRADFORD @ source)
    return np.linalg.inv(BRADFORD) @ (responses[:, None] * BRADFORD)


def srgb_from_primaries(primaries: Sequence[Chromaticity], white: Chromaticity) -> Matrix:
    """Return the matrix (3, 3) to linear sRGB from red, green and blue of other primaries; white stays white.

    Raises
    ------
    InputError
        When they are no primaries: on one line, or without luminance.
    """
    try:
        source = xyz_of(white)
        columns = _xyz_from_rgb(source, primaries)
        matrix = RGB_FROM_XYZ @ adaptation(source, xyz_of(SRGB_WHITE)) @ columns
    except (ZeroDivisionError, np.linalg.LinAlgError):
        matrix = np.full((3, 3), np.nan)
    if not np.isfinite(matrix).all():
        got = ", ".join(f"{value:g}" for pair in (*primaries, white) for value in pair)
        raise InputError(f"has chromaticities that are no primaries (got {got})")
    return np.asarray(matrix)


# Metals by their optical constants, from the literature.

HC = 1239.84198  # photon energy times wavelength [eV nm]


@dataclass(frozen=True)
class OpticalTable:
    """Refractive index n + i k at photon energies [eV]."""

    energy: tuple[float, ...]
    n: tuple[float, ...]
    k: tuple[float, ...]

    def index(self, wavelength_nm: Spectrum) -> NDArray[np.complex128]:
        """Return the complex refractive index, linear in photon energy between the rows."""
        energy = HC / wavelength_nm
        return np.interp(energy, self.energy, self.n) + 1j * np.interp(energy, self.energy, self.k)


@dataclass(frozen=True)
class LorentzDrude:
    """A Drude term and Lorentz oscillators (strength, width, resonance) [eV] about a plasma energy [eV]."""

    plasma: float
    drude: tuple[float, float]
    oscillators: tuple[tuple[float, float, float], ...]

    def index(self, wavelength_nm: Spectrum) -> NDArray[np.complex128]:
        """Return the complex refractive index."""
        energy = HC / wavelength_nm
        strength, width = self.drude
        permittivity = 1 - strength * self.plasma**2 / (energy * (energy + 1j * width))
        for strength, width, resonance in self.oscillators:
            permittivity += strength * self.plasma**2 / (resonance**2 - energy**2 - 1j * energy * width)
        return np.asarray(np.sqrt(permittivity))


# P. B. Johnson and R. W. Christy, Phys. Rev. B 6, 4370 (1972).
_NOBLE = (1.51, 1.64, 1.76, 1.88, 2.01, 2.13, 2.26, 2.38, 2.50, 2.63, 2.75, 2.88, 3.00, 3.12, 3.25)
METALS: dict[str, OpticalTable | LorentzDrude] = {
    "copper": OpticalTable(
        _NOBLE,
        (0.26, 0.24, 0.21, 0.22, 0.30, 0.70, 1.02, 1.18, 1.22, 1.25, 1.24, 1.25, 1.28, 1.32, 1.33),
        (5.180, 4.665, 4.205, 3.747, 3.205, 2.704, 2.577, 2.608, 2.564, 2.483, 2.397, 2.305, 2.207, 2.116, 2.045),
    ),
    "gold": OpticalTable(
        _NOBLE,
        (0.16, 0.14, 0.13, 0.14, 0.21, 0.29, 0.43, 0.62, 1.04, 1.31, 1.38, 1.45, 1.46, 1.47, 1.46),
        (5.083, 4.542, 4.103, 3.697, 3.272, 2.863, 2.455, 2.081, 1.833, 1.849, 1.914, 1.948, 1.958, 1.952, 1.933),
    ),
    "silver": OpticalTable(
        _NOBLE,
        (0.04, 0.03, 0.04, 0.05, 0.06, 0.05, 0.06, 0.05, 0.05, 0.05, 0.04, 0.04, 0.05, 0.05, 0.05),
        (5.727, 5.242, 4.838, 4.483, 4.152, 3.858, 3.586, 3.324, 3.093, 2.869, 2.657, 2.462, 2.275, 2.070, 1.864),
    ),
    # P. B. Johnson and R. W. Christy, Phys. Rev. B 9, 5056 (1974), at 650, 550 and 450 nm.
    "iron": OpticalTable((1.907, 2.254, 2.755), (2.87, 2.95, 2.65), (3.12, 2.93, 2.77)),
    # A. D. Rakic et al., Appl. Opt. 37, 5271 (1998), tables 2 and 3.
    "aluminium": LorentzDrude(14.98, (0.523, 0.047), (
        (0.227, 0.333, 0.162), (0.050, 0.312, 1.544), (0.166, 1.351, 1.808), (0.030, 3.382, 3.473))),
    "chromium": LorentzDrude(10.75, (0.168, 0.047), (
        (0.151, 3.175, 0.121), (0.150, 1.305, 0.543), (1.149, 2.676, 1.970), (0.825, 1.335, 8.775))),
    "nickel": LorentzDrude(15.92, (0.096, 0.048), (
        (0.100, 4.511, 0.174), (0.135, 1.334, 0.582), (0.106, 2.178, 1.597), (0.729, 6.292, 6.089))),
    "platinum": LorentzDrude(9.59, (0.333, 0.080), (
        (0.191, 0.517, 0.780), (0.659, 1.838, 1.314), (0.547, 3.668, 3.141), (3.576, 8.517, 9.249))),
    "tungsten": LorentzDrude(13.22, (0.206, 0.064), (
        (0.054, 0.530, 1.004), (0.166, 1.281, 1.917), (0.706, 3.332, 3.580), (2.590, 5.836, 7.498))),
}  # fmt: skip


def metal_optics(name: str) -> tuple[Spectrum, Spectrum]:
    """Return real and imaginary part of the refractive index n + i k of a metal (401,), by its name in `METALS`."""
    index = METALS[name].index(WAVELENGTHS_NM)
    return index.real, index.imag


#
# How sensors respond to light: published curves of cameras, and the electrons that light on the film sets free.
#
# An amount of film irradiance is as in a scene: 1 in every channel is white light D65 of 683 lx.

RESPONSES = ("nikon_d5100", "canon_eos_5d_mark_ii", "sigma_sd_merrill")

# Wavelengths that stand for the channels where no curves are given [nm]: near sRGB's primaries, and near
# those at which data sheets give the efficiencies of colour sensors.
_CHANNEL_NM = np.array([610.0, 545.0, 465.0])


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
    without, each channel of the film is light of one of `_CHANNEL_NM`, and its own channel of the sensor sees it.

    Parameters
    ----------
    name : str, optional
        One of `RESPONSES`.
    quantum_efficiency : (3,) floats
        Electrons per photon in red, green and blue, with curves where each of these is highest.
    """
    if name is None:
        return np.diag(photons_per_joule(_CHANNEL_NM) * quantum_efficiency)
    efficiency = response(name) / photons_per_joule(WAVELENGTHS_NM)[:, None]
    electrons = response(name) * quantum_efficiency / efficiency.max(axis=0)
    return np.asarray((rgb_basis() * daylight_65()[:, None]).T @ electrons)
