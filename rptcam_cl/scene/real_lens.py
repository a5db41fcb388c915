"""A lens that is not quite its design: a copy made within tolerances."""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import BeforeValidator, Discriminator, Field, Tag, WithJsonSchema

from rptcam_cl.optics import BARRELS, STANDARD_C, STANDARD_HPA, Heat
from rptcam_cl.scene.base import AlsoAccepts, SceneModel, near_name, read_number, refuse
from rptcam_cl.scene.lens_settings import MAX_TEXT, LensReference
from rptcam_cl.scene.quantities import NUMBER

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


LEAST_EXPANSION, MOST_EXPANSION = -1e-5, 1e-3  # of barrels [1/K]
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


def _check_barrel(value: Any) -> str | float:
    """Return a material, or an expansion."""
    allowed = f"{', '.join(BARRELS)}, or a linear expansion from {LEAST_EXPANSION:g} to {MOST_EXPANSION:g} per kelvin"
    if isinstance(value, str):
        if value not in BARRELS:
            raise refuse(f"is no material of a barrel{near_name(value, list(BARRELS))}", allowed=allowed)
        return value
    number = read_number(value)
    if not LEAST_EXPANSION <= number <= MOST_EXPANSION:
        raise refuse("is no linear expansion", allowed=allowed)
    return number


BARREL_FORMS = {
    "anyOf": [
        {"enum": list(BARRELS)},
        {"type": "number", "minimum": LEAST_EXPANSION, "maximum": MOST_EXPANSION},
    ]
}


class RealLens(SceneModel):
    """A lens as it is made, or as heat has it."""

    design: LensReference
    """The lens by name, file or prescription, as `lens` alone would be."""

    as_built: Annotated[AsBuilt, BeforeValidator(_from_percentile), AlsoAccepts(PERCENTAGE)] | None = None
    """Which copy of it; the design itself by default."""

    temperature_c: Annotated[float, Field(ge=-100, le=140), NUMBER] = 20.0
    """Temperature of the lens and the air around it [degrees Celsius]."""

    pressure_hpa: Annotated[float, Field(ge=0, le=2000), NUMBER] = 1013.25
    """Pressure of that air [hPa]."""

    barrel: Annotated[str | float, BeforeValidator(_check_barrel), WithJsonSchema(BARREL_FORMS)] = "aluminium"
    """What holds elements and film: a material, or its linear expansion [1/K]."""

    @property
    def heat(self) -> Heat | None:
        """What it is exposed to; None at 20 degrees and standard pressure."""
        barrel = self.barrel if isinstance(self.barrel, float) else BARRELS[self.barrel]
        heat = Heat(self.temperature_c, self.pressure_hpa, barrel)
        return None if (heat.celsius, heat.pressure_hpa) == (STANDARD_C, STANDARD_HPA) else heat


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
