"""Numbers, vectors and colours of a scene: finite, inside the range of float32, and never text or booleans."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from numbers import Integral, Real
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema
from pydantic_core import PydanticCustomError

from rptcam_cl.scene.refusal import refuse

FLOAT32_MAX = 3.4028234663852886e38
FLOAT32_MIN_NORMAL = 1.1754943508222875e-38

# Bounds that keep squares (intersection) and reciprocals of areas (sampling densities) inside float32,
# also after multiplication with metres_per_unit (1e-6 to 1e6).
LARGEST_COORDINATE = 1e12
SMALLEST_LENGTH = 1e-12

# Bound that leaves room for products with sampling weights and for sums over samples inside float32.
LARGEST_RADIANCE = 1e30

_LOOKS_NUMERIC = re.compile(r"[-+]?[0-9.][0-9_.,:eExXoOa-fA-F+-]*")
_HEX_COLOUR = re.compile(r"#([0-9a-fA-F]{6})")


def read_number(value: Any) -> float:
    """Return a finite float that float32 can hold."""
    if isinstance(value, str):
        hint = "is text, not a number"
        if _LOOKS_NUMERIC.fullmatch(value):
            hint += " (write plain decimal digits without quotes, colons or underscores)"
        raise refuse(hint, allowed="a number")
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, Real):
        raise refuse("must be a number", allowed="a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise refuse("must be finite", allowed="a finite number")
    if abs(number) > FLOAT32_MAX:
        raise refuse("is beyond the range of float32", allowed=f"at most {FLOAT32_MAX:.3g}")
    if 0 < abs(number) < FLOAT32_MIN_NORMAL:
        raise refuse("is below the range of float32", allowed=f"0, or at least {FLOAT32_MIN_NORMAL:.3g} in size")
    return number


def number_at(value: Any, path: tuple[int, ...]) -> float:
    """Return a finite float that float32 can hold, from the given place inside a value."""
    try:
        return read_number(value)
    except PydanticCustomError as problem:
        context = dict(problem.context or {})
        raise refuse(context["problem"], got=value, allowed=context["allowed"], path=path) from None


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


def _linear(byte: int) -> float:
    """Return the linear value of an sRGB byte (IEC 61966-2-1)."""
    encoded = byte / 255
    return encoded / 12.92 if encoded <= 0.04045 else float(((encoded + 0.055) / 1.055) ** 2.4)


def _colour(largest: float, excess: str) -> Callable[[Any], tuple[float, float, float]]:
    """Return a reader of colours whose channels lie in [0, largest]."""
    span = f"0 to {largest:g}"
    forms = f'a number, [red, green, blue] or "#rrggbb", each {span}'

    def channel(value: Any, path: tuple[int, ...]) -> float:
        number = number_at(value, path)
        if number < 0:
            raise refuse("must not be negative", got=value, allowed=span, path=path)
        if number > largest:
            raise refuse(excess, got=value, allowed=span, path=path)
        return number

    def read(value: Any) -> tuple[float, float, float]:
        items = value.tolist() if isinstance(value, np.ndarray) else value
        if isinstance(items, str) and (match := _HEX_COLOUR.fullmatch(items)):
            red, green, blue = (_linear(byte) for byte in bytes.fromhex(match[1]))
            return (red, green, blue)
        if isinstance(items, Real) and not isinstance(items, bool):
            grey = channel(items, ())
            return (grey, grey, grey)
        if not isinstance(items, (list, tuple)):
            raise refuse("must be a colour", allowed=forms)
        if len(items) != 3:
            raise refuse(f"has {len(items)} channels instead of 3", allowed=forms)
        red, green, blue = (channel(item, (index,)) for index, item in enumerate(items))
        return (red, green, blue)

    return read


def _colour_schema(largest: float) -> dict[str, Any]:
    value = {"type": "number", "minimum": 0, "maximum": largest}
    triple = {"type": "array", "items": value, "minItems": 3, "maxItems": 3}
    return {"anyOf": [value, triple, {"type": "string", "pattern": "^#[0-9a-fA-F]{6}$"}]}


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
Colour = tuple[float, float, float]
Albedo = Annotated[
    Colour,
    BeforeValidator(_colour(1.0, "would reflect more light than arrives")),
    WithJsonSchema(_colour_schema(1.0)),
]
Radiance = Annotated[
    Colour,
    BeforeValidator(_colour(LARGEST_RADIANCE, "is too bright for sums in float32")),
    WithJsonSchema(_colour_schema(LARGEST_RADIANCE)),
]
GainColour = Annotated[
    Colour,
    BeforeValidator(_colour(LARGEST_GAIN, "is too large a factor")),
    WithJsonSchema(_colour_schema(LARGEST_GAIN)),
]
