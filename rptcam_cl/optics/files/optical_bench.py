"""Lens files of the Photons to Photos Optical Bench (.txt): tab-separated sections, zoom states in columns."""

from __future__ import annotations

from collections.abc import Mapping
from math import isinf
from typing import Any

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.files.table import LensTable, numbers
from rptcam_cl.optics.lens import Lens

SECTIONS = ("descriptive data", "constants", "variable distances", "lens data", "aspherical data")


def is_optical_bench(text: str) -> bool:
    """Return whether a text has the section that holds the surfaces."""
    return "[lens data]" in text.lower()


def read_optical_bench(text: str, path: str) -> Lens:
    """Return the lens of an Optical Bench text, in its first state; its other states are configurations."""
    sections = _sections(text)
    table = LensTable(path)
    for _, words in sections.get("descriptive data", []):
        if words[0].lower() == "title" and len(words) > 1:
            table.name = words[1]
    distances = {words[0]: words[1:] for _, words in sections.get("variable distances", [])}
    table.f_number = _value(distances.get("F-Number", []), 0)
    gaps = _surfaces(table, sections.get("lens data", []), distances)
    constants = {words[0].lower(): words[1:] for _, words in sections.get("constants", [])}
    _aspheres(table, sections.get("aspherical data", []), constants, sections.get("lens data", []))
    published = {"focal_length_mm": _value(distances.get("Focal Length", []), 0), "f_number": table.f_number}
    table.keys["published"] = {key: value for key, value in published.items() if value}
    _configurations(table, gaps, distances)
    return table.lens()


def _sections(text: str) -> dict[str, list[tuple[int, list[str]]]]:
    """Return the lines of each section as words, with their line numbers."""
    sections: dict[str, list[tuple[int, list[str]]]] = {}
    current: list[tuple[int, list[str]]] = []
    for number, line in enumerate(text.lstrip("\ufeff").splitlines(), start=1):
        bare = line.strip()
        if not bare or bare.startswith("#"):
            continue
        if bare.startswith("["):
            current = sections.setdefault(bare.split("]")[0][1:].strip().lower(), [])
            continue
        words = [word.strip() for word in line.rstrip().split("\t")]
        current.append((number, words))
    return sections


def _surfaces(table: LensTable, lines: list[tuple[int, list[str]]], distances: dict[str, list[str]]) -> dict[int, str]:
    """Fill the rows of the table; return the names of the gaps that vary."""
    gaps: dict[int, str] = {}
    for place, (line, words) in enumerate(lines):
        words = [*words, "", "", "", "", "", ""]
        label, radius, gap, index, diameter, abbe, glass = words[:7]
        row: dict[str, Any] = {}
        if radius.upper() == "AS":
            row["stop"] = True
        elif radius.lower() not in ("infinity", "inf", "fs", "cg", "0"):
            row["radius"] = _number(radius, table.path, line, f"radius of surface {label}")
        if place < len(lines) - 1:
            if gap in distances:
                gaps[place] = gap
                gap = distances[gap][0] if distances[gap] else ""
            row["thickness"] = _number(gap, table.path, line, f"thickness behind surface {label}")
        if diameter:
            row["diameter"] = _number(diameter, table.path, line, f"diameter of surface {label}")
        if index and index not in ("1", "1.0"):
            nd = _number(index, table.path, line, f"index behind surface {label}")
            vd = numbers([abbe], table.path, line)[0] if abbe else 0.0
            row["glass"] = {"nd": nd, "vd": vd} if vd > 0 else {"index": nd}
        del glass
        table.rows.append(row)
    return gaps


def _aspheres(
    table: LensTable,
    lines: list[tuple[int, list[str]]],
    constants: dict[str, list[str]],
    surfaces: list[tuple[int, list[str]]],
) -> None:
    """Add conic constants and coefficients: even powers from 4, from 2 (AsphericalA2) or every power from 3 (odd)."""
    labels = [words[0] for _, words in surfaces]
    odd = "asphericaloddcount" in constants
    first, step = (3, 1) if odd else (2, 2) if "asphericala2" in constants else (4, 2)
    for line, words in lines:
        if words[0] not in labels:
            table.note(line, f"aspheric data for a surface {words[0]!r} that is not there")
            continue
        row = table.rows[labels.index(words[0])]
        conic, *terms = [_number(word or "0", table.path, line, "coefficient") for word in words[2:]] or [0.0]
        if conic:
            row["conic"] = conic
        aspheric = {first + step * i: value for i, value in enumerate(terms) if value}
        if aspheric:
            row["aspheric"] = aspheric


def _configurations(table: LensTable, gaps: dict[int, str], distances: dict[str, list[str]]) -> None:
    """Add the states whose gaps are all given: at infinity those of a zoom lens, nearer those of floating groups."""
    if not gaps:
        return
    zooms, near = [], []
    for column in range(max(len(distances[name]) for name in gaps.values())):
        values = {k: _value(distances[name], column) for k, name in gaps.items()}
        if any(value is None for value in values.values()):
            continue
        if not _is_near(distances, column):
            zooms.append({"name": _label(distances, column), "gaps": values})
        elif (distance := _object_to_film(table, values, distances, column)) is not None:
            near.append({"distance": distance, "gaps": values})
    names = [state["name"] for state in zooms]
    for i, state in enumerate(zooms):
        if names.count(state["name"]) > 1:
            state["name"] = f"{state['name']} ({i + 1})"
    if len(zooms) > 1:
        table.keys["configurations"] = zooms
    if near and len(zooms) == 1:
        table.keys["floating"] = near
    elif near:
        table.notes.append(f"{table.path}: close focus of a zoom lens is not read; the whole lens moves to focus")


def _is_near(distances: dict[str, list[str]], column: int) -> bool:
    """Return whether a column is a state of focus nearer than infinity: by its object distance d0 or magnification."""
    away = _value(distances.get("d0", []), column)
    return bool(_value(distances.get("Magnification", []), column)) or (away is not None and not isinf(away))


def _object_to_film(
    table: LensTable, gaps: Mapping[int, float | None], distances: dict[str, list[str]], column: int
) -> float | None:
    """Return the distance from object to film of a column, None where it does not say."""
    away, back = (_value(distances.get(name, []), column) for name in ("d0", "Bf"))
    if away is None or back is None or isinf(away):
        return None
    fixed = sum(float(row["thickness"]) for k, row in enumerate(table.rows) if "thickness" in row and k not in gaps)
    return away + fixed + sum(value or 0.0 for value in gaps.values()) + back


def _label(distances: dict[str, list[str]], column: int) -> str:
    length = _value(distances.get("Focal Length", []), column)
    if length:
        return f"{length:g} mm"
    magnification = _value(distances.get("Magnification", []), column)
    return f"magnification {magnification:g}" if magnification is not None else f"state {column + 1}"


def _value(words: list[str], column: int) -> float | None:
    try:
        return float(words[column])
    except (IndexError, ValueError):
        return None


def _number(word: str, path: str, line: int, what: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise InputError(f"{path}:{line}: {what}: expected a number (got {word!r})") from None
