"""Lens files of ISET (JSON): a list of surfaces with radius, thickness, ior and semi_aperture, in millimetres."""

from __future__ import annotations

from typing import Any

from rptcam_cl.errors import InputError
from rptcam_cl.optics.files.table import Table
from rptcam_cl.optics.lens import Lens
from rptcam_cl.strict_yaml import Document

KNOWN = {"radius", "thickness", "ior", "semi_aperture", "conic_constant", "aspheric_coefficients"}


def is_iset(document: Document) -> bool:
    """Return whether a document is in ISET's form and not in ours."""
    data = document.data
    rows = data.get("surfaces") if isinstance(data, dict) else None
    return isinstance(rows, list) and bool(rows) and isinstance(rows[0], dict) and "semi_aperture" in rows[0]


def read_iset(document: Document) -> Lens:
    """Return the lens of an ISET document. Radius 0 with ior 0 is the stop, as in pbrt tables."""
    table = Table(document.name, name=str(document.data.get("name") or document.name))
    rows = document.data["surfaces"]
    for index, row in enumerate(rows):
        where = document.where(("surfaces", index))
        if not isinstance(row, dict):
            raise InputError(f"{where}: surfaces[{index}]: expected a mapping of keys to values")
        radius, ior = (_number(row, key, where, index) for key in ("radius", "ior"))
        entry: dict[str, Any] = {"diameter": 2 * _number(row, "semi_aperture", where, index)}
        if radius:
            entry["radius"] = radius
        elif ior == 0:
            entry["stop"] = True
        if index < len(rows) - 1:
            entry["thickness"] = _number(row, "thickness", where, index)
        if ior not in (0.0, 1.0):
            entry["glass"] = {"index": ior}
        if row.get("conic_constant"):
            entry["conic"] = _number(row, "conic_constant", where, index)
        for key in row.keys() - KNOWN:
            table.notes.append(f"{where}: surfaces[{index}].{key} is ignored")
        table.rows.append(entry)
    return table.lens()


def _number(row: dict[str, Any], key: str, where: str, index: int) -> float:
    value = row.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{where}: surfaces[{index}].{key}: expected a number (got {value!r})")
    return float(value)
