"""Autofocus settings of a scene: the method, where in the picture, and which of several zones is used."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, get_args

from pydantic import BeforeValidator, Field, model_validator

from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.scene.base import AlsoAccepts, Alternatives, SceneModel, listed, near_name, refuse
from rptcam_cl.scene.file_reference import FileReference
from rptcam_cl.scene.quantities import Fraction, list_of

LARGEST = 1 << 20  # bytes
MOST_ZONES = 1000
COLUMNS = 4
_WORD = re.compile("[A-Za-z_]+")


def read_zones(source: Path | bytes, name: str) -> tuple[ZoneFractions, ...]:
    """Return the zones of a file.

    A line holds xleft, xright, ytop and ybottom as fractions of the picture from its top left corner, separated by
    blanks, tabs or commas. What follows a # is a comment; empty lines and a heading of four words are left out.

    Parameters
    ----------
    source
        The file, or its content.
    name
        What errors call it.

    Raises
    ------
    InputError
        ``NAME:LINE: ...`` when a line is not a zone, or there is none.
    StateError
        When the file cannot be read.
    """
    try:
        data = source if isinstance(source, bytes) else _start_of(source)
    except OSError as problem:
        raise StateError(f"{name}: cannot be read ({problem.strerror})") from None
    try:
        text = data[:LARGEST].decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{name}: is not a text file (allowed: lines of xleft xright ytop ybottom)") from None
    zones: list[ZoneFractions] = []
    heading = False
    for number, line in enumerate(text.splitlines(), start=1):
        words = re.split(r"[\s,;]+", line.partition("#")[0].strip(" \t,;"))
        if words == [""]:
            continue
        if not (zones or heading) and len(words) == COLUMNS and all(map(_WORD.fullmatch, words)):
            heading = True
            continue
        zones.append(_zone(words, f"{name}:{number}"))
    if not zones:
        raise InputError(f"{name}: holds no zones (allowed: a line each of xleft xright ytop ybottom)")
    if len(zones) > MOST_ZONES or len(data) > LARGEST:
        raise InputError(f"{name}: is too long (allowed: up to {MOST_ZONES} zones)")
    return tuple(zones)


def _start_of(file: Path) -> bytes:
    """Return as much of a file as may be read, and a byte more where it is longer."""
    with file.open("rb") as stream:
        return stream.read(LARGEST + 1)


def _zone(words: list[str], place: str) -> ZoneFractions:
    try:
        left, right, top, bottom = (float(word) for word in words)
    except ValueError:
        raise InputError(
            f"{place}: is not a zone (got {' '.join(words)[:80]}; allowed: four numbers xleft xright ytop ybottom)"
        ) from None
    if not (0 <= left < right <= 1 and 0 <= top < bottom <= 1 and math.isfinite(left + right + top + bottom)):
        raise InputError(
            f"{place}: is not inside the picture (got {' '.join(words)};"
            " allowed: 0 <= xleft < xright <= 1 and 0 <= ytop < ybottom <= 1)"
        )
    return left, right, top, bottom


Method = Literal["contrast", "laplacian", "variance", "depth", "phase", "hybrid"]
METHODS: tuple[Method, ...] = get_args(Method)
Policy = Literal["closest", "farthest", "centre", "weighted"]
POLICIES: tuple[Policy, ...] = get_args(Policy)
ObjectName = Annotated[str, Field(max_length=200)]
ZONE = "[x0, x1, y0, y1]"

ZoneFractions = tuple[float, float, float, float]
"""Left, right, top and bottom of a zone in fractions of the picture from its left and top edges."""


def _list_of_zones(value: Any) -> Any:
    if not isinstance(value, (list, tuple)) or not value:
        raise refuse("must be a list of zones", allowed=f"as [{ZONE}, …], in fractions of the picture")
    for index, zone in enumerate(value):
        list_of(4, ZONE)(zone) if isinstance(zone, (list, tuple)) else _not_a_zone(zone, index)
    return value


def _not_a_zone(value: Any, index: int) -> None:
    raise refuse(f"must be {ZONE}", got=value, allowed="four fractions of the picture", path=(index,))


class ZonesFile(FileReference):
    """Zones in a text file: a line each of left, right, top and bottom in fractions of the picture."""


class AutoFocus(SceneModel):
    """Autofocus. At most one of `zones`, `zones_from`, `point` and `object`; by default a zone in the middle."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (
        Alternatives(("zones", "zones_from", "point", "object"), required=False),
    )

    method: Method = "contrast"
    """How the focus is found."""

    zones: (
        Annotated[
            tuple[tuple[Fraction, Fraction, Fraction, Fraction], ...],
            BeforeValidator(_list_of_zones),
        ]
        | None
    ) = None
    """Rectangles of the picture to focus on, [x0, x1, y0, y1] each as fractions from its left and top edges."""

    zones_from: ZonesFile | None = None
    """The same from a file."""

    point: Annotated[tuple[Fraction, Fraction], BeforeValidator(list_of(2, "[x, y]"))] | None = None
    """A point of the picture to focus on, as fractions from its left and top edges."""

    object: ObjectName | None = None
    """Name of the object to focus on, wherever it is seen."""

    policy: Policy = "closest"
    """Which of several zones decides."""

    draw_zones: Annotated[bool, Field(strict=True)] = False
    """Whether the zones are drawn into PNG files as white rectangles."""

    @model_validator(mode="after")
    def _check_zones(self) -> Self:
        for index, zone in enumerate(self.zones or ()):
            if not (zone[0] < zone[1] and zone[2] < zone[3]):
                raise refuse(
                    "has no area",
                    got=list(zone),
                    allowed="0 <= x0 < x1 <= 1 and 0 <= y0 < y1 <= 1",
                    path=("zones", index),
                )
        return self


def _from_method(value: object) -> object:
    """Return the mapping of an autofocus that is only a method."""
    if not isinstance(value, str):
        return value
    if value not in METHODS:
        raise refuse(f"is no method{near_name(value, METHODS)}", got=value, allowed=f"{listed(METHODS)} or a mapping")
    return {"method": value}


AutoFocusOrMethod = Annotated[
    AutoFocus, BeforeValidator(_from_method), AlsoAccepts({"enum": list(METHODS), "description": "A method alone."})
]


class FoundFocus(SceneModel):
    """Focus of a thin lens that is found: by autofocus, or on an object. Exactly one of these."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (Alternatives(("auto", "object"), required=True),)

    auto: AutoFocusOrMethod | None = None
    """Autofocus."""

    object: ObjectName | None = None
    """Name of an object that the focus follows, as with other lenses."""
