"""Sequential lens files of Zemax (.zmx): spheres, aspheres, toroids, gratings, ideal lenses and coordinate breaks."""

from __future__ import annotations

import math
from dataclasses import field
from typing import Any

import numpy as np

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.files.glasses import makers_of
from rptcam_cl.optics.files.keys import UNITS_MM
from rptcam_cl.optics.files.lens_table import AxisFrame, LensTable, model, numbers, opening_beside_the_axis
from rptcam_cl.optics.files.native import bfs_powers
from rptcam_cl.optics.files.tables import with_sharp_states
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.shapes import PHASES

UNITS = {"MM": "mm", "CM": "cm", "IN": "in", "METER": "m"}
TYPES = ("STANDARD", "EVENASPH", "ODDASPHE", "TOROIDAL", "BICONICX", "XASPHERE", "COORDBRK", "QED_TYPE", "PARAXIAL",
         "DGRATING", "BINARY_2")  # fmt: skip
SENSES = (1.0, 1.0, 1.0)  # tilts turn right handed: OpticStudio help, «Tilt/Decenter»
MOST_TERMS = 240  # of an extended asphere, to r^480
PLACEHOLDER = (1.5, 40.0)  # what Zemax writes beside the name of a catalogue glass
MOST_FORBES = 18
FORBES_ERROR = 1e-6  # of a sag by powers of r [unit], which no ray notices
NEARLY = 1 + 1e-9
# What changes the rays and is not read; everything else that is not read has no optical meaning.
MEANT_WORDS = "OBSC ELAP UDAP UDAD USAP UOBS ROBS SQOB ELOB SPID XDAT NSCS GRIN TEMP"
MEANT = frozenset(MEANT_WORDS.split())


@dataclass
class _ZmxSurface:
    line: int
    kind: str = "STANDARD"
    values: dict[str, float] = field(default_factory=dict)
    parameters: dict[int, float] = field(default_factory=dict)
    extra: dict[int, float] = field(default_factory=dict)
    glass: list[str] | None = None
    stop: bool = False
    rectangle: list[float] | None = None
    inner_radius: float = 0.0
    outer_radius: float = 0.0
    offset: tuple[float, float] = (0.0, 0.0)
    number: int = 0
    bends: list[tuple[int, list[str], list[float]]] = field(default_factory=list)

    @property
    def is_mirror(self) -> bool:
        return self.glass is not None and [word.upper() for word in self.glass[:1]] == ["MIRROR"]

    @property
    def has_aperture(self) -> bool:
        """Whether it stops light by an opening of its own, which its semi-diameter is not."""
        return self.outer_radius > 0 or self.inner_radius > 0 or bool(self.rectangle)

    @property
    def semi_diameter(self) -> float:
        """Return the radius beyond which light ends, 0 when nothing says it; the stop is no wider than its beam.

        Of an opening beside the axis it is what is drawn.
        """
        drawn = self.values.get("DIAM", 0.0)
        if self.outer_radius <= 0 or any(self.offset):
            return max(drawn, 0.0)
        return min(drawn, self.outer_radius) if self.stop and drawn > 0 else self.outer_radius


