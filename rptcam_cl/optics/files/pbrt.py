"""Lens tables of pbrt and of the CS348b assignments: radius, axial distance, index, diameter in four columns.

Two conventions share the suffix. In newer files the second column is the thickness to the next row; in the older ones
(`axpos`) it is the gap from the previous row. The gap before the first surface and after the last one are not part of
a lens, so the older files start with 0 and the newer ones end with 0 or with the distance to the film.
"""

from __future__ import annotations

import math
from dataclasses import replace

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.files.checks import check_lens
from rptcam_cl.optics.glass import AIR, ConstantIndex, Medium
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.surface import Surface

COLUMNS = ("radius", "axial distance", "index", "diameter")


@dataclass(frozen=True)
class _Row:
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
