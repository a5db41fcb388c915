"""Textures: reflectance that changes over the surface coordinates (u, v)."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Tag

from rptcam_cl.scene.base import SceneModel
from rptcam_cl.scene.quantities import Albedo, Fraction, TexturePair

CONSTANT = "constant colour"


class Checker(SceneModel):
    """A chessboard. The cell is floor(u * scale_u + offset_u) + floor(v * scale_v + offset_v)."""

    kind: Literal["checker"]
    """Kind of texture."""

    even: Albedo
    """Reflectance of even cells; a colour of channels 0 to 1."""

    odd: Albedo
    """Reflectance of odd cells; a colour of channels 0 to 1."""

    scale: TexturePair = (1.0, 1.0)
    """Cells per unit of u and of v."""

    offset: TexturePair = (0.0, 0.0)
    """Shift of the pattern [cells]."""


class Grid(SceneModel):
    """Lines on a background: where the fraction of u * scale_u + offset_u, or the same of v, is below `line_width`."""

    kind: Literal["grid"]
    """Kind of texture."""

    background: Albedo
    """Reflectance between the lines; a colour of channels 0 to 1."""

    line: Albedo
    """Reflectance of the lines; a colour of channels 0 to 1."""

    line_width: Fraction
    """Width of a line as a fraction of the cell."""

    scale: TexturePair = (1.0, 1.0)
    """Cells per unit of u and of v."""

    offset: TexturePair = (0.0, 0.0)
    """Shift of the pattern [cells]."""


def _form(value: Any) -> str | None:
    """Return which form of reflectance a value has: a colour, or the kind of texture."""
    if isinstance(value, dict):
        kind = value.get("kind")
        return kind if isinstance(kind, str) else None
    return str(getattr(value, "kind", CONSTANT))


Reflectance = Annotated[
    Annotated[Albedo, Tag(CONSTANT)] | Annotated[Checker, Tag("checker")] | Annotated[Grid, Tag("grid")],
    Discriminator(_form),
]
