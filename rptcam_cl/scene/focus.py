"""Where a real lens is focused."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from rptcam_cl.scene.autofocus import AutoFocusOrMethod, ObjectName
from rptcam_cl.scene.base import Alternatives, SceneModel, refuse
from rptcam_cl.scene.quantities import NUMBER, Fraction, Metres, Millimetres, Position, list_of


class Focus(SceneModel):
    """Focus of a real lens: where the object plane, the film or the group is. Exactly one of these, or `auto`.

    The eye is the centre of the film, so `distance_m`, `point` and `object` fix a plane of the scene, at right angles
    to the axis. `front_distance_m` fixes it relative to the lens: the plane lies farther from the eye by the length of
    the lens and the film distance, which follow from it.
    """

    alternatives: ClassVar[tuple[Alternatives, ...]] = (
        Alternatives(
            ("distance_m", "front_distance_m", "point", "object", "film_distance_mm", "group_shift_mm", "auto"),
            required=True,
        ),
    )

    distance_m: Metres | None = None
    """Distance from the object plane in focus to the film [m]."""

    front_distance_m: Metres | None = None
    """Distance from the object plane in focus to the first vertex of the lens [m]."""

    point: Position | None = None
    """A point of the object plane in focus [scene units]."""

    object: ObjectName | None = None
    """Name of an object that the focus follows: the object plane goes through the middle of the box round it, where
    camera and object are when the shutter opens."""

    film_distance_mm: Millimetres | None = None
    """Distance from the last vertex of the lens to the film [mm]."""

    group_shift_mm: Annotated[float, Field(ge=-1e6, le=1e6), NUMBER] | None = None
    """How far the focusing group of the lens stands towards the film from its place in the lens file [mm]; of
    floating groups the change of the gap that changes most."""

    auto: AutoFocusOrMethod | None = None
    """Autofocus."""

    method: Literal["thick", "spot"] = "thick"
    """How the film distance of an object plane is found: first-order optics, or the least spot of traced rays."""

    field: Annotated[tuple[Fraction, Fraction], BeforeValidator(list_of(2, "[x, y]"))] | None = None
    """With method `spot`: where in the picture the spot is least, as fractions from its left and top edges; on the
    axis by default."""

    @model_validator(mode="after")
    def _check_method(self) -> Self:
        given = [key for key in ("film_distance_mm", "group_shift_mm", "auto") if getattr(self, key) is not None]
        if self.method != "thick" and given:
            raise refuse(
                f"seeks the film distance, which {given[0]} gives already",
                got=self.method,
                allowed="distance_m, front_distance_m, point or object beside it",
                path=("method",),
            )
        if self.field is not None and self.method != "spot":
            raise refuse(
                "says where the spot is least",
                got=list(self.field),
                allowed="method: spot beside it",
                path=("field",),
            )
        return self
