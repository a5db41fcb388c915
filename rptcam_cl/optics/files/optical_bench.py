"""Lens files of the Photons to Photos Optical Bench (.txt): tab-separated sections, zoom states in columns."""

from __future__ import annotations

from dataclasses import replace
from math import isinf
from typing import Any

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.files.table import LensTable, numbers
from rptcam_cl.optics.focus import film_distance
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.prescription import FocusState
from rptcam_cl.optics.variable import configured

ROUNDED_MM = 0.003  # of a sum of gaps
OF_CALCULATION = 0.05  # of the gap that changes most: by so much a back focus may be beside that which stays
SHARP = 0.1  # of the way of the image from infinity: by so much a near state may be beside the film
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
    return _with_sharp_states(table.lens(), path)


def _with_sharp_states(lens: Lens, path: str) -> Lens:
    """Return the lens without the film shifts of near states that are not sharp there; the film then follows the image.

    A state that is far from sharp was not meant so, or the file counts its film from elsewhere.
    """
    blurred = False

    def checked(at_infinity: Lens, states: tuple[FocusState, ...]) -> tuple[FocusState, ...]:
        nonlocal blurred
        if all(_is_sharp(at_infinity, state) for state in states):
            return states
        blurred = True
        return tuple(replace(state, film_shift_mm=None) for state in states)

    configurations = tuple(
        replace(each, floating=checked(configured(lens, each.name), each.floating)) for each in lens.configurations
    )
    lens = replace(lens, configurations=configurations)
    lens = (
        configured(lens, configurations[0].name)
        if configurations
        else replace(lens, floating=checked(lens, lens.floating))
    )
    note = f"{path}: its close focus is not sharp where it has the film, which follows the image instead"
    return lens.with_warnings((note,)) if blurred else lens


def _is_sharp(lens: Lens, state: FocusState) -> bool:
    """Return whether a near state has its image, to first order, about where it has the film."""
    if state.film_shift_mm is None:
        return True
    try:
        infinity = film_distance(lens, float("inf"))
        whole = film_distance(lens, state.distance_mm)
        surfaces = list(lens.surfaces)
        for k, gap in state.gaps:
            surfaces[k] = replace(surfaces[k], thickness=gap)
        near, film = replace(lens, surfaces=tuple(surfaces)), infinity + state.film_shift_mm
        front = state.distance_mm - near.length - film
        return abs(film_distance(near, front, "front") - film) <= SHARP * abs(whole - infinity)
    except InputError:
        return False


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
    zooms: list[dict[str, Any]] = []
    columns: list[int] = []
    near: list[int] = []
    for column in range(max(len(distances[name]) for name in gaps.values())):
        values = _gaps_of(gaps, distances, column)
        if any(value is None for value in values.values()):
            continue
        if _is_near(distances, column):
            near.append(column)
        else:
            zooms.append({"name": _label(distances, column), "gaps": values})
            columns.append(column)
    names = [state["name"] for state in zooms]
    for i, state in enumerate(zooms):
        if names.count(state["name"]) > 1:
            state["name"] = f"{state['name']} ({i + 1})"
    states: dict[int, list[dict[str, Any]]] = {}
    unread = False
    for place, column in enumerate(near):
        far = _far_column(place, column, near, columns, gaps, distances)
        found = None if far is None else _near_state(table, gaps, distances, column, far)
        if far is None or found is None:
            unread = unread or len(zooms) > 1
        else:
            states.setdefault(far, []).append(found)
    if len(zooms) > 1:
        for state, column in zip(zooms, columns, strict=True):
            if column in states:
                state["floating"] = states[column]
        table.keys["configurations"] = zooms
    elif zooms and columns[0] in states:
        table.keys["floating"] = states[columns[0]]
    if unread:
        table.notes.append(
            f"{table.path}: nothing says to which position its close focus belongs: close focus of a zoom"
            " lens is not read, and the whole lens moves to focus"
        )


def _gaps_of(gaps: dict[int, str], distances: dict[str, list[str]], column: int) -> dict[int, float | None]:
    return {k: _value(distances[name], column) for k, name in gaps.items()}


def _far_column(
    place: int,
    column: int,
    near: list[int],
    far: list[int],
    gaps: dict[int, str],
    distances: dict[str, list[str]],
) -> int | None:
    """Return the column at infinity of the same zoom position: most gaps are the same; else they stand in order."""
    if len(far) < 2:
        return far[0] if far else None
    own = _gaps_of(gaps, distances, column)
    same = [sum(own[k] == gap for k, gap in _gaps_of(gaps, distances, other).items()) for other in far]
    if same.count(max(same)) == 1:
        return far[same.index(max(same))]
    return far[place] if len(near) == len(far) else None


def _near_state(
    table: LensTable, gaps: dict[int, str], distances: dict[str, list[str]], column: int, far: int
) -> dict[str, Any] | None:
    """Return a state of focus of a column, `far` being that at infinity; None where it does not say how near it is."""
    away, back = (_value(distances.get(name, []), column) for name in ("d0", "Bf"))
    if away is None or back is None or isinf(away):
        return None
    shift = _film_shift(gaps, distances, column, far)
    film = back if shift is None else (_value(distances["Bf"], far) or 0.0) + shift
    own = _gaps_of(gaps, distances, column)
    fixed = sum(float(row["thickness"]) for k, row in enumerate(table.rows) if "thickness" in row and k not in gaps)
    state = {"distance": away + fixed + sum(value or 0.0 for value in own.values()) + film, "gaps": own}
    return state if shift is None else state | {"film_shift": shift}


def _film_shift(gaps: dict[int, str], distances: dict[str, list[str]], column: int, far: int) -> float | None:
    """Return how much farther the film is from the last vertex than at infinity, None where it is not said.

    Where the total length says that the first vertex stays, and where no vertex moves against another, small
    differences of the back focus are those of its calculation.
    """
    backs = [_value(distances.get("Bf", []), k) for k in (far, column)]
    if None in backs:
        return None
    changes = [
        (new or 0.0) - (old or 0.0)
        for new, old in zip(
            _gaps_of(gaps, distances, column).values(), _gaps_of(gaps, distances, far).values(), strict=True
        )
    ]
    longer, most = sum(changes), max(map(abs, changes))
    found = float(backs[1] or 0.0) - float(backs[0] or 0.0)
    lengths = [_value(distances.get("Total Length", []), k) for k in (far, column)]
    said = None if None in lengths else float(lengths[1] or 0.0) - float(lengths[0] or 0.0) - longer
    if said is None and abs(longer) <= ROUNDED_MM:
        said = 0.0
    return said if said is not None and abs(said - found) <= OF_CALCULATION * most else found


def _is_near(distances: dict[str, list[str]], column: int) -> bool:
    """Return whether a column is a state of focus nearer than infinity: by its object distance d0 or magnification."""
    away = _value(distances.get("d0", []), column)
    return bool(_value(distances.get("Magnification", []), column)) or (away is not None and not isinf(away))


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
