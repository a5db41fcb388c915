"""Compares two ways to make reflectance spectra of colours: with each other, and with measured reflectances.

    python -m benchmarks.upsampling

The basis of Mallett and Yuksel 2019, which the renderer uses, and the sigmoids of quadratic polynomials of W. Jakob and
J. Hanika, "A Low-Dimensional Function Space for Efficient Spectral Upsampling", Eurographics 2019, fitted here to each
colour by itself. Measured are the 24 patches of a ColorChecker: their colour under D65 is made a spectrum again, and
compared with the patch, as a spectrum and under other lights (CIE 1976 colour difference).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from benchmarks.rgb_basis import weights
from rptcam_cl.core.colour import (
    WAVELENGTHS_NM,
    illuminant,
    on_grid,
    reflectance_from_srgb,
    srgb_from_reflectance,
    xyz_from_spectrum,
)

Array = NDArray[np.float64]

LIGHTS = ("A", "F2", "F11", "LED-B3")
PRIMARIES = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1], [1, 0, 1], [1, 1, 0]], np.float64)
CUBE = np.stack(np.meshgrid(*[np.linspace(0, 1, 9)] * 3), axis=-1).reshape(-1, 3)

_PLACES = (WAVELENGTHS_NM - 580) / 200
_POWERS = np.stack([_PLACES**2, _PLACES, np.ones_like(_PLACES)], axis=1)


def sigmoid_spectrum(srgb: Array) -> Array:
    """Return the reflectance (401,) of a colour after Jakob and Hanika: approached from grey in four steps."""
    seen = weights()
    grey = np.full(3, np.clip(srgb.mean(), 0.02, 0.98))
    even = 2 * grey[0] - 1
    found = np.array([0.0, 0.0, even / np.sqrt(1 - even**2)])
    for step in (0.25, 0.5, 0.75, 1.0):
        target = grey + step * (srgb - grey)
        fit = least_squares(
            lambda c, target=target: seen @ _sigmoid(_POWERS @ c) - target,
            found,
            jac=lambda c: (seen * 0.5 * (1 + (_POWERS @ c) ** 2) ** -1.5) @ _POWERS,
            method="lm",
        )
        found = fit.x
    return _sigmoid(_POWERS @ found)


def _sigmoid(x: Array) -> Array:
    return np.asarray(0.5 + x / (2 * np.sqrt(1 + x * x)))


def color_checker() -> dict[str, Array]:
    """Return the measured reflectances (401,) of the patches by their names."""
    text = (Path(__file__).parents[1] / "tests" / "data" / "color_checker.csv").read_text("utf-8")
    heading, *rows = (line.split(",") for line in text.splitlines() if not line.startswith("#"))
    table = np.array(rows, np.float64)
    return {name: on_grid(table[:, 0], column) for name, column in zip(heading[1:], table.T[1:], strict=True)}


def lab(reflectance: Array, light: str) -> Array:
    """Return L*, a*, b* of a reflectance under an illuminant."""
    spectrum = illuminant(light)
    relative = xyz_from_spectrum(reflectance * spectrum) / xyz_from_spectrum(spectrum)
    x, y, z = np.where(relative > (6 / 29) ** 3, np.cbrt(relative), relative * (29 / 6) ** 2 / 3 + 4 / 29)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def round_trip(way: Callable[[Array], Array], colours: Array) -> float:
    """Return the largest error of a channel of colours that are made spectra and colours again."""
    return float(max(np.abs(srgb_from_reflectance(way(colour)) - colour).max() for colour in colours))


def against_measured(way: Callable[[Array], Array]) -> Array:
    """Return per patch the RMS error of the reflectance from 400 to 700 nm, and colour differences under `LIGHTS`."""
    rows = []
    for measured in color_checker().values():
        made = way(np.clip(srgb_from_reflectance(measured), 0, 1))
        error = np.sqrt(np.mean((made - measured)[20:321] ** 2))
        rows.append([error, *(np.linalg.norm(lab(made, light) - lab(measured, light)) for light in LIGHTS)])
    return np.array(rows)


def main() -> None:
    """Print both tables."""
    ways = {"Mallett and Yuksel": reflectance_from_srgb, "Jakob and Hanika": sigmoid_spectrum}
    patches = np.clip([srgb_from_reflectance(patch) for patch in color_checker().values()], 0, 1)
    print("| round trip, largest error | cube 9 x 9 x 9 | primaries and their mixtures | ColorChecker |")
    print("|---|---|---|---|")
    for name, way in ways.items():
        print(f"| {name} | " + " | ".join(f"{round_trip(way, c):.0e}" for c in (CUBE, PRIMARIES, patches)) + " |")
    print(f"\n| ColorChecker, mean (largest) | RMS of the spectrum | {' | '.join(LIGHTS)} |\n|---|---|---|---|---|---|")
    for name, way in ways.items():
        found = against_measured(way)
        digits = (3, 1, 1, 1, 1)
        cells = zip(found.mean(axis=0), found.max(axis=0), digits, strict=True)
        print(f"| {name} | " + " | ".join(f"{mean:.{n}f} ({most:.{n}f})" for mean, most, n in cells) + " |")


if __name__ == "__main__":
    main()