def read_zemax(text: str, path: str, makers: tuple[str, ...] = ()) -> Lens:
    """Return the lens of a sequential Zemax file; glasses of `makers` come first, then those of its own catalogues."""
    table = LensTable(path, makers=makers)
    spaces: dict[int, dict[int, float]] = {}  # behind surfaces, by their numbers, in each position
    surfaces = _parse(text, table, spaces)
    if len(surfaces) < 3:
        raise InputError(f"{path}: a lens needs surfaces between object and image")
    table.set_object(surfaces[0].values.get("DISZ", 0.0))
    if surfaces[0].glass and not surfaces[0].is_mirror:
        table.keys["object_medium"] = _glass(surfaces[0], table)
    _drop_collimator(surfaces, table)
    frame = AxisFrame(SENSES)
    body = surfaces[1:-1]
    openings: list[bool] = []
    parts: list[list[_ZmxSurface]] = []
    for place, surface in enumerate(body):
        last = place == len(body) - 1
        thickness = surface.values.get("DISZ", 0.0)
        if surface.kind == "COORDBRK":
            _break(frame, surface)
            frame.advance(thickness)
            if table.rows and thickness:
                table.rows[-1]["thickness"] = table.rows[-1].get("thickness", 0.0) + thickness
            if parts:
                parts[-1].append(surface)
            continue
        row = _row(surface, table)
        frame.stand(row)
        if surface.stop and surface.outer_radius > 0 and not any(surface.offset):
            table.stop_opening = 2 * surface.outer_radius
        if not last:
            row["thickness"] = thickness
        frame.advance(thickness)
        table.rows.append(row)
        openings.append(surface.has_aperture)
        parts.append([surface])
    _bend_image(frame, surfaces, table)
    table.place(frame)
    _trim(table, openings)
    if table.zoom.count > 1 and parts:
        table.zoom.objects = spaces.get(0, {})
        table.add_positions([[_gap(part, spaces, k) for k in table.zoom.numbers] for part in parts])
    table.size_stop()
    return with_sharp_states(table.lens(), path)


def _gap(part: list[_ZmxSurface], spaces: dict[int, dict[int, float]], position: int) -> float:
    """Return the thickness behind a surface, with those of the breaks behind it, in a position."""
    return sum(spaces.get(each.number, {}).get(position, each.values.get("DISZ", 0.0)) for each in part)


def _parse(text: str, table: LensTable, spaces: dict[int, dict[int, float]]) -> list[_ZmxSurface]:
    surfaces: list[_ZmxSurface] = []
    for line, raw in enumerate(text.lstrip("\ufeff").splitlines(), start=1):
        words = raw.split()
        if not words:
            continue
        key, rest = words[0].upper(), words[1:]
        if key == "SURF":
            surfaces.append(_ZmxSurface(line, number=len(surfaces)))
        elif key == "MNUM" and rest and rest[0].isdecimal():
            table.zoom.count = int(rest[0])
        elif key == "THIC":
            surface, position, value = numbers(rest[:3], table.path, line, 3)
            spaces.setdefault(int(surface), {})[int(position)] = value
        elif key == "APER" and table.zoom.count > 1 and table.pupil_diameter:
            _, position, value = numbers(rest[:3], table.path, line, 3)
            table.zoom.pupils[int(position)] = value
        elif key in OF_CONFIGURATIONS and table.zoom.count > 1:
            if rest[1:2] == ["1"]:
                table.note(line, f"{key} of configurations is ignored: spaces, object and pupil alone may differ")
        elif surfaces and key not in _HEADER:
            _take(surfaces[-1], key, rest, line, table)
        else:
            _header(key, rest, line, table)
    return surfaces


_HEADER = frozenset(("MODE", "UNIT"))
# What configurations may differ in beside spaces (OpticStudio help, «Multi-Configuration Operands»).
OF_CONFIGURATIONS = frozenset(("APER", "CRVT", "GLSS", "CONN", "PRAM", "SDIA", "STPS", "IGNR", "PRES"))


def _header(key: str, rest: list[str], line: int, table: LensTable) -> None:
    if key == "NAME":
        table.name = " ".join(rest)
    elif key == "UNIT" and rest:
        if rest[0].upper() not in UNITS:
            raise InputError(f"{table.path}:{line}: unit {rest[0]!r} is unknown; known: {', '.join(UNITS)}")
        table.unit = UNITS[rest[0].upper()]
    elif key == "MODE" and rest and rest[0].upper() != "SEQ":
        raise InputError(f"{table.path}:{line}: only sequential files can be read (MODE {rest[0]})")
    elif key == "ENPD":
        table.pupil_diameter = table.number(rest, line)
    elif key == "FNUM":
        table.f_number = table.number(rest, line)
        table.working = rest[1:2] == ["1"]
    elif key == "OBNA":
        value = table.number(rest, line)
        table.object_aperture = math.sin(math.radians(value)) if rest[1:2] == ["1"] else value
    elif key == "FLOA":  # the stop is as wide as it is drawn
        table.pupil_diameter = table.f_number = table.object_aperture = None
    elif key == "GCAT":
        table.makers += tuple(maker for word in rest for maker in makers_of(word))
    elif key == "FTYP":
        table.field_kind = int(table.number(rest, line))
    elif key == "YFLN":
        table.set_field(max(map(abs, numbers(rest, table.path, line)), default=0.0))
    elif key == "ENVD" and [float(word) for word in numbers(rest[:2], table.path, line)] not in ([], [20.0, 1.0]):
        table.note(line, f"glass is taken at 20 degrees and 1 atmosphere, not at {' and '.join(rest[:2])}")


