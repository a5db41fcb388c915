"""The tables that come with the package: rows of a wavelength and its values."""

from __future__ import annotations

from functools import cache

import numpy as np

from rptcam_cl.resources import spectra_dir
from rptcam_cl.spectra.grid import Spectrum, on_grid


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
