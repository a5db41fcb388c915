"""Rays from files: JSON, or CSV with columns x, y, z, dx, dy, dz and perhaps wavelength_nm."""

import csv
import json
import math
import sys
from typing import Any

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError

COLUMNS = ("x", "y", "z", "dx", "dy", "dz")

_Ray = tuple[list[float], float | None]  # point and direction, and perhaps a wavelength


@dataclass(frozen=True)
class RayList:
    """Rays to trace: points [mm], directions and wavelengths [nm]."""

    origins: list[list[float]]
    directions: list[list[float]]
    wavelengths: list[float]


def read_rays(name: str, wavelength_nm: float) -> RayList:
    """The rays of a file, or of standard input for ``-``; those without a wavelength get the one given."""
    try:
        if name == "-":
            text = sys.stdin.read()
        else:
            with open(name, encoding="utf-8-sig") as file:  # noqa: PTH123, as a Path would turn "-" into a name
                text = file.read()
    except UnicodeDecodeError:
        raise InputError(f"{name}: is not text; rays are JSON or CSV") from None
    start = text.lstrip()[:1]
    if not start:
        raise InputError(f"{name}: holds no rays")
    rows = _from_json(text, name) if start in "[{" else _from_csv(text, name)
    rays = RayList([], [], [])
    for place, (values, wavelength) in rows:
        _check(place, values, wavelength)
        rays.origins.append(values[:3])
        rays.directions.append(values[3:])
        rays.wavelengths.append(wavelength_nm if wavelength is None else wavelength)
    if not rays.origins:
        raise InputError(f"{name}: holds no rays")
    return rays


def _check(place: str, values: list[float], wavelength: float | None) -> None:
    if not all(map(math.isfinite, values)):
        raise InputError(f"{place}: every number must be finite")
    if not any(values[3:]):
        raise InputError(f"{place}: the direction is 0, 0, 0")
    if wavelength is not None and not 0 < wavelength < math.inf:
        raise InputError(f"{place}: wavelength_nm must be above 0 (got {wavelength:g})")


def _from_json(text: str, name: str) -> list[tuple[str, _Ray]]:
    try:
        data = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        raise InputError(f"{name}: is not JSON: {error}") from None
    rows = data.get("rays") if isinstance(data, dict) else data
    if not isinstance(rows, list):
        raise InputError(f'{name}: expected a list of rays, or {{"rays": [...]}}')
    return [(f"{name}: ray {i}", _from_mapping(row, f"{name}: ray {i}")) for i, row in enumerate(rows)]


def _from_mapping(row: Any, place: str) -> _Ray:
    form = '{"origin": [x, y, z], "direction": [dx, dy, dz], "wavelength_nm": w}'
    if not isinstance(row, dict) or not {"origin", "direction"} <= row.keys():
        raise InputError(f"{place}: expected {form}")
    unknown = row.keys() - {"origin", "direction", "wavelength_nm"}
    if unknown:
        raise InputError(f"{place}: unknown key {sorted(unknown)[0]!r}; expected {form}")
    values = [row["origin"], row["direction"]]
    if not all(isinstance(part, list) and len(part) == 3 and all(map(_is_number, part)) for part in values):
        raise InputError(f"{place}: origin and direction are three numbers each")
    wavelength = row.get("wavelength_nm")
    if wavelength is not None and not _is_number(wavelength):
        raise InputError(f"{place}: wavelength_nm must be a number")
    return [float(value) for part in values for value in part], None if wavelength is None else float(wavelength)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


def _from_csv(text: str, name: str) -> list[tuple[str, _Ray]]:
    rows: list[tuple[str, _Ray]] = []
    for number, words in enumerate(csv.reader(text.splitlines()), start=1):
        place = f"{name}:{number}"
        cells = [word.strip() for word in words]
        if not any(cells) or cells[0].startswith("#"):
            continue
        if not rows and cells[0] == COLUMNS[0]:
            if tuple(cells[:6]) != COLUMNS or cells[6:] not in ([], ["wavelength_nm"]):
                raise InputError(f"{place}: expected the columns {', '.join(COLUMNS)} and perhaps wavelength_nm")
            continue
        if len(cells) not in (6, 7):
            raise InputError(
                f"{place}: expected {', '.join(COLUMNS)} and perhaps wavelength_nm (got {len(cells)} cells)"
            )
        try:
            values = [float(cell) for cell in cells]
        except ValueError as error:
            raise InputError(f"{place}: expected numbers ({error})") from None
        rows.append((place, (values[:6], values[6] if len(values) == 7 else None)))
    return rows
