"""What the readers of other programs' lens files build: rows in our own form, with notes on what was left out."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rptcam_cl.errors import InputError
from rptcam_cl.optics.files.native import document_of, read_native
from rptcam_cl.optics.first_order import limiting_surface, system_matrix
from rptcam_cl.optics.glass_table import GLASSES
from rptcam_cl.optics.lens import Lens

UNKNOWN_DIAMETER = 1e-6  # small enough for every shape while first-order data are computed
RIM = 1.05  # clear diameters that a file does not give leave this margin around the beam


@dataclass
class Table:
    """A lens file under construction.

    Attributes
    ----------
    path : str
        File name, for messages.
    name : str
    unit : str
    rows : list of mappings
        Surfaces as in our own form; a missing diameter is worked out from the pupil and the field.
    keys : mapping
        Further top-level keys of our own form.
    notes : list of str
        One line for each thing that was ignored or guessed.
    pupil_diameter, f_number, field_degrees : float or None
        What the file says about the beam, in its unit.
    """

    path: str
    name: str = ""
    unit: str = "mm"
    rows: list[dict[str, Any]] = field(default_factory=list)
    keys: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    pupil_diameter: float | None = None
    f_number: float | None = None
    field_degrees: float = 0.0

    def note(self, line: int, text: str) -> None:
        """Remember what was ignored on a line."""
        self.notes.append(f"{self.path}:{line}: {text}")

    def lens(self) -> Lens:
        """Return the lens, its notes among the warnings."""
        if not self.rows:
            raise InputError(f"{self.path}: a lens needs surfaces; the file has none")
        if any("diameter" not in row for row in self.rows):
            self._fill_diameters()
        rows = [{k: v for k, v in row.items() if v is not None} for row in self.rows]
        document = document_of({"name": self.name or self.path, "unit": self.unit, "surfaces": rows, **self.keys})
        lens = read_native(type(document)(document.data, self.path, {}, {}))
        return lens.with_warnings(tuple(self.notes))

    def _fill_diameters(self) -> None:
        """Give surfaces without a diameter that of the axial beam and the chief ray of the field, to first order."""
        tiny = [{**row, "diameter": UNKNOWN_DIAMETER} for row in self.rows]
        lens = read_native(document_of({"name": self.path, "surfaces": tiny}))
        stop = limiting_surface(lens)
        to_stop = system_matrix(lens, 587.5618, 0, stop, False)
        half_pupil = self._half_pupil(lens)
        slope = np.tan(np.radians(self.field_degrees))
        chief = -to_stop[0, 1] * slope / to_stop[0, 0]
        missing = [k for k, row in enumerate(self.rows) if "diameter" not in row]
        for k in missing:
            row = self.rows[k]
            (a, b), _ = system_matrix(lens, 587.5618, 0, k, False).tolist()
            height = abs(a * half_pupil) + (0.0 if row.get("stop") else abs(a * chief + b * slope))
            height *= 1.0 if row.get("stop") else RIM
            if row.get("radius") and not row.get("conic") and not row.get("aspheric"):
                height = min(height, 0.95 * abs(row["radius"]))
            row["diameter"] = 2 * height
        for k in missing:
            for one, other in ((k - 1, k), (k, k + 1)):
                if one >= 0 and other < len(self.rows):
                    self._uncross(self.rows[k], self.rows[one], self.rows[other])
        self.notes.append(f"{self.path}: diameters that the file does not give were chosen for its pupil and field")

    @staticmethod
    def _uncross(chosen: dict[str, Any], first: dict[str, Any], second: dict[str, Any]) -> None:
        """Shrink a chosen diameter until two neighbouring surfaces do not cross inside it."""
        if first.get("stop") or second.get("stop"):
            return
        while chosen["diameter"] > 0:
            height = min(first["diameter"], second["diameter"]) / 2
            if first["thickness"] + _sag(second, height) - _sag(first, height) >= 0:
                return
            chosen["diameter"] = min(chosen["diameter"], 2 * height) * 0.98

    def _half_pupil(self, lens: Lens) -> float:
        if self.pupil_diameter:
            return self.pupil_diameter / 2
        if self.f_number:
            return abs(lens.first_order().focal_length_mm) / self.f_number / 2
        raise InputError(f"{self.path}: gives no diameters, and no pupil or f-number to work them out from")


def _sag(row: dict[str, Any], height: float) -> float:
    """Return the sag of a surface's sphere [file units]."""
    c = 1.0 / row["radius"] if row.get("radius") else 0.0
    return float(c * height**2 / (1.0 + np.sqrt(max(1.0 - (c * height) ** 2, 0.0))))


def plain_glass_name(name: str) -> str:
    """Return a glass name without hyphens, blanks, catalogue suffix and case: ``NBK7_SCHOTT`` and ``N-BK7`` agree."""
    return re.sub(r"[-\s]", "", name.split("_")[0]).upper()


def glass_entry(name: str, index: float | None, abbe: float | None) -> Any:
    """Return the `glass` entry for a name, or for index and Abbe number when the name is not known; None if neither."""
    wanted = plain_glass_name(name)
    for known in GLASSES:
        if wanted and plain_glass_name(known) in (wanted, "N" + wanted):
            return known
    if index is None or index <= 1:
        return None
    return {"nd": index, "vd": abbe} if abbe and abbe > 0 else {"index": index}


def six_digit_glass(code: str) -> Any:
    """Return the `glass` entry of a code such as 517.642 or 517642: n_d = 1.517, V_d = 64.2; None for other text."""
    match = re.fullmatch(r"(\d{3})\.?(\d{3})", code)
    return {"nd": 1 + int(match[1]) / 1000, "vd": int(match[2]) / 10} if match else None


def numbers(words: list[str], path: str, line: int) -> list[float]:
    """Return words as finite numbers, or say where one is not."""
    try:
        values = [float(word.replace("D", "E").replace("d", "e")) for word in words]
    except ValueError as error:
        raise InputError(f"{path}:{line}: expected numbers ({error})") from None
    return values
