"""Lens files that are tables: pbrt and CS348b, ISET, DeepLens, and the Photons to Photos Optical Bench."""

from __future__ import annotations

import math
from dataclasses import replace
from math import isinf
from typing import Any

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.strict_yaml import Document
from rptcam_cl.optics.files.lens_table import LensTable, numbers
from rptcam_cl.optics.files.native import check_lens
from rptcam_cl.optics.glass import AIR, ConstantIndex, Medium
from rptcam_cl.optics.lens import Lens, film_distance, in_configuration
from rptcam_cl.optics.surface import FocusState, Surface

#
# Lens tables of pbrt and of the CS348b assignments: radius, axial distance, index, diameter in four columns.
#
# Two conventions share the suffix. In newer files the second column is the thickness to the next row; in the older
# ones (`axpos`) it is the gap from the previous row. The gap before the first surface and after the last one are not
# part of a lens, so the older files start with 0 and the newer ones end with 0 or with the distance to the film.

COLUMNS = ("radius", "axial distance", "index", "diameter")


@dataclass(frozen=True)
class _Row:
    """Of a file; without a docstring `dataclasses` writes a signature, which takes it milliseconds."""

    line: int
    radius: float
    axial: float
    index: float
    diameter: float


def read_pbrt(text: str, name: str) -> Lens:
    """Return the lens of a four-column table; lengths in millimetres. A lone number before it is the focal length."""
    rows, focal_length = _rows(text, name)
    gaps = _gaps(rows, name)
    stop = _stop(rows, name)
    surfaces: tuple[Surface, ...] = ()
    for i, (row, gap) in enumerate(zip(rows, gaps, strict=True)):
        surfaces += (_surface(row, gap, i == stop, surfaces[-1].glass if surfaces else AIR, name),)
    published = {} if focal_length is None else {"focal_length_mm": focal_length}
    lens = Lens(name.rsplit("/", 1)[-1].removesuffix(".dat"), surfaces, stop, published=published)
    return check_lens(
        lens, lambda index, key, problem: InputError(f"{name}:{rows[index].line}: surface {index}, {key}: {problem}")
    )


def _rows(text: str, name: str) -> tuple[list[_Row], float | None]:
    rows: list[_Row] = []
    focal_length: float | None = None
    for number, raw in enumerate(text.lstrip("\ufeff").splitlines(), start=1):
        words = raw.split("#", 1)[0].replace(",", " ").split()
        if not words:
            continue
        if len(words) == 1 and not rows and focal_length is None and _is_number(words[0]):
            focal_length = float(words[0])  # ISET writes it so
            continue
        if len(words) != len(COLUMNS):
            raise InputError(f"{name}:{number}: expected 4 columns, {', '.join(COLUMNS)} (got {len(words)})")
        try:
            values = [float(word) for word in words]
        except ValueError as error:
            raise InputError(f"{name}:{number}: expected four numbers ({error})") from None
        if not all(map(math.isfinite, values)):
            raise InputError(f"{name}:{number}: every number must be finite (got {' '.join(words)})")
        rows.append(_Row(number, *values))
    if not rows:
        raise InputError(f"{name}: a lens needs surfaces; the table is empty")
    return rows, focal_length


