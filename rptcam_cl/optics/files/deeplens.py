"""Lens files of DeepLens (JSON): surfaces with clear radius r, radius roc or curvature c, mat2 and d_next, in mm."""

from __future__ import annotations

import math
from typing import Any

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.strict_yaml import Document
from rptcam_cl.optics.files.table import LensTable
from rptcam_cl.optics.lens import Lens

STOPS = ("Aperture", "Stop")
SHAPES = ("Spheric", "Aspheric", "Plane")
EMPTY = ("air", "vacuum", "occluder")  # an occluder is a plate around an opening
# n_d and V_d of the materials of DeepLens that no catalogue has under their names
MATERIALS = {
    "coc": (1.5337, 56.22), "okp4": (1.6328, 23.34), "okp4ht": (1.6328, 23.34), "apl5014cl": (1.5445, 55.99),
    "hk51": (1.5501, 58.64), "flint": (1.62, 36.37),
}  # fmt: skip
LONGEST_RADIUS = 1e12


def is_deeplens(document: Document) -> bool:
    """Return whether a document is in DeepLens's form."""
    rows = document.data.get("surfaces") if isinstance(document.data, dict) else None
    return isinstance(rows, list) and bool(rows) and isinstance(rows[0], dict) and {"type", "d_next"} <= rows[0].keys()


def read_deeplens(document: Document, makers: tuple[str, ...] = ()) -> Lens:
    """Return the lens of a DeepLens document."""
    for key in ("DOE", "phase"):
        if key in document.data:
            raise InputError(f"{document.where((key,))}: {key}: a diffractive element cannot be read")
    info = document.data.get("info")
    table = LensTable(
        document.name, name=info if isinstance(info, str) and info != "None" else document.name, makers=makers
    )
    rows = document.data["surfaces"]
    for index in range(len(rows)):
        table.rows.append(_row(_Values(document, index), table, index == len(rows) - 1))
    stops = [row for row in table.rows if row.get("stop")]
    for row in stops[1:]:
        del row["stop"]
    return table.lens()


class _Values:
    """The values of one surface."""

    def __init__(self, document: Document, index: int) -> None:
        self.document, self.index = document, index
        self.row = document.data["surfaces"][index]
        if not isinstance(self.row, dict):
            raise self.fail("", "expected a mapping of keys to values")

    def fail(self, key: str, text: str) -> InputError:
        where = self.document.where(("surfaces", self.index, key) if key else ("surfaces", self.index))
        return InputError(f"{where}: surfaces[{self.index}]{'.' + key if key else ''}: {text}")

    def number(self, key: str, default: float | None = None) -> float:
        value = self.row.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise self.fail(key, f"expected a number (got {value!r})")
        return float(value)

    def text(self, key: str) -> str:
        value = self.row.get(key)
        if not isinstance(value, str):
            raise self.fail(key, f"expected text (got {value!r})")
        return value

    @property
    def line(self) -> int:
        return self.document.mark(("surfaces", self.index))[0]


def _row(values: _Values, table: LensTable, last: bool) -> dict[str, Any]:
    kind = values.text("type")
    if kind not in (*STOPS, *SHAPES):
        raise values.fail("type", f"a surface {kind} cannot be read; known: {', '.join((*STOPS, *SHAPES))}")
    row: dict[str, Any] = {"diameter": 2 * values.number("r")}
    if kind in STOPS:
        row["stop"] = True
    elif kind != "Plane" and (curvature := _curvature(values)):
        row["radius"] = 1 / curvature
    if not last:
        row["thickness"] = values.number("d_next")
    if (kind not in STOPS or "mat2" in values.row) and (medium := values.text("mat2").strip()).lower() not in EMPTY:
        nd, vd = MATERIALS.get(medium.lower(), (None, None))
        row["glass"] = {"nd": nd, "vd": vd} if nd else table.glass(medium, values.line)
    if kind == "Aspheric":
        row |= _asphere(values)
    if values.row.get("is_square"):
        table.note(values.line, "a square surface is read as the circle of its radius r")
    return row


def _curvature(values: _Values) -> float:
    """Return 1 / roc, which has more digits than c in some files, else c."""
    if "roc" in values.row:
        radius = values.number("roc")
        return 1 / radius if 0 < abs(radius) < LONGEST_RADIUS else 0.0
    return values.number("c", 0.0)


def _asphere(values: _Values) -> dict[str, Any]:
    """Return conic and coefficients: of `ai` the first belongs to r^2 unless `use_ai2` says no, the next to r^4."""
    found: dict[str, Any] = {}
    if conic := values.number("k", 0.0):
        found["conic"] = conic
    terms = values.row.get("ai", [])
    if not isinstance(terms, list) or not all(isinstance(t, int | float) and not isinstance(t, bool) for t in terms):
        raise values.fail("ai", "expected a list of numbers")
    first = 2 if values.row.get("use_ai2", True) else 4
    if aspheric := {first + 2 * i: float(term) for i, term in enumerate(terms) if term}:
        found["aspheric"] = aspheric
    return found
