"""Glass from catalogue files: Zemax .agf, and single materials of refractiveindex.info (.yml)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.references import read_whole
from rptcam_cl.core.strict_yaml import read_yaml
from rptcam_cl.optics.absorption import Absorption
from rptcam_cl.optics.glass import Law, PowerSeries, Sellmeier, TabulatedIndex
from rptcam_cl.optics.thermal import STANDARD_C, Thermal

Formula = Callable[[list[float], tuple[float, float], str], Law]

SCHOTT, SELLMEIER_1, EXTENDED, SELLMEIER_5, EXTENDED_2, EXTENDED_3 = 1, 2, 10, 11, 12, 13
LARGEST_FILE = 16_000_000  # bytes; all catalogues of Zemax in one file have 2 MB

POWERS: dict[int, tuple[int, ...]] = {
    SCHOTT: (0, 2, -2, -4, -6, -8),
    EXTENDED: (0, 2, -2, -4, -6, -8, -10, -12),
    EXTENDED_2: (0, 2, -2, -4, -6, -8, 4, 6),
    EXTENDED_3: (0, 2, 4, -2, -4, -6, -8, -10, -12),
}


def read_agf(path: Path | str) -> dict[str, Law]:
    """Return the glasses of a catalogue file by name, as `glasses_of_agf` does.

    Raises
    ------
    InputError
        When it is not a regular file of bearable size, or holds no glass that is known.
    StateError
        When it cannot be read.
    """
    try:
        return glasses_of_agf(read_whole(Path(path), LARGEST_FILE), path)
    except StateError as problem:
        raise StateError(f"{path}: {problem}") from None


def glasses_of_agf(content: bytes, path: Path | str) -> dict[str, Law]:
    """Return the glasses of a catalogue by name. Those with a formula that is not known are left out.

    Known: Schott (1), Sellmeier 1 (2), Sellmeier 3 and 5 (6, 11), extended 1 to 3 (10, 12, 13). Lines IT (wavelength in
    um, internal transmittance, thickness in mm) say what a glass absorbs.

    Parameters
    ----------
    content : bytes
        Of the file.
    path : Path or str
        What errors call it.
    """
    glasses: dict[str, Law] = {}
    name, formula = "", 0
    terms: list[float] = []
    inside: list[tuple[float, float, float]] = []
    thermal = Thermal()
    limits: tuple[float, float] | None = None
    for line, raw in enumerate(_text(content).splitlines(), start=1):
        words = raw.split()
        if not words:
            continue
        try:
            if words[0] == "NM":
                _add(glasses, name, formula, terms, limits, inside, thermal)
                name, formula, terms, limits, inside = words[1], int(float(words[2])), [], None, []
                thermal = Thermal()
            elif words[0] == "CD":
                terms = [float(word) for word in words[1:]]
            elif words[0] == "LD":
                limits = (1e3 * float(words[1]), 1e3 * float(words[2]))
            elif words[0] == "ED" and float(words[1]) != 0:
                thermal = replace(thermal, expansion_per_k=1e-6 * float(words[1]))
            elif words[0] == "TD" and len(words) > 6:
                values, reference = [float(word) for word in words[1:7]], float(words[7] if words[7:] else STANDARD_C)
                thermal = replace(thermal, dispersion=tuple(values) if any(values) else None, reference_c=reference)
            elif words[0] == "IT" and len(words) > 3:
                inside.append((1e3 * float(words[1]), float(words[2]), float(words[3])))
        except (IndexError, ValueError, OverflowError):
            raise InputError(f"{path}:{line}: cannot read this {words[0]} line of a glass catalogue") from None
    _add(glasses, name, formula, terms, limits, inside, thermal)
    if not glasses:
        raise InputError(f"{path}: no glass with a known formula; is this a Zemax glass catalogue?")
    return glasses


def _add(
    glasses: dict[str, Law],
    name: str,
    formula: int,
    terms: list[float],
    limits: tuple[float, float] | None,
    inside: list[tuple[float, float, float]],
    thermal: Thermal,
) -> None:
    """Add a glass; `inside` has wavelength [nm], internal transmittance and thickness [mm] in rows."""
    if not name or not terms:
        return
    absorption, heat = _absorption(inside), None if thermal == Thermal() else thermal
    if formula in POWERS:
        powers = POWERS[formula]
        series = tuple((float(p), a) for p, a in zip(powers, terms, strict=False) if a)
        glasses[name] = PowerSeries(series, True, limits, name, absorption=absorption, thermal=heat)
    elif formula in (SELLMEIER_1, 6, SELLMEIER_5):
        pairs = [(b, c) for b, c in zip(terms[::2], terms[1::2], strict=False) if b]
        b, c = tuple(b for b, _ in pairs), tuple(c for _, c in pairs)
        glasses[name] = Sellmeier(b, c, 0.0, limits, name, absorption=absorption, thermal=heat)


def _absorption(inside: list[tuple[float, float, float]]) -> Absorption | None:
    """Return what rows of wavelength, transmittance and thickness say, None when no two of them say anything."""
    rows = sorted({row[0]: row for row in inside if row[2] > 0 and 0 <= row[1] <= 1}.values())
    return Absorption.from_transmittance(*zip(*rows, strict=True)) if len(rows) > 1 else None


def read_refractive_index(path: Path | str, content: bytes | None = None) -> Law:
    """Return the medium of a refractiveindex.info file: formulas 1, 2, 3 and 5, or tabulated n; k when there is one.

    Parameters
    ----------
    path : Path or str
        The file.
    content : bytes, optional
        What it holds, where that is known.
    """
    document = read_yaml(Path(path) if content is None else content, str(path))
    data = document.data
    blocks = data.get("DATA") if isinstance(data, dict) else None
    if not isinstance(blocks, list) or not blocks:
        raise InputError(f"{path}: no DATA list; is this a file of refractiveindex.info?")
    name = Path(path).stem
    absorption = _extinction(path, blocks)
    for block in blocks:
        kind = _kind(block)
        try:
            if kind in _FORMULAS:
                terms = [float(word) for word in str(block["coefficients"]).split()]
                low, high = (1e3 * float(word) for word in str(block["wavelength_range"]).split())
                return replace(_FORMULAS[kind](terms, (low, high), name), absorption=absorption)
            if kind in ("tabulated n", "tabulated nk"):
                rows = _rows(block, 2)
                wavelengths = tuple((1e3 * rows[:, 0]).tolist())
                return TabulatedIndex(wavelengths, tuple(rows[:, 1].tolist()), name, absorption=absorption)
        except (KeyError, ValueError, IndexError):
            raise InputError(f"{path}: cannot read the block of type {kind!r}") from None
    kinds = ", ".join(repr(str(block.get("type"))) for block in blocks if isinstance(block, dict))
    raise InputError(f"{path}: no dispersion formula that is known (has {kinds}; known: {', '.join(_FORMULAS)})")


def law_of_formula(kind: str, terms: list[float], limits: tuple[float, float], name: str) -> Law:
    """Return the law of a formula of refractiveindex.info, such as "formula 2", its range in nm."""
    return _FORMULAS[kind](terms, limits, name)


def _kind(block: Any) -> str:
    return str(block.get("type", "")).strip() if isinstance(block, dict) else ""


def _rows(block: Any, columns: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the first columns of a table."""
    return np.array([[float(w) for w in line.split()[:columns]] for line in block["data"].splitlines() if line.strip()])


