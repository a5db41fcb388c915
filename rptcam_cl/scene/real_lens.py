"""A lens that is not quite its design: a copy made within tolerances."""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import BeforeValidator, Discriminator, Field, Tag, WithJsonSchema

from rptcam_cl.scene.base import AlsoAccepts, SceneModel, refuse
from rptcam_cl.scene.lens_settings import MAX_TEXT, LensReference

GRADES = ("commercial", "precision", "high_precision")
DESIGN, REAL = "a design", "a real lens"  # forms of a lens; not keys
_PERCENT = re.compile(r"([0-9]{1,3}(?:\.[0-9]{1,6})?) *%")
_PATTERN = r"^[0-9]{1,3}(\.[0-9]{1,6})? *%$"


def _check_percent(value: Any) -> str:
    """Return a percentage that is written with its sign."""
    match = _PERCENT.fullmatch(value.strip()) if isinstance(value, str) else None
    if match is None or not 0 < float(match[1]) <= 100:
        raise refuse("is no percentage of copies", allowed="above 0 % to 100 %, with its sign: 90%")
    return str(value)


PERCENTAGE = {"type": "string", "pattern": _PATTERN}
Percent = Annotated[str, BeforeValidator(_check_percent), WithJsonSchema(PERCENTAGE)]


class AsBuilt(SceneModel):
    """One of many copies of the lens that are made within tolerances."""

    percentile: Percent
    """Which copy: so many of all are as good or better, `90%` one of the worse."""

    spec: Annotated[str, Field(min_length=1, max_length=MAX_TEXT)] = "commercial"
    """The tolerances: a grade (`commercial`, `precision`, `high_precision`), or a file in the scene's folder."""

    @property
    def percent(self) -> float:
        """The number of the percentile."""
        return float(self.percentile.strip().removesuffix("%"))


def _from_percentile(value: Any) -> Any:
    return value if isinstance(value, (dict, SceneModel)) else {"percentile": value}


class RealLens(SceneModel):
    """A lens as it is made, or as heat has it."""

    design: LensReference
    """The lens by name, file or prescription, as `lens` alone would be."""

    as_built: Annotated[AsBuilt, BeforeValidator(_from_percentile), AlsoAccepts(PERCENTAGE)] | None = None
    """Which copy of it; the design itself by default."""


def _form(value: Any) -> str:
    return REAL if isinstance(value, RealLens) or (isinstance(value, dict) and "design" in value) else DESIGN


LensOrDesign = Annotated[
    Annotated[LensReference, Tag(DESIGN)] | Annotated[RealLens, Tag(REAL)],
    Discriminator(_form),
]


def with_design(value: Any, key: str) -> Any:
    """Return the data of a lens that has keys of a `RealLens`, one of which is to be set."""
    has_keys = not isinstance(value, (str, dict)) or (isinstance(value, dict) and "design" in value)
    return value if value is None or has_keys or key not in RealLens.model_fields else {"design": value}
