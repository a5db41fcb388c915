"""Colours of a scene: numbers of three channels, or spectra."""

from __future__ import annotations

import re
from collections.abc import Callable
from numbers import Real
from typing import Any, NamedTuple

import numpy as np
from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from rptcam_cl.core.references import Folders
from rptcam_cl.scene.spectrum import SpectralColour
from rptcam_cl.scene.spectrum_forms import TabulatedSpectrum
from rptcam_cl.scene.values import number_at, refuse

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
