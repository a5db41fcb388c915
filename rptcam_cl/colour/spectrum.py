"""The wavelengths at which all spectra are known, tables that come onto them, and spectra for colours.

I. Mallett and C. Yuksel, "Spectral Primary Decomposition for Rendering with sRGB Reflectance", EGSR 2019. The table is
solved by `benchmarks/rgb_basis.py`.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.resources import spectra_dir

Spectrum = NDArray[np.float64]

SHORTEST_NM, LONGEST_NM = 380, 780
WAVELENGTHS_NM: Spectrum = np.arange(SHORTEST_NM, LONGEST_NM + 1, dtype=np.float64)
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
    edges = np.arange(SHORTEST_NM - 0.5, LONGEST_NM + 1)
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
        below = min(int(wavelength), LONGEST_NM - 1)
        share = wavelength - below
        spectrum[below - SHORTEST_NM] += amount * (1 - share)
        spectrum[below - SHORTEST_NM + 1] += amount * share
    return spectrum


@cache
def columns(name: str) -> dict[str, Spectrum]:
    """Return the columns of a table by their headings, at `WAVELENGTHS_NM`; read-only."""
    text = (spectra_dir() / f"{name}.csv").read_text("utf-8")
    heading, *rows = [line for line in text.splitlines() if not line.startswith("#")]
    values = np.array([row.split(",") for row in rows], np.float64).T
    found = {
        title: on_grid(values[0], column) for title, column in zip(heading.split(",")[1:], values[1:], strict=True)
    }
    for column in found.values():
        column.setflags(write=False)
    return found


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
