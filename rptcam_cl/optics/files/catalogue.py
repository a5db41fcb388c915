"""Glass from catalogue files: Zemax .agf, and single materials of refractiveindex.info (.yml)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from rptcam_cl.errors import InputError, StateError
from rptcam_cl.optics.glass import Medium, PowerSeries, Sellmeier, TabulatedIndex
from rptcam_cl.strict_yaml import read_yaml

Formula = Callable[[list[float], tuple[float, float], str], Medium]

SCHOTT, SELLMEIER_1, EXTENDED, SELLMEIER_5, EXTENDED_2, EXTENDED_3 = 1, 2, 10, 11, 12, 13
POWERS: dict[int, tuple[int, ...]] = {
    SCHOTT: (0, 2, -2, -4, -6, -8),
    EXTENDED: (0, 2, -2, -4, -6, -8, -10, -12),
    EXTENDED_2: (0, 2, -2, -4, -6, -8, 4, 6),
    EXTENDED_3: (0, 2, 4, -2, -4, -6, -8, -10, -12),
}


def read_agf(path: Path | str) -> dict[str, Medium]:
    """Return the glasses of a catalogue by name. Those with a formula that is not known are left out.

    Known: Schott (1), Sellmeier 1 (2), Sellmeier 3 and 5 (6, 11), extended 1 to 3 (10, 12, 13).
    """
    glasses: dict[str, Medium] = {}
    name, formula = "", 0
    terms: list[float] = []
    limits: tuple[float, float] | None = None
    for line, raw in enumerate(_text(Path(path)).splitlines(), start=1):
        words = raw.split()
        if not words:
            continue
        try:
            if words[0] == "NM":
                _add(glasses, name, formula, terms, limits)
                name, formula, terms, limits = words[1], int(float(words[2])), [], None
            elif words[0] == "CD":
                terms = [float(word) for word in words[1:]]
            elif words[0] == "LD":
                limits = (1e3 * float(words[1]), 1e3 * float(words[2]))
        except (IndexError, ValueError):
            raise InputError(f"{path}:{line}: cannot read this {words[0]} line of a glass catalogue") from None
    _add(glasses, name, formula, terms, limits)
    if not glasses:
        raise InputError(f"{path}: no glass with a known formula; is this a Zemax glass catalogue?")
    return glasses


def _add(
    glasses: dict[str, Medium], name: str, formula: int, terms: list[float], limits: tuple[float, float] | None
) -> None:
    if not name or not terms:
        return
    if formula in POWERS:
        powers = POWERS[formula]
        series = tuple((float(p), a) for p, a in zip(powers, terms, strict=False) if a)
        glasses[name] = PowerSeries(series, True, limits, name)
    elif formula in (SELLMEIER_1, 6, SELLMEIER_5):
        pairs = [(b, c) for b, c in zip(terms[::2], terms[1::2], strict=False) if b]
        glasses[name] = Sellmeier(tuple(b for b, _ in pairs), tuple(c for _, c in pairs), 0.0, limits, name)


def read_refractive_index(path: Path | str) -> Medium:
    """Return the medium of a refractiveindex.info file: formulas 1, 2, 3 and 5, or tabulated n (or n and k)."""
    document = read_yaml(Path(path))
    data = document.data
    blocks = data.get("DATA") if isinstance(data, dict) else None
    if not isinstance(blocks, list) or not blocks:
        raise InputError(f"{path}: no DATA list; is this a file of refractiveindex.info?")
    name = Path(path).stem
    for block in blocks:
        kind = str(block.get("type", "")).strip() if isinstance(block, dict) else ""
        try:
            if kind in _FORMULAS:
                terms = [float(word) for word in str(block["coefficients"]).split()]
                low, high = (1e3 * float(word) for word in str(block["wavelength_range"]).split())
                return _FORMULAS[kind](terms, (low, high), name)
            if kind in ("tabulated n", "tabulated nk"):
                rows = np.array(
                    [[float(w) for w in line.split()[:2]] for line in block["data"].splitlines() if line.strip()]
                )
                return TabulatedIndex(tuple((1e3 * rows[:, 0]).tolist()), tuple(rows[:, 1].tolist()), name)
        except (KeyError, ValueError, IndexError):
            raise InputError(f"{path}: cannot read the block of type {kind!r}") from None
    kinds = ", ".join(repr(str(block.get("type"))) for block in blocks if isinstance(block, dict))
    raise InputError(f"{path}: no dispersion formula that is known (has {kinds}; known: {', '.join(_FORMULAS)})")


def _formula_1(terms: list[float], limits: tuple[float, float], name: str) -> Medium:
    return Sellmeier(tuple(terms[1::2]), tuple(c * c for c in terms[2::2]), terms[0], limits, name)


def _formula_2(terms: list[float], limits: tuple[float, float], name: str) -> Medium:
    return Sellmeier(tuple(terms[1::2]), tuple(terms[2::2]), terms[0], limits, name)


def _polynomial(squared: bool) -> Formula:
    def build(terms: list[float], limits: tuple[float, float], name: str) -> Medium:
        pairs = zip(terms[2::2], terms[1::2], strict=True)
        return PowerSeries(((0.0, terms[0]), *((power, a) for power, a in pairs)), squared, limits, name)

    return build


_FORMULAS: dict[str, Formula] = {
    "formula 1": _formula_1,
    "formula 2": _formula_2,
    "formula 3": _polynomial(True),
    "formula 5": _polynomial(False),
}


def _text(path: Path) -> str:
    try:
        raw = path.read_bytes()
    except OSError as problem:
        raise StateError(f"{path}: cannot be read ({problem.strerror})") from problem
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return raw.decode("utf-16", "replace")
    return raw.decode("utf-8-sig", "replace")
