"""Glasses of the makers' catalogues that come with the package; none is read before it is requested.

The data and their source: ``optics/catalogues/README.md``.
"""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import StateError
from rptcam_cl.core.resources import glass_catalogues_dir
from rptcam_cl.optics.absorption import Absorption
from rptcam_cl.optics.files.catalogue import law_of_formula
from rptcam_cl.optics.glass import Law, Medium, TabulatedIndex
from rptcam_cl.optics.glass_table import GLASSES
from rptcam_cl.optics.thermal import STANDARD_C, Thermal

MAKERS = (
    "schott", "ohara", "hoya", "hikari", "cdgm", "sumita", "lzos", "plastic", "corning", "crystran", "ami", "lightpath",
    "vitron",
)  # fmt: skip
_HEAD = re.compile(r'^\{"name":"([^"]+)"(?:,"nd":([0-9.]+),"vd":(-?[0-9.]+))?', re.MULTILINE)


@dataclass(frozen=True)
class MakersGlass:
    """A glass of a maker's catalogue.

    Attributes
    ----------
    maker : str
        One of `MAKERS`.
    name : str
        As the maker writes it.
    nd, vd : float or None
        Index and Abbe number at the d line, None where they are not known.
    """

    maker: str
    name: str
    nd: float | None
    vd: float | None


def plain_glass_name(name: str) -> str:
    """Return a glass name without hyphens, blanks, quotes and case: ``NBK7`` and ``N-BK7`` agree."""
    return re.sub(r"[-\s'\"]", "", name).upper()


@lru_cache(maxsize=len(MAKERS))
def glasses_of(maker: str) -> dict[str, MakersGlass]:
    """Return the glasses of a maker by their plain names."""
    found = (_HEAD.match(line) for line in _text(maker).splitlines())
    return {
        plain_glass_name(row[1]): MakersGlass(maker, row[1], *(float(v) if v else None for v in (row[2], row[3])))
        for row in found
        if row
    }


@lru_cache(maxsize=256)
def law_of(glass: MakersGlass, label: str) -> Law:
    """Return the dispersion law of a glass, called `label`, with what it absorbs."""
    row = _row(glass)
    absorption, thermal = _absorption(row), _thermal(row)
    if "formula" in row:
        low, high = row["range_um"]
        law = law_of_formula(f"formula {row['formula']}", row["coefficients"], (1e3 * low, 1e3 * high), label)
        return replace(law, absorption=absorption, thermal=thermal)
    wavelengths, values = zip(*row["n"], strict=True)
    return TabulatedIndex(tuple(1e3 * w for w in wavelengths), values, label, absorption=absorption, thermal=thermal)


def bundled_thermal(medium: Medium) -> Thermal | None:
    """Return what SCHOTT says about heat, of a glass of the bundled table; None of others."""
    glass = glasses_of("schott").get(plain_glass_name(medium.name)) if GLASSES.get(medium.name) == medium else None
    return _thermal(_row(glass)) if glass is not None else None


def _row(glass: MakersGlass) -> dict[str, Any]:
    text = _text(glass.maker)
    start = text.index(f'{{"name":"{glass.name}"')
    row: dict[str, Any] = json.loads(text[start : text.index("\n", start)])
    return row


def _thermal(row: dict[str, Any]) -> Thermal | None:
    """Return what a row says about heat, None when it says nothing."""
    if "thermal" not in row and "expansion" not in row:
        return None
    dispersion = tuple(row["thermal"]) if "thermal" in row else None
    return Thermal(dispersion, row.get("expansion"), row.get("temperature_c", STANDARD_C))


def _absorption(row: dict[str, Any]) -> Absorption | None:
    """Return 4 pi k / wavelength of a table of extinction coefficients, None without one."""
    table = row.get("k")
    if not table or len(table) < 2:
        return None
    values = np.array(table)
    per_mm = 4e3 * np.pi * values[:, 1] / values[:, 0]
    return Absorption(tuple((1e3 * values[:, 0]).tolist()), tuple(per_mm.tolist()))


@lru_cache(maxsize=len(MAKERS))
def _text(maker: str) -> str:
    path = glass_catalogues_dir() / f"{maker}.jsonl"
    try:
        return path.read_text("utf-8")
    except OSError as problem:
        raise StateError(f"{path}: the installation is incomplete ({problem.strerror}); reinstall it") from problem
