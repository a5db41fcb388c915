"""Private glasses of a CODE V sequence: PRV, wavelengths behind PWL, indices or a law behind each name, END."""

from __future__ import annotations

from typing import Any

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.files.table import model_glass, numbers
from rptcam_cl.optics.glass import AbbeCauchy

OF_THE_MODEL = 1e-9  # by which indices follow the n_d and V_d of their name


def is_private_end(key: str) -> bool:
    """Return whether a word ends the private glasses."""
    return key == "END"


def private_glasses(statements: list[tuple[int, list[str]]], path: str) -> dict[str, Any]:
    """Return the `glass` entries of the private glasses of a sequence by their names, in capitals."""
    glasses: dict[str, Any] = {}
    wavelengths: list[float] = []
    inside = False
    for line, words in statements:
        key, rest = words[0].upper(), words[1:]
        if key == "PRV":
            inside = True
        elif inside and is_private_end(key):
            inside = False
        elif inside and key == "PWL":
            wavelengths = numbers(rest, path, line, 1)
        elif inside:
            name = words[0].strip("'\"")
            glasses[name.upper()] = _entry(name, rest, wavelengths, path, line)
    return glasses


def _entry(name: str, rest: list[str], wavelengths: list[float], path: str, line: int) -> dict[str, Any]:
    """Return indices at the wavelengths, or Laurent's series (LAU): n^2 = a0 + a1 L^2 + a2 / L^2 + ... + a5 / L^8."""
    if rest and rest[0].upper() == "LAU":
        terms = numbers(rest[1:], path, line, 1)
        return {"schott": [*terms, 0.0, 0.0, 0.0, 0.0, 0.0][:6], "name": name}
    if rest and rest[0].isalpha():
        raise InputError(f"{path}:{line}: the law {rest[0]} of the private glass {name} is unknown (known: LAU)")
    values = numbers(rest, path, line, 1)
    if len(values) != len(wavelengths):
        raise InputError(
            f"{path}:{line}: the private glass {name} needs one index for each wavelength "
            f"({len(values)} for {len(wavelengths)})"
        )
    rows = sorted(dict(zip(wavelengths, values, strict=True)).items())
    if len(set(values)) == 1:
        return {"index": rows[0][1]} if ":" in name else {"index": rows[0][1], "name": name}
    known = model_glass(name) if ":" in name else None
    if known and "vd" in known:
        law = AbbeCauchy(**known).index([w for w, _ in rows])
        if max(abs(n - found) for (_, n), found in zip(rows, law, strict=True)) < OF_THE_MODEL:
            return dict(known)  # what it is called says it exactly
    return {"table": {"wavelengths_nm": [w for w, _ in rows], "values": [n for _, n in rows]}, "name": name}