def _take(surface: _ZmxSurface, key: str, rest: list[str], line: int, table: LensTable) -> None:
    if key == "TYPE":
        surface.kind = rest[0].upper() if rest else "STANDARD"
        if surface.kind not in TYPES:
            raise InputError(
                f"{table.path}:{line}: surface type {surface.kind} cannot be read; known: {', '.join(TYPES)}"
            )
    elif key == "STOP":
        surface.stop = True
    elif key in ("CURV", "CONI", "DIAM"):
        surface.values[key] = table.number(rest, line)
    elif key == "DISZ":
        far = [word.upper() for word in rest[:1]] == ["INFINITY"]
        surface.values[key] = 0.0 if far else table.number(rest, line)
    elif key == "XDAT":
        number, value = numbers(rest[:2], table.path, line, 2)
        surface.extra[int(number)] = value
    elif key == "PARM":
        number, value = numbers(rest[:2], table.path, line, 2)
        surface.parameters[int(number)] = value
    elif key == "SQAP":
        half = numbers(rest[:2], table.path, line, 2)
        surface.rectangle = [2 * abs(value) for value in half]
    elif key in ("CLAP", "OBSC") and len(rest) >= 2:
        least, most = numbers(rest[:2], table.path, line)
        surface.inner_radius = max(surface.inner_radius, least if key == "CLAP" else most)
        if key == "CLAP":
            surface.outer_radius = most
    elif key == "GLAS":
        surface.glass = rest
        surface.line = line
    elif key == "SCBD" and any(values := numbers(rest[3:8], table.path, line)):
        surface.bends.append((line, rest[:2], [*values, *[0.0] * (5 - len(values))]))
    elif key == "OBDC":
        x, y = numbers(rest[:2], table.path, line, 2)
        surface.offset = (x, y)
    elif key in MEANT:
        table.note(line, f"{key} is ignored")


def _drop_collimator(surfaces: list[_ZmxSurface], table: LensTable) -> None:
    """Drop an ideal lens with the object in its focus before others, which makes the object a distant one."""
    length, away = surfaces[1].parameters.get(1, 0.0), table.object_distance
    if surfaces[1].kind == "PARAXIAL" and len(surfaces) > 3 and length and abs(away - length) <= 1e-6 * abs(length):
        table.note(surfaces[1].line, "an ideal lens with the object in its focus is left out: the object is distant")
        table.object_distance = float("inf")
        del surfaces[1]


def _phase(surface: _ZmxSurface, table: LensTable) -> dict[str, Any]:
    """Return the key of a grating, of a diffractive surface or of an ideal lens; nothing of others."""
    p, extra = surface.parameters, surface.extra
    if surface.kind == "PARAXIAL":
        if not p.get(1) or surface.is_mirror:
            raise InputError(f"{table.path}:{surface.line}: an ideal lens needs a focal length (PARM 1), and no mirror")
        return {"ideal": {"focal_length": p[1]}}
    if surface.kind == "DGRATING" and p.get(1) and p.get(2):  # lines per micrometre, order
        return {"grating": {"lines_per_mm": 1000 * abs(p[1]), "order": math.copysign(1.0, p[1]) * p[2]}}
    if surface.kind == "BINARY_2" and any(extra.get(k) for k in range(3, int(extra.get(1, 0.0)) + 3)):
        norm, radians = extra.get(2, 1.0), LINE_D_NM / 1e6 / (2 * math.pi) / UNITS_MM[table.unit]
        terms = {2 * i: extra.get(i + 2, 0.0) * radians / norm ** (2 * i) for i in range(1, int(extra[1]) + 1)}
        order = p.get(0, 1.0)
        return {"diffractive": {"path": {k: v for k, v in terms.items() if v}, "order": order}} if order else {}
    return {}


