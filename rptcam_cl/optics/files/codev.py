"""Sequential lens files of CODE V (.seq): spheres, conics, polynomial aspheres, cylinders, decentres and tilts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from rptcam_cl.errors import InputError
from rptcam_cl.optics.files.breaks import Frame
from rptcam_cl.optics.files.table import Table, glass_entry, numbers, six_digit_glass
from rptcam_cl.optics.lens import Lens

UNITS = {"M": "mm", "C": "cm", "I": "in"}
POWERS = dict(zip("ABCDEFGHJ", range(4, 22, 2), strict=True))
# ADE and BDE turn left handed, CDE right handed: the convention of optical design, as ray-optics has it (misc_math.py).
SENSES = (-1.0, -1.0, 1.0)
TILTS = ("XDE", "YDE", "ZDE", "ADE", "BDE", "CDE")
QUIET_WORDS = """
LEN GO INI REF WTW WL WTF VUX VLX VUY VLY XAN XOB YOB XIM CCY THC CCX KC AC BC CC DC PIM DER DAR SPH ASP CON
SLB CA CUM THM BEN REX REY GLB DIF TIT ADX ADY
"""
QUIET = frozenset(QUIET_WORDS.split())


@dataclass
class _Surface:
    line: int
    curvature: float
    thickness: float
    glass: str
    stop: bool = False
    diameter: float | None = None
    conic: float = 0.0
    aspheric: dict[int, float] = field(default_factory=dict)
    cylinder: str | None = None
    bend: dict[str, float] = field(default_factory=dict)


def read_codev(text: str, path: str) -> Lens:
    """Return the lens of a CODE V sequence."""
    table = Table(path)
    surfaces = _parse(text, table)
    frame = Frame(SENSES)
    for place, surface in enumerate(surfaces):
        if surface.bend:
            frame.bend(_three(surface.bend, TILTS[:3]), _three(surface.bend, TILTS[3:]))
        row = _row(surface, table) | frame.keys()
        if place < len(surfaces) - 1:
            row["thickness"] = surface.thickness
        frame.advance(surface.thickness)
        table.rows.append(row)
    return table.lens()


def _statements(text: str) -> list[tuple[int, list[str]]]:
    """Return the words of each statement: separated by semicolons, continued by &, comments behind !."""
    result: list[tuple[int, list[str]]] = []
    carry = ""
    for line, raw in enumerate(text.lstrip("\ufeff").splitlines(), start=1):
        bare = carry + raw.split("!")[0].rstrip()
        if bare.endswith("&"):
            carry = bare[:-1] + " "
            continue
        carry = ""
        result += [(line, part.split()) for part in bare.split(";") if part.split()]
    return result


def _parse(text: str, table: Table) -> list[_Surface]:
    surfaces: list[_Surface] = []
    radius_mode, inside = False, True
    for line, words in _statements(text):
        key, rest = words[0].upper(), words[1:]
        if key == "RDM":
            radius_mode = not rest or rest[0].upper() != "N"
        elif key == "SO":
            inside = False
        elif key == "SI":
            inside = False
            break
        elif key == "S" or (key[0] == "S" and key[1:].isdigit()):
            inside = True
            surfaces.append(_new(rest, radius_mode, line, table))
        elif surfaces and inside:
            _take(surfaces[-1], key, rest, line, table)
        else:
            _header(key, rest, line, table)
    return surfaces


def _new(rest: list[str], radius_mode: bool, line: int, table: Table) -> _Surface:
    value, thickness = numbers([*rest, "0", "0"][:2], table.path, line)
    curvature = (1.0 / value if value else 0.0) if radius_mode else value
    return _Surface(line, curvature, thickness, rest[2] if len(rest) > 2 else "")


def _header(key: str, rest: list[str], line: int, table: Table) -> None:
    if key.startswith("TIT"):
        table.name = " ".join(rest).strip("'\"")
    elif key == "DIM" and rest:
        if rest[0].upper()[0] not in UNITS:
            raise InputError(f"{table.path}:{line}: dimension {rest[0]!r} is unknown; known: M, C, I")
        table.unit = UNITS[rest[0].upper()[0]]
    elif key == "EPD":
        table.pupil_diameter = numbers(rest[:1], table.path, line)[0]
    elif key == "FNO":
        table.f_number = numbers(rest[:1], table.path, line)[0]
    elif key == "YAN":
        table.field_degrees = min(max(map(abs, numbers(rest, table.path, line)), default=0.0), 60.0)
    elif key == "YIM":
        table.note(line, "YIM, the field as an image height, is ignored")
    elif key not in QUIET:
        table.note(line, f"{key} is ignored")


def _take(surface: _Surface, key: str, rest: list[str], line: int, table: Table) -> None:
    if key == "STO":
        surface.stop = True
    elif key == "CIR":
        words = [word for word in rest if word.upper() not in ("EDG", "CLR", "OBS", "HOL")]
        surface.diameter = 2 * numbers(words[:1], table.path, line)[0]
    elif key == "K":
        surface.conic = numbers(rest[:1], table.path, line)[0]
    elif key in POWERS:
        surface.aspheric[POWERS[key]] = numbers(rest[:1], table.path, line)[0]
    elif key == "CYL":
        surface.cylinder = "y"
    elif key in TILTS:
        surface.bend[key] = numbers(rest[:1], table.path, line)[0]
    elif key in ("EPD", "FNO", "YAN"):
        _header(key, rest, line, table)
    elif key not in QUIET:
        table.note(line, f"{key} is ignored")


def _row(surface: _Surface, table: Table) -> dict[str, Any]:
    row: dict[str, Any] = {}
    if surface.curvature:
        row["radius"] = 1.0 / surface.curvature
    if surface.stop:
        row["stop"] = True
    if surface.diameter:
        row["diameter"] = surface.diameter
    if surface.conic:
        row["conic"] = surface.conic
    if aspheric := {power: value for power, value in surface.aspheric.items() if value}:
        row["aspheric"] = aspheric
    if surface.cylinder:
        row["cylinder"] = surface.cylinder
    if surface.glass and surface.glass.upper() not in ("AIR", "REFR"):
        if surface.glass.upper() == "REFL":
            raise InputError(f"{table.path}:{surface.line}: mirrors cannot be read; every surface must refract")
        row["glass"] = six_digit_glass(surface.glass) or glass_entry(surface.glass, None, None)
        if row["glass"] is None:
            raise InputError(f"{table.path}:{surface.line}: glass {surface.glass} is not in the bundled table")
    return row


def _three(bend: dict[str, float], names: tuple[str, ...]) -> tuple[float, float, float]:
    x, y, z = (bend.get(name, 0.0) for name in names)
    return x, y, z
