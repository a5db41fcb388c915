"""Lens files of ISET (JSON): a list of surfaces with radius, thickness, ior and semi_aperture, in millimetres."""

from __future__ import annotations

from typing import Any

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.strict_yaml import Document
from rptcam_cl.optics.files.table import LensTable
from rptcam_cl.optics.lens import Lens

KNOWN = {"radius", "thickness", "ior", "semi_aperture", "conic_constant", "aspheric_coefficients"}


def is_iset(document: Document) -> bool:
    """Return whether a document is in ISET's form and not in ours."""
    data = document.data
    rows = data.get("surfaces") if isinstance(data, dict) else None
    return isinstance(rows, list) and bool(rows) and isinstance(rows[0], dict) and "semi_aperture" in rows[0]


def is_ray_transfer(document: Document) -> bool:
    """Return whether a document is an ISET ray transfer: polynomials in place of a lens."""
    return isinstance(document.data, dict) and "surfaces" not in document.data and "polynomials" in document.data


def read_iset(document: Document, makers: tuple[str, ...] = ()) -> Lens:
    """Return the lens of an ISET document. Radius 0 with ior 0 is the stop, as in pbrt tables."""
    table = LensTable(document.name, name=str(document.data.get("name") or document.name), makers=makers)
    rows = document.data["surfaces"]
    for index, row in enumerate(rows):
        where = document.where(("surfaces", index))
        if not isinstance(row, dict):
            raise InputError(f"{where}: surfaces[{index}]: expected a mapping of keys to values")
        radius, (ior, glass) = _number(row, "radius", where, index), _medium(row, where, index, table)
        entry: dict[str, Any] = {"diameter": 2 * _number(row, "semi_aperture", where, index)}
        if radius:
            entry["radius"] = radius
        elif ior == 0:
            entry["stop"] = True
            glass = table.rows[-1].get("glass") if table.rows else None  # it lies in what is before it
        if index < len(rows) - 1:
            entry["thickness"] = _number(row, "thickness", where, index)
        if glass is not None:
            entry["glass"] = glass
        if row.get("conic_constant"):
            entry["conic"] = _number(row, "conic_constant", where, index)
        if (terms := row.get("aspheric_coefficients")) and any(terms if isinstance(terms, list) else [terms]):
            raise InputError(
                f"{where}: surfaces[{index}].aspheric_coefficients: the powers they belong to are not known; the lens"
                " would be wrong without them"
            )
        for key in row.keys() - KNOWN:
            table.notes.append(f"{where}: surfaces[{index}].{key} is ignored")
        table.rows.append(entry)
    return table.lens()


def _medium(row: dict[str, Any], where: str, index: int, table: LensTable) -> tuple[float, Any]:
    """Return the index of a row and its `glass` entry: a number, a name, or wavelengths [nm] and indices."""
    value = row.get("ior")
    if isinstance(value, str):
        return 1.0, None if value.upper() == "AIR" else table.glass(value, 1)
    if not isinstance(value, list):
        ior = _number(row, "ior", where, index)
        return ior, None if ior in (0.0, 1.0) else {"index": ior}
    if len(value) != 2 or not all(isinstance(part, list) and part for part in value) or len(value[0]) != len(value[1]):
        raise InputError(f"{where}: surfaces[{index}].ior: expected a list of wavelengths and one of as many indices")
    wavelengths, values = value
    if not all(isinstance(v, int | float) and not isinstance(v, bool) for v in (*wavelengths, *values)):
        raise InputError(f"{where}: surfaces[{index}].ior: expected numbers")
    if all(v == 1 for v in values):
        return 1.0, None
    rows = sorted(dict(zip(wavelengths, values, strict=True)).items())
    return 1.0, {"table": {"wavelengths_nm": [float(w) for w, _ in rows], "values": [float(n) for _, n in rows]}}


def _number(row: dict[str, Any], key: str, where: str, index: int) -> float:
    value = row.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{where}: surfaces[{index}].{key}: expected a number (got {value!r})")
    return float(value)
