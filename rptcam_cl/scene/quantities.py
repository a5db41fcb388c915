"""Numbers, vectors, colours and durations of a scene, and their bounds."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from numbers import Integral, Real
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, GetCoreSchemaHandler, GetJsonSchemaHandler, WithJsonSchema
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from rptcam_cl.core.references import Folders
from rptcam_cl.scene.base import number_at, read_number, refuse
from rptcam_cl.scene.spectrum import SpectralColour
from rptcam_cl.scene.spectrum_forms import LightSpectrum, TabulatedSpectrum, albedo, coefficient, radiance, tint

Colour = tuple[float, float, float]

# Names of the two forms in the locations of errors; they are no keys.
CHANNELS, SPECTRUM = "channels", "a spectrum"

_HEX_COLOUR = re.compile(r"#([0-9a-fA-F]{6})")


class SpectralForm(NamedTuple):
    """How a colour is read from a spectrum: the keys that it has, and what makes a colour of them."""

    keys: type[TabulatedSpectrum]
    read: Callable[[Any, Folders], SpectralColour]


class ColourForms:
    """How a colour may be written; stands beside the type of a field.

    Parameters
    ----------
    largest : float
        Largest value of a channel.
    excess : str
        What is wrong with larger ones, as a sentence without its subject.
    spectrum : SpectralForm, optional
        How a spectrum may stand for it; by default none may.
    """

    def __init__(self, largest: float, excess: str, spectrum: SpectralForm | None = None) -> None:
        self.largest = largest
        self.excess = excess
        self.spectrum = spectrum

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Return what checks either form."""
        schema: CoreSchema = core_schema.no_info_plain_validator_function(self._channels)
        if self.spectrum is not None:
            keys = handler.generate_schema(self.spectrum.keys)
            spectral = core_schema.with_info_after_validator_function(self._spectrum, keys)
            schema = core_schema.tagged_union_schema({CHANNELS: schema, SPECTRUM: spectral}, _form)
        return core_schema.no_info_after_validator_function(
            lambda colour: colour,
            schema,
            serialization=core_schema.plain_serializer_function_ser_schema(_plain, when_used="json"),
        )

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Return the JSON schema of all forms."""
        value = {"type": "number", "minimum": 0, "maximum": self.largest}
        triple = {"type": "array", "items": value, "minItems": 3, "maxItems": 3}
        forms: list[Any] = [value, triple, {"type": "string", "pattern": "^#[0-9a-fA-F]{6}$"}]
        if self.spectrum is not None:
            described: Any = schema
            forms.append(handler(described["schema"]["choices"][SPECTRUM]))
        return {"anyOf": forms}

    def _spectrum(self, spectrum: TabulatedSpectrum, info: core_schema.ValidationInfo) -> SpectralColour:
        assert self.spectrum is not None
        folders = info.context["folders"] if info.context else Folders()
        made = self.spectrum.read(spectrum, folders)
        if max(made) > self.largest or made.samples.max() > self.largest:
            raise refuse(self.excess, got=max(made), allowed=f"0 to {self.largest:g}")
        return made

    def _channels(self, value: Any) -> Colour:
        items = value.tolist() if isinstance(value, np.ndarray) else value
        if isinstance(items, SpectralColour):
            return items
        if isinstance(items, str) and (match := _HEX_COLOUR.fullmatch(items)):
            red, green, blue = (_linear(byte) for byte in bytes.fromhex(match[1]))
            return (red, green, blue)
        if isinstance(items, Real) and not isinstance(items, bool):
            grey = self._channel(items, ())
            return (grey, grey, grey)
        forms = f'a number, [red, green, blue] or "#rrggbb", each 0 to {self.largest:g}'
        forms += "; or a spectrum" if self.spectrum is not None else ""
        if not isinstance(items, (list, tuple)):
            raise refuse("must be a colour", allowed=forms)
        if len(items) != 3:
            raise refuse(f"has {len(items)} channels instead of 3", allowed=forms)
        red, green, blue = (self._channel(item, (index,)) for index, item in enumerate(items))
        return (red, green, blue)

    def _channel(self, value: Any, path: tuple[int, ...]) -> float:
        span = f"0 to {self.largest:g}"
        number = number_at(value, path)
        if number < 0:
            raise refuse("must not be negative", got=value, allowed=span, path=path)
        if number > self.largest:
            raise refuse(self.excess, got=value, allowed=span, path=path)
        return number


def _form(value: Any) -> str:
    is_spectrum = isinstance(value, TabulatedSpectrum) or (isinstance(value, dict) and "kind" not in value)
    return SPECTRUM if is_spectrum else CHANNELS


def _plain(colour: Colour) -> Any:
    """Return a colour as plain data."""
    return colour.described() if isinstance(colour, SpectralColour) else list(colour)


def _linear(byte: int) -> float:
    """Return the linear value of an sRGB byte (IEC 61966-2-1)."""
    encoded = byte / 255
    return encoded / 12.92 if encoded <= 0.04045 else float(((encoded + 0.055) / 1.055) ** 2.4)


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
Metres = Annotated[float, Field(ge=1e-9, le=1e12), NUMBER]
Millimetres = Annotated[float, Field(ge=1e-6, le=1e12), NUMBER]
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

SHORTEST_S = 1e-9
LONGEST_S = 1e9

_FRACTION = re.compile(r"\s*([0-9]{1,9}(?:\.[0-9]{1,9})?)\s*/\s*([0-9]{1,9}(?:\.[0-9]{1,9})?)\s*")
_FRACTION_FOR_EDITORS = "[0-9]{1,9}(\\.[0-9]{1,9})? */ *[0-9]{1,9}(\\.[0-9]{1,9})? *$"


def _read_duration(value: Any) -> float:
    """Return a number of seconds, or the value of a fraction as engraved on cameras: 1/125."""
    if not isinstance(value, str):
        return read_number(value)
    match = _FRACTION.fullmatch(value)
    if match is None or float(match[2]) == 0:
        problem = "divides by zero" if match else "is neither a number nor a fraction"
        raise refuse(problem, allowed="seconds, as 0.008 or 1/125")
    return float(match[1]) / float(match[2])


def _read_moment(value: Any) -> float:
    """Return a number of seconds or the value of a fraction, which may be negative: -1/125."""
    if isinstance(value, str) and value.strip().startswith("-"):
        return -_read_duration(value.strip()[1:])
    return _read_duration(value)


def _seconds_schema(least: float, sign: str = "") -> WithJsonSchema:
    number = {"type": "number", "minimum": least, "maximum": LONGEST_S}
    return WithJsonSchema({"anyOf": [number, {"type": "string", "pattern": f"^ *{sign}{_FRACTION_FOR_EDITORS}"}]})


Duration = Annotated[
    float, Field(ge=SHORTEST_S, le=LONGEST_S), BeforeValidator(_read_duration), _seconds_schema(SHORTEST_S)
]
Moment = Annotated[
    float, Field(ge=-LONGEST_S, le=LONGEST_S), BeforeValidator(_read_moment), _seconds_schema(-LONGEST_S, "-?")
]
