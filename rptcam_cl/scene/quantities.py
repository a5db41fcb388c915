"""Vectors, colours and bounded numbers of a scene."""

from __future__ import annotations

import math
from collections.abc import Callable
from numbers import Integral
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field

from rptcam_cl.scene.colours import Colour, ColourForms, SpectralForm
from rptcam_cl.scene.spectrum_forms import LightSpectrum, TabulatedSpectrum, albedo, coefficient, radiance, tint
from rptcam_cl.scene.values import read_number, refuse

# Bounds that keep squares (intersection) and reciprocals of areas (sampling densities) inside float32,
# also after multiplication with metres_per_unit (1e-6 to 1e6).
LARGEST_COORDINATE = 1e12
SMALLEST_LENGTH = 1e-12

# Bound that leaves room for products with sampling weights and for sums over samples inside float32.
LARGEST_RADIANCE = 1e30


def _whole_number(value: Any) -> int:
    """Return a whole number; 1e3 counts as one."""
    if isinstance(value, Integral) and not isinstance(value, bool):
        return int(value)
    number = read_number(value)
    if number != math.floor(number):
        raise refuse("must be a whole number", allowed="a whole number")
    return int(number)


def list_of(length: int, meaning: str) -> Callable[[Any], Any]:
    """Return a validator that lets pass lists of one length."""

    def check(value: Any) -> Any:
        items = value.tolist() if isinstance(value, np.ndarray) else value
        if not isinstance(items, (list, tuple)):
            raise refuse(f"must be {meaning}", allowed=f"a list of {length} numbers")
        if len(items) != length:
            raise refuse(f"has {len(items)} numbers instead of {length}", allowed=meaning)
        return items

    return check


def _not_zero(value: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return a vector that is long enough to have a direction."""
    if math.hypot(*value) < SMALLEST_LENGTH:
        raise refuse("must not be the zero vector", allowed=f"a length of at least {SMALLEST_LENGTH:g}")
    return value


NUMBER = BeforeValidator(read_number)
WHOLE_NUMBER = BeforeValidator(_whole_number)
TextureNumber = Annotated[float, Field(ge=-1e6, le=1e6), NUMBER]
TexturePair = Annotated[tuple[TextureNumber, TextureNumber], BeforeValidator(list_of(2, "a pair [u, v]"))]
Coordinate = Annotated[float, Field(ge=-LARGEST_COORDINATE, le=LARGEST_COORDINATE), NUMBER]
Length = Annotated[float, Field(ge=SMALLEST_LENGTH, le=LARGEST_COORDINATE), NUMBER]
Turn = Annotated[float, Field(ge=-360, le=360), NUMBER]
LARGEST_GAIN = 1e12
Gain = Annotated[float, Field(ge=0, le=LARGEST_GAIN), NUMBER]
Fraction = Annotated[float, Field(ge=0, le=1), NUMBER]

Position = Annotated[
    tuple[Coordinate, Coordinate, Coordinate], BeforeValidator(list_of(3, "a point or vector [x, y, z]"))
]
Direction = Annotated[Position, AfterValidator(_not_zero)]
Albedo = Annotated[
    Colour, ColourForms(1.0, "would reflect more light than arrives", SpectralForm(TabulatedSpectrum, albedo))
]
Radiance = Annotated[
    Colour, ColourForms(LARGEST_RADIANCE, "is too bright for sums in float32", SpectralForm(LightSpectrum, radiance))
]
LightColour = Annotated[
    Colour, ColourForms(LARGEST_RADIANCE, "is too bright for sums in float32", SpectralForm(LightSpectrum, tint))
]
Coefficient = Annotated[
    Colour, ColourForms(LARGEST_RADIANCE, "is too large for float32", SpectralForm(TabulatedSpectrum, coefficient))
]
PatternAlbedo = Annotated[Colour, ColourForms(1.0, "would reflect more light than arrives")]
GainColour = Annotated[Colour, ColourForms(LARGEST_GAIN, "is too large a factor")]
