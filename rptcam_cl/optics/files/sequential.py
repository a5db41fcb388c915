"""Sequential lens files of other programs: Zemax (.zmx), and CODE V (.seq) with its private glasses."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import field
from typing import Any

import numpy as np

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.files.glasses import makers_of
from rptcam_cl.optics.files.keys import UNITS_MM
from rptcam_cl.optics.files.lens_table import AxisFrame, LensTable, model, model_glass, numbers, opening_beside_the_axis
from rptcam_cl.optics.files.native import bfs_powers
from rptcam_cl.optics.files.tables import with_sharp_states
from rptcam_cl.optics.glass import AbbeCauchy
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.shapes import PHASES

# Zemax: spheres, aspheres, toroids, gratings, ideal lenses and coordinate breaks.

_ZMX_UNITS = {"MM": "mm", "CM": "cm", "IN": "in", "METER": "m"}
TYPES = ("STANDARD", "EVENASPH", "ODDASPHE", "TOROIDAL", "BICONICX", "XASPHERE", "COORDBRK", "QED_TYPE", "PARAXIAL",
         "DGRATING", "BINARY_2")  # fmt: skip
_ZMX_SENSES = (1.0, 1.0, 1.0)  # tilts turn right handed: OpticStudio help, «Tilt/Decenter»
_MOST_TERMS = 240  # of an extended asphere, to r^480
_PLACEHOLDER = (1.5, 40.0)  # what Zemax writes beside the name of a catalogue glass
_MOST_FORBES = 18
_FORBES_ERROR = 1e-6  # of a sag by powers of r [unit], which no ray notices
NEARLY = 1 + 1e-9
# What changes the rays and is not read; everything else that is not read has no optical meaning.
_MEANT_WORDS = "OBSC ELAP UDAP UDAD USAP UOBS ROBS SQOB ELOB SPID XDAT NSCS GRIN TEMP"
MEANT = frozenset(_MEANT_WORDS.split())


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
    surfaces = _parse_zmx(text, table, spaces)
    if len(surfaces) < 3:
        raise InputError(f"{path}: a lens needs surfaces between object and image")
    table.set_object(surfaces[0].values.get("DISZ", 0.0))
    if surfaces[0].glass and not surfaces[0].is_mirror:
        table.keys["object_medium"] = _glass(surfaces[0], table)
    _drop_collimator(surfaces, table)
    frame = AxisFrame(_ZMX_SENSES)
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
        row = _zmx_row(surface, table)
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


def _parse_zmx(text: str, table: LensTable, spaces: dict[int, dict[int, float]]) -> list[_ZmxSurface]:
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
        elif key in _OF_CONFIGURATIONS and table.zoom.count > 1:
            if rest[1:2] == ["1"]:
                table.note(line, f"{key} of configurations is ignored: spaces, object and pupil alone may differ")
        elif surfaces and key not in _ZMX_HEADER:
            _take_zmx(surfaces[-1], key, rest, line, table)
        else:
            _zmx_header(key, rest, line, table)
    return surfaces


_ZMX_HEADER = frozenset(("MODE", "UNIT"))
# What configurations may differ in beside spaces (OpticStudio help, «Multi-Configuration Operands»).
_OF_CONFIGURATIONS = frozenset(("APER", "CRVT", "GLSS", "CONN", "PRAM", "SDIA", "STPS", "IGNR", "PRES"))


def _zmx_header(key: str, rest: list[str], line: int, table: LensTable) -> None:
    if key == "NAME":
        table.name = " ".join(rest)
    elif key == "UNIT" and rest:
        if rest[0].upper() not in _ZMX_UNITS:
            raise InputError(f"{table.path}:{line}: unit {rest[0]!r} is unknown; known: {', '.join(_ZMX_UNITS)}")
        table.unit = _ZMX_UNITS[rest[0].upper()]
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


def _take_zmx(surface: _ZmxSurface, key: str, rest: list[str], line: int, table: LensTable) -> None:
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


def _zmx_row(surface: _ZmxSurface, table: LensTable) -> dict[str, Any]:
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
    if (nd, vd) == _PLACEHOLDER:
        nd, vd = 0.0, 0.0
    return table.glass(name, surface.line, nd, vd)


def _extended_terms(surface: _ZmxSurface, table: LensTable) -> dict[int, float]:
    """Return the powers of r of an extended asphere: extra data are their number, the norm radius, r^2, r^4, ..."""
    count, norm = surface.extra.get(1, 0.0), surface.extra.get(2, 1.0)
    if not norm > 0 or not 0 <= count <= _MOST_TERMS:
        raise InputError(
            f"{table.path}:{surface.line}: an extended asphere needs up to {_MOST_TERMS} terms (XDAT 1, got {count:g})"
            f" and a norm radius above 0 (XDAT 2, got {norm:g})"
        )
    terms = {2 * i: surface.extra.get(i + 2, 0.0) / norm ** (2 * i) for i in range(1, int(count) + 1)}
    return {power: value for power, value in terms.items() if value}


def _forbes(surface: _ZmxSurface, table: LensTable) -> dict[str, Any]:
    """Return the keys of a Q-type asphere: extra data are its type (0 Qbfs, 1 Qcon), the number of its terms, the norm
    radius and the coefficients from a_0."""
    kind, count, norm = (surface.extra.get(k, 0.0) for k in (1, 2, 3))
    if kind not in (0, 1) or not norm > 0 or not 0 <= count <= _MOST_FORBES:
        raise InputError(
            f"{table.path}:{surface.line}: a Q-type asphere needs the type 0 or 1 (XDAT 1, got {kind:g}), up to"
            f" {_MOST_FORBES} terms (XDAT 2, got {count:g}) and a norm radius above 0 (XDAT 3, got {norm:g})"
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
    if error > _FORBES_ERROR:
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


#
# CODE V: spheres, conics, polynomial aspheres, cylinders, decentres and tilts.
#
# Private glasses: PRV, wavelengths behind PWL, indices or a law behind each name, END.

_OF_THE_MODEL = 1e-9  # by which indices follow the n_d and V_d of their name


def _private_glasses(statements: list[tuple[int, list[str]]], path: str) -> dict[str, Any]:
    """Return the `glass` entries of the private glasses of a sequence by their names, in capitals."""
    glasses: dict[str, Any] = {}
    wavelengths: list[float] = []
    inside = False
    for line, words in statements:
        key, rest = words[0].upper(), words[1:]
        if key == "PRV":
            inside = True
        elif inside and key == "END":
            inside = False
        elif inside and key == "PWL":
            wavelengths = numbers(rest, path, line, 1)
        elif inside:
            name = words[0].strip("'\"")
            glasses[name.upper()] = _private_glass(name, rest, wavelengths, path, line)
    return glasses


def _private_glass(name: str, rest: list[str], wavelengths: list[float], path: str, line: int) -> dict[str, Any]:
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
        if max(abs(n - fit) for (_, n), fit in zip(rows, law, strict=True)) < _OF_THE_MODEL:
            return dict(known)  # what it is called says it exactly
    return {"table": {"wavelengths_nm": [w for w, _ in rows], "values": [n for _, n in rows]}, "name": name}


_SEQ_UNITS = {"M": "mm", "C": "cm", "I": "in"}
POWERS = dict(zip("ABCDEFGHJ", range(4, 22, 2), strict=True))

# ADE and BDE turn left handed, CDE right handed: the convention of optical design, as ray-optics has it (misc_math.py).
_SEQ_SENSES = (-1.0, -1.0, 1.0)
_TILTS = ("XDE", "YDE", "ZDE", "ADE", "BDE", "CDE")
INFINITE = ("inf", "+inf", "infinity", "+infinity")
_PARTS = re.compile(r"'[^']*'|\"[^\"]*\"|!|[^!'\"]+|['\"]")
_SPLIT = re.compile(r""";(?=(?:[^'"]|'[^']*'|"[^"]*")*$)""")
_QUALIFIER = re.compile(r"S(\d{1,4}|[OISA])(-\d{1,4})?(?:\.\.S?(\d{1,4}|[OIS])(-\d{1,4})?)?", re.ASCII | re.IGNORECASE)
_QUOTED = re.compile(r"'[^']*'|\"[^\"]*\"")
_POSITION = re.compile(r"Z\d+", re.ASCII | re.IGNORECASE)
_SEQ_HEADER = frozenset(("EPD", "FNO", "NA", "NAO", "YAN", "YOB", "YIM", "YRI", "DIM"))
_OFFSETS = ("ADX", "ADY")
_NUMBERED = frozenset(("K", *POWERS, *_TILTS, *_OFFSETS, "THI", "RDY", "CUY", "CUX", "RDX", "REX", "REY"))
_OF_SURFACES = frozenset((*_NUMBERED, "STO", "CIR", "CYL", "YTO", "GLA", "GL1", "DAR", "REV", "BEN"))
_THICKEST = 4.0  # of an element, in radii of its surfaces
_RADIUS_NEEDS = 1.0  # a curvature times the half beam above this is no curvature
_QUIET_WORDS = """
LEN GO INI REF WTW WL WTF VUX VLX VUY VLY XAN XOB XIM CCY THC CCX KC AC BC CC DC EC FC GC HC PIM DER DAR REV SPH ASP CON
SLB CUM THM REX REY TIT TEM PRE CA RMD VUP TEL GLC CUF CUC HWL HCT HOR HCC HCO PWL END AFI
MOD MRD DLF DLR DLT TRX TRY BTX BTY LAB PHY MSF WTA POL AFP XDC YDC ZDC ADC BDC CDC STP SAV OUT WRX WTX FCO SUR IN NXT
CLS PIK
"""
_QUIET = frozenset(_QUIET_WORDS.split())
NOT_READ = {"HOE": "a holographic surface", "GRT": "a grating", "SPS": "a special surface", "XTO": "a toroid about x",
            "AAS": "an anamorphic asphere", "ZRN": "a Zernike surface", "UDS": "a surface of its own",
            "SPL": "a spline", "GRN": "a gradient index", "FRN": "a Fresnel surface"}  # fmt: skip


@dataclass
class _SeqSurface:
    line: int
    value: float
    thickness: float
    glass: str
    radius_mode: bool | None
    stop: bool = False
    diameter: float | None = None
    inner_diameter: float = 0.0
    conic: float = 0.0
    aspheric: dict[int, float] = field(default_factory=dict)
    cylinder: str | None = None
    curvature_x: float | None = None
    clear: dict[str, float] = field(default_factory=dict)
    positions: dict[int, float] = field(default_factory=dict)  # thickness in each position of a zoom
    bend: dict[str, float] = field(default_factory=dict)
    way: str = ""
    ideal: float = 0.0
    diffractive: dict[str, float] = field(default_factory=dict)

    @property
    def curvature(self) -> float:
        return (1.0 / self.value if self.value else 0.0) if self.radius_mode else self.value


def read_codev(text: str, path: str, makers: tuple[str, ...] = ()) -> Lens:
    """Return the lens of a CODE V sequence; glasses of `makers` come first."""
    table = LensTable(path, makers=makers, working=True)
    statements = _statements(text)
    private = _private_glasses(statements, path)
    surfaces = _parse_seq(statements, table, private)
    _choose_radii(surfaces, table)
    frame = AxisFrame(_SEQ_SENSES)
    for place, surface in enumerate(surfaces):
        before = frame.place, frame.turn
        decentre, tilt = _three(surface.bend, _TILTS[:3]), _three(surface.bend, _TILTS[3:])
        if surface.way != "REV":
            frame.bend(decentre, tilt)
        row = _seq_row(surface, table, private)
        frame.stand(row)
        if surface.way == "REV":
            frame.unbend(decentre, tilt)
        elif surface.way == "DAR":
            frame.place, frame.turn = before
        elif surface.way == "BEN":
            frame.bend((0.0, 0.0, 0.0), tilt)  # the axis is reflected as a ray along it is
        if place < len(surfaces) - 1:
            row["thickness"] = surface.thickness
        frame.advance(surface.thickness)
        table.rows.append(row)
    table.place(frame)
    if table.rows and not any(surface.stop for surface in surfaces):
        table.rows[0]["stop"] = True  # as in that program
    if table.zoom.count > 1 and table.rows:
        table.add_positions([[s.positions.get(k, s.thickness) for k in table.zoom.numbers] for s in surfaces])
    table.size_stop()
    return with_sharp_states(table.lens(), path)


def _statements(text: str) -> list[tuple[int, list[str]]]:
    """Return the words of each statement: between semicolons, continued by &, comments behind !, text in quotes."""
    result: list[tuple[int, list[str]]] = []
    carry = ""
    for line, raw in enumerate(text.lstrip("\ufeff").splitlines(), start=1):
        parts = _PARTS.findall(carry + raw)
        bare = "".join(parts[: parts.index("!")] if "!" in parts else parts).rstrip()
        if bare.endswith("&"):
            carry = bare[:-1] + " "
            continue
        carry = ""
        for statement in _SPLIT.split(bare):
            if words := statement.split():
                result.append((line, words))
    return result


def _parse_seq(
    statements: list[tuple[int, list[str]]], table: LensTable, private_ones: Mapping[str, Any]
) -> list[_SeqSurface]:
    surfaces: list[_SeqSurface] = []
    radius_mode: bool | None = None
    inside, private = True, False
    for line, words in statements:
        key, rest = words[0].upper(), words[1:]
        if key == "STOP":
            key = "STO"
        if private:
            private = key != "END"
        elif key == "PRV":
            private = True
        elif key == "RDM":
            radius_mode = not rest or rest[0].upper() != "N"
        elif key in ("SO", "S0", "SI"):
            inside = False
            if key != "SI" and len(rest) > 1:
                table.set_object(_numbers(rest[1:2], table, line)[0])
            if key != "SI" and (medium := _medium(rest[2] if rest[2:] else "", line, table, private_ones)) is not None:
                table.keys["object_medium"] = medium
        elif key == "S" or (key[0] == "S" and key[1:].isdigit()):
            inside = True
            value, thickness = _numbers([*rest, "0", "0"][:2], table, line)
            glass = rest[2] if len(rest) > 2 else ""
            surfaces.append(_SeqSurface(line, value, thickness, glass, radius_mode))
        elif rest and (key == "ZOO" or _of_position(key, rest)):
            _read_zoom(words[1:] if key == "ZOO" else words, surfaces, line, table)
        elif rest and not key.startswith("TIT") and (qualifier := _QUALIFIER.fullmatch(rest[0])):
            for target in _targets(qualifier, surfaces):
                _take_seq(target, key, rest[1:], line, table)
        elif rest and key in _OF_SURFACES and rest[0][:2].upper() in ("S'", 'S"'):
            table.note(line, f"{key} of the surface labelled {rest[0][1:]} is ignored")
        elif key in _SEQ_HEADER:
            _seq_header(key, rest, line, table)
        elif surfaces and inside:
            _take_seq(surfaces[-1], key, rest, line, table)
        elif key in NOT_READ or key in _OF_SURFACES:
            continue  # of the object or the image
        else:
            _seq_header(key, rest, line, table)
    return surfaces


def _of_position(key: str, rest: list[str]) -> bool:
    """Return whether a statement is of one position of a zoom: the name, the pupil or the distance of the object."""
    of_object = key == "THI" and rest[0].upper() in ("SO", "S0")
    of_position = bool(_POSITION.fullmatch(rest[0]))
    return of_object or (of_position and (key == "EPD" or key.startswith("TIT")))


def _take_of_positions(values: dict[int, float], rest: list[str], line: int, table: LensTable) -> None:
    """Take numbers of one position (``Z2 5``) or of all from the first on."""
    first = int(rest[0][1:]) if rest and _POSITION.fullmatch(rest[0]) else 0
    values |= dict(enumerate(_numbers(rest[1:2] if first else rest, table, line), start=first or 1))


def _read_zoom(words: list[str], surfaces: list[_SeqSurface], line: int, table: LensTable) -> None:
    """Take what positions differ in: ``3`` of them, ``THI S5 1.9 20``, ``THI SO Z2 500``, ``EPD 20 25``, titles."""
    zoom = table.zoom
    key, rest = words[0].upper(), words[1:]
    qualifier = _QUALIFIER.fullmatch(rest[0]) if rest else None
    if key.isdecimal():
        zoom.count = int(key)
    elif key.startswith("TIT") and rest and _POSITION.fullmatch(rest[0]):
        zoom.names[int(rest[0][1:])] = " ".join(rest[1:]).strip("'\"").strip()
    elif key.startswith("TIT"):  # all positions, each in quotes of its own
        zoom.names |= dict(enumerate((text.strip("'\"").strip() for text in _QUOTED.findall(" ".join(rest))), start=1))
    elif key == "EPD":
        _take_of_positions(zoom.pupils, rest, line, table)
        table.pupil_diameter = table.pupil_diameter or zoom.pupils.get(1)
    elif key == "THI" and rest and rest[0].upper() in ("SO", "S0"):
        _take_of_positions(zoom.objects, rest[1:], line, table)
    elif key == "THI" and qualifier:
        for target in _targets(qualifier, surfaces):
            _take_of_positions(target.positions, rest[1:], line, table)
            target.thickness = target.positions.get(1, target.thickness)
    elif key not in _QUIET:
        table.note(line, f"{key} of the positions of a zoom is ignored: spaces, object and pupil alone may differ")


def _targets(qualifier: re.Match[str], surfaces: list[_SeqSurface]) -> list[_SeqSurface]:
    """Return the surfaces of a qualifier such as S3, S2..5, SA, SS or SI-1; object and image are none of them."""

    def number(word: str, back: str | None) -> int:
        at_stop = next((k for k, surface in enumerate(surfaces, start=1) if surface.stop), 0)
        places = {"O": 0, "I": len(surfaces) + 1, "S": at_stop}
        return (places[word] if word in places else int(word)) + int(back or 0)

    first, last = qualifier[1].upper(), (qualifier[3] or qualifier[1]).upper()
    if first == "A":
        return surfaces
    low, high = number(first, qualifier[2]), number(last, qualifier[4] if qualifier[3] else qualifier[2])
    return surfaces[max(low - 1, 0) : max(high, 0)]


def _numbers(words: list[str], table: LensTable, line: int) -> list[float]:
    """Return numbers, of which `inf` and `infinity` are 0: a plane, and a distance that is none."""
    return numbers(["0" if word.lower() in INFINITE else word for word in words], table.path, line)


def _choose_radii(surfaces: list[_SeqSurface], table: LensTable) -> None:
    """Where no RDM says so, take the numbers as curvatures, as CODE V does, unless no beam could cross them."""
    open_ones = [surface for surface in surfaces if surface.radius_mode is None]
    heights = [surface.diameter / 2 for surface in open_ones if surface.diameter]
    half = max([*heights, (table.pupil_diameter or 0.0) / 2])
    if not half:  # no element is that much thicker than it is curved
        half = max((abs(s.thickness) for s in open_ones if s.glass), default=0.0) / _THICKEST
    radii = any(abs(surface.value) * half > _RADIUS_NEEDS for surface in open_ones)
    for surface in open_ones:
        surface.radius_mode = radii
    if radii:
        table.note(
            open_ones[0].line, "no RDM: the numbers are radii, for as curvatures no beam could cross the surfaces"
        )


def _seq_header(key: str, rest: list[str], line: int, table: LensTable) -> None:
    if key.startswith("TIT"):
        table.name = " ".join(rest).strip("'\"").strip()
    elif key == "DIM" and rest:
        if rest[0].upper()[0] not in _SEQ_UNITS:
            raise InputError(f"{table.path}:{line}: dimension {rest[0]!r} is unknown; known: M, C, I")
        table.unit = _SEQ_UNITS[rest[0].upper()[0]]
    elif key == "EPD":
        table.pupil_diameter = table.number(rest, line)
    elif key == "FNO":
        table.f_number = table.number(rest, line)
    elif key == "NA":
        aperture = table.number(rest, line)
        table.f_number = 0.5 / abs(aperture) if aperture else None
    elif key == "NAO":
        table.object_aperture = table.number(rest, line)
    elif key in ("YAN", "YOB", "YIM", "YRI"):
        table.field_kind = ("YAN", "YOB", "YIM", "YRI").index(key)
        table.set_field(max(map(abs, numbers(rest, table.path, line)), default=0.0))
    elif key not in _QUIET:
        table.note(line, f"{key} is ignored")


def _take_seq(surface: _SeqSurface, key: str, rest: list[str], line: int, table: LensTable) -> None:
    if rest and _POSITION.fullmatch(rest[0]):  # of a zoom
        if key == "THI":
            surface.positions[int(rest[0][1:])] = table.number(rest[1:], line)
        elif rest[0].upper() != "Z1" and key not in _QUIET:
            table.note(line, f"{key} of position {rest[0]} is ignored: spaces, object and pupil alone may differ")
        if rest[0].upper() != "Z1":
            return
        rest = rest[1:]
    if key in ("THI", "RDY", "CUY") and rest and rest[0].isalpha():
        return  # a solve, whose value stands in the line of the surface
    if key in ("REX", "REY"):
        words, value = _last_number(rest, line, table)
        if {"OBS", "HOL"} & set(words):
            table.note(line, f"{key} {' '.join(rest)} is ignored")
        elif "EDG" not in words or key not in surface.clear:
            surface.clear[key] = value
    elif key in _NUMBERED:
        _set(surface, key, table.number([word for word in rest if word.upper() != "CLR"], line))
    elif key == "STO":
        surface.stop = True
    elif key == "RMD":
        surface.glass = "REFL" if " ".join(rest).upper().startswith("REFL") else surface.glass
    elif key == "CIR" and {"OBS", "HOL"} & {word.upper() for word in rest}:
        surface.inner_diameter = 2 * numbers(rest[-1:], table.path, line)[0]
    elif key == "CIR":
        words, value = _last_number(rest, line, table)
        if "EDG" not in words or surface.diameter is None:
            surface.diameter = 2 * abs(value)
    elif key in ("CYL", "YTO"):
        surface.cylinder = "y"
    elif key in ("GLA", "GL1") and rest:
        surface.glass, surface.line = rest[0], line
    elif key in ("DAR", "REV", "BEN"):
        surface.way = key
    elif key == "MFL":
        surface.ideal = table.number(rest, line)
    elif key in ("HOR", "HWL") and surface.diffractive:
        surface.diffractive[key] = table.number(rest, line)
    elif key == "HCO" and surface.diffractive and re.fullmatch(r"[Cc]\d+", rest[0] if rest else ""):
        surface.diffractive[rest[0].upper()] = table.number(rest[1:], line)
    elif key == "DIF" and rest[:1] == ["DOE"]:
        surface.diffractive["HOR"] = 1.0
    elif key in NOT_READ or key == "DIF" or (key == "HCT" and rest[:1] != ["R"]):
        what = NOT_READ.get(key, "a diffractive surface")
        raise InputError(f"{table.path}:{line}: {what} ({' '.join([key, *rest])}) cannot be read")
    elif key not in _QUIET:
        table.note(line, f"{key} is ignored")


def _last_number(rest: list[str], line: int, table: LensTable) -> tuple[list[str], float]:
    """Return words in capitals, and the last number among them."""
    words = [word.upper() for word in rest]
    return words, table.number([word for word in words if word[:1] in "+-.0123456789"][-1:], line)


def _set(surface: _SeqSurface, key: str, value: float) -> None:
    """Set one number of a surface."""
    if key == "K":
        surface.conic = value
    elif key in POWERS:
        surface.aspheric[POWERS[key]] = value
    elif key in (*_TILTS, *_OFFSETS):
        surface.bend[key] = value
    elif key == "THI":
        surface.thickness = value
    elif key in ("RDY", "CUY"):
        surface.value, surface.radius_mode = value, key == "RDY"
    else:
        surface.curvature_x = value if key == "CUX" else (1.0 / value if value else 0.0)


def _seq_row(surface: _SeqSurface, table: LensTable, private: Mapping[str, Any]) -> dict[str, Any]:
    row: dict[str, Any] = {}
    if surface.curvature:
        row["radius"] = 1.0 / surface.curvature
    if surface.stop:
        row["stop"] = True
    if surface.diameter:
        row["diameter"] = surface.diameter
    if surface.inner_diameter:
        row["inner_diameter"] = surface.inner_diameter
    if surface.conic:
        row["conic"] = surface.conic
    if aspheric := {power: value for power, value in surface.aspheric.items() if value}:
        row["aspheric"] = aspheric
    if surface.ideal:
        row["ideal"] = {"focal_length": surface.ideal}
    if terms := {2 * int(key[1:]): value for key, value in surface.diffractive.items() if key[0] == "C" and value}:
        row["diffractive"] = {"path": terms, "order": surface.diffractive["HOR"]}
        row["diffractive"] |= {"wavelength_nm": surface.diffractive["HWL"]} if "HWL" in surface.diffractive else {}
    if surface.cylinder and surface.curvature_x:
        row |= {"radius_x": 1.0 / surface.curvature_x, "form": "toroid"}
    elif surface.cylinder:
        row["cylinder"] = surface.cylinder
    if "REX" in surface.clear and "REY" in surface.clear:
        row["clear"] = {"rectangle": [2 * abs(surface.clear["REX"]), 2 * abs(surface.clear["REY"])]}
        row.setdefault("diameter", 2 * math.hypot(surface.clear["REX"], surface.clear["REY"]))
    x, y = (surface.bend.get(key, 0.0) for key in _OFFSETS)
    if (x or y) and {"diameter", "clear", "inner_diameter"} & row.keys():
        opening_beside_the_axis(row, (x, y), surface.diameter or 0.0, row.pop("inner_diameter", 0.0))
    if surface.glass.upper() == "REFL":
        row["mirror"] = True
    elif (medium := _medium(surface.glass, surface.line, table, private)) is not None:
        row["glass"] = medium
    return row


def _medium(word: str, line: int, table: LensTable, private: Mapping[str, Any]) -> Any:
    """Return the `glass` entry of the word for a medium, None for air."""
    if word.upper() in ("", "AIR", "REFR"):
        return None
    own = private.get(word.strip("'").upper())
    return own if own is not None else table.glass(word, line)


def _three(bend: dict[str, float], names: tuple[str, ...]) -> tuple[float, float, float]:
    x, y, z = (bend.get(name, 0.0) for name in names)
    return x, y, z
