"""White balance of the picture: what light is made grey."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, Self, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from rptcam_cl.colour import blackbody, illuminant, srgb_from_spectrum, srgb_from_xyz, xyz_from_spectrum
from rptcam_cl.scene.base import Alternatives, SceneModel
from rptcam_cl.scene.quantities import NUMBER, list_of
from rptcam_cl.scene.values import number_at, refuse

Light = Literal[
    "auto", "A", "D50", "D55", "D65", "D75", "E", "F2", "F7", "F11", "LED-B1", "LED-B2", "LED-B3", "LED-B4", "LED-B5"
]
LIGHTS: tuple[str, ...] = get_args(Light)
COOLEST, HOTTEST = 1800.0, 40000.0  # [K]
TINTS_PER_UV = 3000.0  # as photographers' programs count tint; that of D65 is 10
LEAST_BLUE = 0.06  # least Z of a light with Y = 1; below, an adaptation to white has no sense

Factor = Annotated[float, Field(ge=0.001, le=1000), NUMBER]


def _grey(value: Any) -> tuple[float, ...]:
    """Return a point [x, y] or a rectangle [x0, x1, y0, y1] in fractions of the film."""
    forms = "[x, y] or [x0, x1, y0, y1] with x0 < x1 and y0 < y1, each from 0 to 1"
    if not isinstance(value, (list, tuple)) or len(value) not in (2, 4):
        raise refuse("must be a place of the film", allowed=forms)
    place = tuple(number_at(item, (index,)) for index, item in enumerate(value))
    if not all(0 <= item <= 1 for item in place):
        raise refuse("lies outside the film", allowed=forms)
    if len(place) == 4 and not (place[0] < place[1] and place[2] < place[3]):
        raise refuse("has no area", allowed=forms)
    return place


_SHARE = {"type": "number", "minimum": 0, "maximum": 1}
_GREY_SCHEMA = {"anyOf": [{"type": "array", "items": _SHARE, "minItems": n, "maxItems": n} for n in (2, 4)]}


class WhiteBalance(SceneModel):
    """What light is made grey. One of `light`, `temperature_k`, `grey` and `gains`; a word stands for `light`."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (
        Alternatives(("light", "temperature_k", "grey", "gains"), required=True),
    )

    light: Light | None = None
    """A CIE illuminant; `auto` takes the mean of the picture as grey."""

    temperature_k: Annotated[float, Field(ge=COOLEST, le=HOTTEST), NUMBER] | None = None
    """Temperature of a black body of the light's colour [K]."""

    tint: Annotated[float, Field(ge=-150, le=150), NUMBER] | None = None
    """With `temperature_k`: how much greener than that the light is, 3000 times the distance in CIE 1960 uv."""

    grey: Annotated[tuple[float, ...], BeforeValidator(_grey), WithJsonSchema(_GREY_SCHEMA)] | None = None
    """What is grey in truth: [x, y] or [x0, x1, y0, y1] as fractions of the film from its left and top edges."""

    gains: Annotated[tuple[Factor, Factor, Factor], BeforeValidator(list_of(3, "[red, green, blue]"))] | None = None
    """Factors on linear red, green and blue."""

    adaptation: Literal["channels", "bradford"] | None = None
    """What is scaled: the channels, or the responses of the Bradford transform; by default what suits the film."""

    @model_validator(mode="after")
    def _check_tint(self) -> Self:
        if self.adaptation is not None and self.gains is not None:
            raise refuse("has no use beside gains", got=self.adaptation, allowed="one of both", path=("adaptation",))
        if self.tint is None:
            return self
        if self.temperature_k is None:
            raise refuse("needs temperature_k", got=self.tint, allowed="a temperature beside it", path=("tint",))
        if _xyz_of_temperature(self.temperature_k, self.tint)[2] < LEAST_BLUE:
            raise refuse("is greener than light can be at this temperature", got=self.tint, path=("tint",))
        return self

    def light_colour(self) -> NDArray[np.float64] | None:
        """Return the light in linear sRGB, where it is told by name or temperature."""
        if self.temperature_k is not None:
            return np.asarray(srgb_from_xyz() @ _xyz_of_temperature(self.temperature_k, self.tint or 0.0))
        if self.light is None or self.light == "auto":
            return None
        return srgb_from_spectrum(illuminant(self.light))


def _xyz_of_temperature(kelvin: float, tint: float) -> NDArray[np.float64]:
    """Return X, Y, Z of luminance 1 beside a black body, at right angles to their row in CIE 1960 u, v."""
    here, hotter = _uv(kelvin), _uv(kelvin * 1.001)
    along = (hotter - here) / np.linalg.norm(hotter - here)
    u, v = here + tint / TINTS_PER_UV * np.array([along[1], -along[0]])
    return np.array([1.5 * u / v, 1.0, (2.0 - 0.5 * u) / v - 5.0])


def _uv(kelvin: float) -> NDArray[np.float64]:
    x, y, z = xyz_from_spectrum(blackbody(kelvin))
    return np.asarray(np.array([4 * x, 6 * y]) / (x + 15 * y + 3 * z))