def _row(surface: _ZmxSurface, table: LensTable) -> dict[str, Any]:
    row: dict[str, Any] = {}
    if curvature := surface.values.get("CURV"):
        row["radius"] = 1.0 / curvature
    if surface.stop:
        row["stop"] = True
    if surface.semi_diameter > 0:
        row["diameter"] = 2 * surface.semi_diameter
    if surface.rectangle and all(surface.rectangle):
        row["clear"] = {"rectangle": surface.rectangle}
    if surface.values.get("CONI"):
        row["conic"] = surface.values["CONI"]
    if any(surface.offset) and surface.has_aperture:
        opening_beside_the_axis(row, surface.offset, 2 * surface.outer_radius, 2 * surface.inner_radius)
    elif surface.inner_radius > 0:
        row["inner_diameter"] = 2 * surface.inner_radius
    if surface.is_mirror:
        row["mirror"] = True
    elif surface.glass:
        row["glass"] = _glass(surface, table)
    row |= _phase(surface, table)
    if surface.kind not in ("XASPHERE", "QED_TYPE", "BINARY_2") and any(surface.extra.values()):
        table.note(surface.line, f"the extra data (XDAT) of this {surface.kind} surface are ignored")
    p = surface.parameters
    if surface.kind in ("EVENASPH", "BINARY_2"):
        row["aspheric"] = {2 * i: v for i, v in p.items() if v and 1 <= i <= 8}
    elif surface.kind == "XASPHERE":
        row["aspheric"] = _extended_terms(surface, table)
    elif surface.kind == "QED_TYPE":
        row |= _forbes(surface, table)
    elif surface.kind == "ODDASPHE":
        row["aspheric"] = {i: v for i, v in p.items() if v and 1 <= i <= 8}
    elif surface.kind == "TOROIDAL":
        if p.get(1) and "radius" not in row and not any(v for i, v in p.items() if i >= 2):
            row |= {"radius": p[1], "cylinder": "x"}
        else:
            row |= {"radius_x": p[1], "form": "toroid"} if p.get(1) else {"cylinder": "y"}
        row["aspheric"] = {2 * (i - 1): v for i, v in p.items() if v and 2 <= i <= 8}
    elif surface.kind == "BICONICX":
        row["radius_x"] = p.get(1) or float("inf")
        if p.get(2):
            row["conic_x"] = p[2]
    return {key: value for key, value in row.items() if value != {}}


def _glass(surface: _ZmxSurface, table: LensTable) -> Any:
    words = surface.glass or []
    name = words[0] if words else ""
    nd, vd = numbers(words[3:5], table.path, surface.line) if len(words) >= 5 else (0.0, 0.0)
    if name.startswith("___") or not name:
        if nd <= 0:
            raise InputError(f"{table.path}:{surface.line}: a model glass needs an index and an Abbe number")
        return model(nd, vd)
    if (nd, vd) == PLACEHOLDER:
        nd, vd = 0.0, 0.0
    return table.glass(name, surface.line, nd, vd)


def _extended_terms(surface: _ZmxSurface, table: LensTable) -> dict[int, float]:
    """Return the powers of r of an extended asphere: extra data are their number, the norm radius, r^2, r^4, ..."""
    count, norm = surface.extra.get(1, 0.0), surface.extra.get(2, 1.0)
    if not norm > 0 or not 0 <= count <= MOST_TERMS:
        raise InputError(
            f"{table.path}:{surface.line}: an extended asphere needs up to {MOST_TERMS} terms (XDAT 1, got {count:g})"
            f" and a norm radius above 0 (XDAT 2, got {norm:g})"
        )
    terms = {2 * i: surface.extra.get(i + 2, 0.0) / norm ** (2 * i) for i in range(1, int(count) + 1)}
    return {power: value for power, value in terms.items() if value}


