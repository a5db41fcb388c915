"""Autofocus as a scene asks for it: how, where in the picture, and which of several places decides."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, Self, get_args

from pydantic import BeforeValidator, Field, model_validator

from rptcam_cl.scene.base import AlsoAccepts, Alternatives, SceneModel
from rptcam_cl.scene.file_reference import FileReference
from rptcam_cl.scene.quantities import Fraction, list_of
from rptcam_cl.scene.refusal import listed, near_name, refuse

Method = Literal["contrast", "laplacian", "variance", "depth", "phase", "hybrid"]
METHODS: tuple[Method, ...] = get_args(Method)
Policy = Literal["closest", "farthest", "centre", "weighted"]
POLICIES: tuple[Policy, ...] = get_args(Policy)
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

    object: Annotated[str, Field(max_length=200)] | None = None
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


class OnlyAuto(SceneModel):
    """Focus of a thin lens by autofocus."""

    auto: AutoFocusOrMethod
    """How to focus."""