def _is_number(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False


def _gaps(rows: list[_Row], name: str) -> list[float]:
    """Return the thickness after each row, whichever convention the table has."""
    axial = [row.axial for row in rows]
    to_next, from_previous = [*axial[:-1], 0.0], [*axial[1:], 0.0]
    if axial[0] != 0:
        return to_next
    if axial[-1] != 0:
        return from_previous
    if len(rows) > 2:
        raise InputError(
            f"{name}:{rows[0].line}: cannot tell whether the second column is the distance to the next row or from the "
            "previous one: it is 0 in the first row and in the last"
        )
    return to_next


def _stop(rows: list[_Row], name: str) -> int | None:
    """Return the row of the stop: radius 0 and index 0, else the one plane between two air spaces."""
    marked = [i for i, row in enumerate(rows) if row.radius == 0 and row.index == 0]
    if len(marked) > 1:
        first, second = rows[marked[0]].line, rows[marked[1]].line
        raise InputError(f"{name}:{second}: a second stop (radius 0, index 0); line {first} has the first")
    if marked:
        return marked[0]
    planes = [
        i for i, row in enumerate(rows) if row.radius == 0 and row.index == 1 and (i == 0 or rows[i - 1].index == 1)
    ]
    return planes[0] if len(planes) == 1 else None


def _surface(row: _Row, gap: float, is_stop: bool, before: Medium, name: str) -> Surface:
    """Return the surface of a row; a stop of index 0 lies in the medium before it, such as the aqueous of an eye."""
    if row.diameter <= 0:
        raise InputError(f"{name}:{row.line}: diameter must be above 0 (got {row.diameter:g})")
    if row.index != 0 and not 1 <= row.index <= 5:
        raise InputError(
            f"{name}:{row.line}: index must lie between 1 and 5, or be 0 at the stop, for the medium before it"
            f" (got {row.index:g})"
        )
    glass: Medium = AIR if row.index in (0.0, 1.0) else ConstantIndex(row.index, f"n = {row.index:g}")
    if is_stop and row.index == 0:
        glass = before
    curvature = 1 / row.radius if row.radius else 0.0
    return replace(
        Surface(), curvature=curvature, thickness=gap, glass=glass, semi_diameter=row.diameter / 2, is_stop=is_stop
    )


# Lens files of ISET (JSON): a list of surfaces with radius, thickness, ior and semi_aperture, in millimetres.

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


# Lens files of DeepLens (JSON): surfaces with clear radius r, radius roc or curvature c, mat2 and d_next, in mm.

STOPS = ("Aperture", "Stop")
SHAPES = ("Spheric", "Aspheric", "Plane")
EMPTY = ("air", "vacuum", "occluder")  # an occluder is a plate around an opening
# n_d and V_d of the materials of DeepLens that no catalogue has under their names
MATERIALS = {
    "coc": (1.5337, 56.22), "okp4": (1.6328, 23.34), "okp4ht": (1.6328, 23.34), "apl5014cl": (1.5445, 55.99),
    "hk51": (1.5501, 58.64), "flint": (1.62, 36.37),
}  # fmt: skip
_LONGEST_RADIUS = 1e12


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
        return 1 / radius if 0 < abs(radius) < _LONGEST_RADIUS else 0.0
    return values.number("c", 0.0)


def _asphere(values: _Values) -> dict[str, Any]:
    """Return conic and coefficients: of `ai` the first belongs to r^2 unless `use_ai2` says no, the next to r^4."""
    keys: dict[str, Any] = {}
    if conic := values.number("k", 0.0):
        keys["conic"] = conic
    terms = values.row.get("ai", [])
    if not isinstance(terms, list) or not all(isinstance(t, int | float) and not isinstance(t, bool) for t in terms):
        raise values.fail("ai", "expected a list of numbers")
    first = 2 if values.row.get("use_ai2", True) else 4
    if aspheric := {first + 2 * i: float(term) for i, term in enumerate(terms) if term}:
        keys["aspheric"] = aspheric
    return keys


# Lens files of the Photons to Photos Optical Bench (.txt): tab-separated sections, zoom states in columns.

_ROUNDED_MM = 0.003  # of a sum of gaps
_OF_CALCULATION = 0.05  # of the gap that changes most: by so much a back focus may be beside that which stays
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
    distances = _distances(sections)
    table.f_number = _value(distances.get("F-Number", []), 0)
    gaps = _surfaces(table, sections.get("lens data", []), distances)
    constants = {words[0].lower(): words[1:] for _, words in sections.get("constants", [])}
    _aspheres(table, sections.get("aspherical data", []), constants, sections.get("lens data", []))
    published = {"focal_length_mm": _value(distances.get("Focal Length", []), 0), "f_number": table.f_number}
    table.keys["published"] = {key: value for key, value in published.items() if value}
    _configurations(table, gaps, distances)
    return with_sharp_states(table.lens(), path)


def _distances(sections: dict[str, list[tuple[int, list[str]]]]) -> dict[str, list[str]]:
    """Return the variable distances, as many columns as there are states, and as Bf the gap of the last surface.

    Columns behind hold differences. Behind a cover glass the row Bf of a file is the back focus without it.
    """
    distances = {words[0]: words[1:] for _, words in sections.get("variable distances", [])}
    columns = max(len(distances.get(name, [])) for name in ("d0", "Focal Length"))
    if columns:
        distances = {name: words[:columns] for name, words in distances.items()}
    last = sections["lens data"][-1][1] if sections.get("lens data") else []
    gap = last[2] if len(last) > 2 else ""
    if gap and gap != "Bf":
        distances["Bf"] = distances.get(gap) or [gap] * max(columns, 1)
    return distances


def with_sharp_states(lens: Lens, path: str) -> Lens:
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
        replace(each, floating=checked(in_configuration(lens, each.name), each.floating))
        for each in lens.configurations
    )
    lens = replace(lens, configurations=configurations)
    lens = (
        in_configuration(lens, configurations[0].name)
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
        near = lens.with_changes({k: {"thickness": gap} for k, gap in state.gaps})
        film = infinity + state.film_shift_mm
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
            row["radius"] = _bench_number(radius, table.path, line, f"radius of surface {label}")
        if place < len(lines) - 1:
            if gap in distances:
                gaps[place] = gap
                gap = distances[gap][0] if distances[gap] else ""
            row["thickness"] = _bench_number(gap, table.path, line, f"thickness behind surface {label}")
        if diameter:
            row["diameter"] = _bench_number(diameter, table.path, line, f"diameter of surface {label}")
        if index and index not in ("1", "1.0"):
            nd = _bench_number(index, table.path, line, f"index behind surface {label}")
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
        conic, *terms = [_bench_number(word or "0", table.path, line, "coefficient") for word in words[2:]] or [0.0]
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
        near_state = None if far is None else _near_state(table, gaps, distances, column, far)
        if far is None or near_state is None:
            unread = unread or len(zooms) > 1
        else:
            states.setdefault(far, []).append(near_state)
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
    ends = (_gaps_of(gaps, distances, at).values() for at in (column, far))
    changes = [(new or 0.0) - (old or 0.0) for new, old in zip(*ends, strict=True)]
    longer, most = sum(changes), max(map(abs, changes))
    computed = float(backs[1] or 0.0) - float(backs[0] or 0.0)
    lengths = [_value(distances.get("Total Length", []), k) for k in (far, column)]
    said = None if None in lengths else float(lengths[1] or 0.0) - float(lengths[0] or 0.0) - longer
    if said is None and abs(longer) <= _ROUNDED_MM:
        said = 0.0
    return said if said is not None and abs(said - computed) <= _OF_CALCULATION * most else computed


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


def _bench_number(word: str, path: str, line: int, what: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise InputError(f"{path}:{line}: {what}: expected a number (got {word!r})") from None