def _forbes(surface: _ZmxSurface, table: LensTable) -> dict[str, Any]:
    """Return the keys of a Q-type asphere: extra data are its type (0 Qbfs, 1 Qcon), the number of its terms, the norm
    radius and the coefficients from a_0."""
    kind, count, norm = (surface.extra.get(k, 0.0) for k in (1, 2, 3))
    if kind not in (0, 1) or not norm > 0 or not 0 <= count <= MOST_FORBES:
        raise InputError(
            f"{table.path}:{surface.line}: a Q-type asphere needs the type 0 or 1 (XDAT 1, got {kind:g}), up to"
            f" {MOST_FORBES} terms (XDAT 2, got {count:g}) and a norm radius above 0 (XDAT 3, got {norm:g})"
        )
    terms = tuple(surface.extra.get(k + 4, 0.0) for k in range(int(count)))
    if not any(terms):
        return {}
    if kind == 1:
        return {"qcon": {"radius": norm, "coefficients": list(terms)}}
    rim = surface.semi_diameter or norm
    shape = surface.values.get("CURV", 0.0), surface.values.get("CONI", 0.0)
    if rim > norm * NEARLY or not (1 + shape[1]) * (shape[0] * rim) ** 2 < 1:
        raise InputError(f"{table.path}:{surface.line}: a Q-type asphere ends before its rim of {rim:g}")
    powers, error = bfs_powers(terms, norm, rim, *shape)
    if error > FORBES_ERROR:
        table.note(surface.line, f"the Q-type asphere is read as powers of r, which leave it by up to {error:.2g}")
    return {"aspheric": powers}


def _break(frame: AxisFrame, surface: _ZmxSurface) -> None:
    p = surface.parameters
    tilt_first = bool(p.get(6))
    frame.bend((p.get(1, 0.0), p.get(2, 0.0), 0.0), (p.get(3, 0.0), p.get(4, 0.0), p.get(5, 0.0)), tilt_first)


def _bend_image(frame: AxisFrame, surfaces: list[_ZmxSurface], table: LensTable) -> None:
    """Decentre and tilt the image as its own line says (SCBD 1: before the surface); of others say that it is not read.

    Light may come to either side of an image, but to a film along its axis, or against it behind an odd mirror.
    """
    for surface in surfaces:
        for line, (when, order), (x, y, *tilt) in surface.bends:
            if surface is not surfaces[-1] or when != "1" or not frame.stands:
                table.note(line, "SCBD, a decentre and tilt in a surface's own line, is ignored")
                continue
            frame.bend((x, y, 0.0), (tilt[0], tilt[1], tilt[2]), order != "0")
            _, place, turn, _ = frame.stands[-1]
            arriving = frame.place - place - turn @ np.array([*surfaces[-2].offset, 0.0])
            mirrors = sum(surface.is_mirror for surface in surfaces)
            if (-1) ** mirrors * float(frame.turn[:, 2] @ arriving) < 0:
                frame.bend((0.0, 0.0, 0.0), (180.0, 0.0, 0.0))


def _trim(table: LensTable, openings: list[bool]) -> None:
    """Drop the dummy planes before and after the lens, so that its first and last vertex are real ones.

    A plane with one medium on both sides is one, unless it stops light: `openings` says so of each row.
    """
    rows = table.rows
    media = [table.keys.get("object_medium")]
    for row in rows:
        media.append(media[-1] if row.get("mirror") else row.get("glass"))

    def is_dummy(k: int) -> bool:
        bends = {"radius", "radius_x", "aspheric", "mirror", *(kind.key for kind in PHASES)}
        shaped = rows[k].keys() & {*bends, "stop", "decentre"}
        return not (shaped or openings[k] or media[k] != media[k + 1])

    first, end = 0, len(rows)
    while first < end and is_dummy(first):
        table.object_distance += rows[first].get("thickness", 0.0)
        first += 1
    while end - 1 > first and is_dummy(end - 1):
        end -= 1
    table.rows = rows[first:end]
    if table.rows:
        table.rows[-1].pop("thickness", None)