def _extinction(path: Path | str, blocks: list[Any]) -> Absorption | None:
    """Return the absorption 4 pi k / L of a tabulated extinction coefficient k, None without one."""
    for block in blocks:
        kind = _kind(block)
        if kind in ("tabulated k", "tabulated nk"):
            try:
                rows = _rows(block, 2 if kind == "tabulated k" else 3)
                per_mm = 4e3 * np.pi * rows[:, -1] / rows[:, 0]
                return Absorption(tuple((1e3 * rows[:, 0]).tolist()), tuple(per_mm.tolist()))
            except (KeyError, ValueError, IndexError):
                raise InputError(f"{path}: cannot read the block of type {kind!r}") from None
    return None


def _formula_1(terms: list[float], limits: tuple[float, float], name: str) -> Law:
    _check_pairs(terms)
    return Sellmeier(tuple(terms[1::2]), tuple(c * c for c in terms[2::2]), terms[0], limits, name)


def _check_pairs(terms: list[float]) -> None:
    if len(terms) % 2 == 0:
        raise ValueError("a constant and pairs of strength and resonance are expected")


def _formula_2(terms: list[float], limits: tuple[float, float], name: str) -> Law:
    _check_pairs(terms)
    return Sellmeier(tuple(terms[1::2]), tuple(terms[2::2]), terms[0], limits, name)


def _polynomial(squared: bool) -> Formula:
    def build(terms: list[float], limits: tuple[float, float], name: str) -> Law:
        pairs = zip(terms[2::2], terms[1::2], strict=True)
        return PowerSeries(((0.0, terms[0]), *((power, a) for power, a in pairs)), squared, limits, name)

    return build


_FORMULAS: dict[str, Formula] = {
    "formula 1": _formula_1,
    "formula 2": _formula_2,
    "formula 3": _polynomial(True),
    "formula 5": _polynomial(False),
}


def _text(raw: bytes) -> str:
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return raw.decode("utf-16", "replace")
    return raw.decode("utf-8-sig", "replace")
