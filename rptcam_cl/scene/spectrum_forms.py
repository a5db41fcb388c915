"""How a scene writes spectra: the keys of each form, and the colour that they stand for."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import BeforeValidator, ConfigDict, Field, WithJsonSchema, model_validator

from rptcam_cl.colour import (
    COOLEST_DAYLIGHT,
    HOTTEST_DAYLIGHT,
    Spectrum,
    blackbody,
    daylight,
    exact_luminance,
    illuminant,
    lines_on_grid,
    on_grid,
)
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.references import Folders
from rptcam_cl.scene.base import Alternatives, SceneModel, read_number, refuse
from rptcam_cl.scene.file_reference import FileName
from rptcam_cl.scene.spectrum import LARGEST_VALUE, Lines, SpectralColour, fault_of, numbers_of, read_lines, read_rows

_NUMBERS = {"type": "array", "items": {"type": "number"}, "minItems": 2}
Numbers = Annotated[tuple[float, ...], BeforeValidator(numbers_of), WithJsonSchema(_NUMBERS)]
Factor = Annotated[float, Field(gt=0, le=LARGEST_VALUE), BeforeValidator(read_number)]
IlluminantName = Literal[
    "A", "D50", "D55", "D65", "D75", "E", "F2", "F7", "F11", "LED-B1", "LED-B2", "LED-B3", "LED-B4", "LED-B5"
]


class TabulatedSpectrum(SceneModel):
    """A spectrum as a table, with straight lines between its rows."""

    model_config = ConfigDict(
        json_schema_extra={"dependentRequired": {"wavelengths_nm": ["values"], "values": ["wavelengths_nm"]}}
    )

    wavelengths_nm: Numbers | None = None
    """Wavelengths of the rows [nm], rising; beside `values`."""

    values: Numbers | None = None
    """Values of the rows."""

    file: FileName | None = None
    """Table in the scene's folder: a wavelength [nm] and a value a line."""

    scale: Factor | None = None
    """Factor on the spectrum as it is given."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (Alternatives(("wavelengths_nm", "file"), required=True),)

    @model_validator(mode="after")
    def _check_rows(self) -> Self:
        if self.wavelengths_nm is None:
            if self.values is not None:
                raise refuse("needs wavelengths_nm beside it", got=self.values, path=("values",))
            return self
        if self.values is None or len(self.values) != len(self.wavelengths_nm):
            count = len(self.wavelengths_nm)
            raise refuse("does not fit wavelengths_nm", got=self.values, allowed=f"{count} numbers", path=("values",))
        fault = fault_of(self.wavelengths_nm)
        if fault is not None:
            index, problem = fault
            raise refuse(
                problem, got=self.wavelengths_nm[index], allowed="rising wavelengths in nm",
                path=("wavelengths_nm", index),
            )  # fmt: skip
        return self

    def rows(self, folders: Folders, largest: float, excess: str) -> tuple[Spectrum, Spectrum]:
        """Return wavelengths [nm] and values of the table, scaled; they lie in 0 … largest."""
        where: tuple[str | int, ...]
        if self.file is not None:
            try:
                wavelengths, (values,) = read_rows(self.file, folders)
            except InputError as problem:
                raise refuse(str(problem), got=self.file, path=("file",)) from None
        else:
            wavelengths, values = np.array(self.wavelengths_nm), np.array(self.values)
        scaled = values * (self.scale or 1.0)
        wrong = np.flatnonzero((scaled < 0) | (scaled > largest))
        if len(wrong):
            index = int(wrong[0])
            where = ("file",) if self.file is not None else ("values", index)
            place = f"holds at {wavelengths[index]:g} nm a value that " if self.file is not None else ""
            hint = "; of per cent with `scale: 0.01`" if largest == 1 and scaled.max() <= 100 else ""
            raise refuse(
                place + ("must not be negative" if scaled[index] < 0 else excess), got=float(scaled[index]),
                allowed=f"0 to {largest:g}{hint}", path=where,
            )  # fmt: skip
        return wavelengths, scaled


class LightSpectrum(TabulatedSpectrum):
    """The spectrum of a light, and how much there is of it."""

    blackbody_k: Annotated[float, Field(ge=500, le=1e5), BeforeValidator(read_number)] | None = None
    """Temperature of a black body [K]."""

    daylight_k: (
        Annotated[float, Field(ge=COOLEST_DAYLIGHT, le=HOTTEST_DAYLIGHT), BeforeValidator(read_number)] | None
    ) = None
    """Correlated colour temperature of daylight [K]."""

    illuminant: IlluminantName | None = None
    """Name of a CIE illuminant."""

    lines_nm: Annotated[Lines, BeforeValidator(read_lines), WithJsonSchema(
        {"type": "object", "additionalProperties": {"type": "number", "exclusiveMinimum": 0}, "minProperties": 1}
    )] | None = None  # fmt: skip
    """Lines: a mapping from wavelength [nm] to amount."""

    luminance: Factor | None = None
    """Luminance of the whole; 1 is that of the colour 1, 683 cd/m²."""

    watts: Factor | None = None
    """Sum over the wavelengths from 380 to 780 nm [W/(m² sr), W/sr or W/m², as the key says it stands under]."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (
        Alternatives(
            ("wavelengths_nm", "file", "blackbody_k", "daylight_k", "illuminant", "lines_nm"), required=True
        ),
        Alternatives(("scale", "luminance", "watts"), required=False),
    )  # fmt: skip

    def light(self, folders: Folders) -> SpectralColour:
        """Return the light, in the amount that its keys give, or in its own."""
        samples, lines = self._shape(folders)
        own = SpectralColour.of_light(samples, lines)
        if self.scale is not None and self.file is None and self.wavelengths_nm is None:
            return own.scaled(self.scale)
        if self.luminance is None and self.watts is None:
            return own
        amount = float(exact_luminance(own)) if self.luminance is not None else float(samples.sum())
        if amount <= 0:
            raise refuse("is dark, and cannot be made bright", allowed="a spectrum with light from 380 to 780 nm")
        return own.scaled((self.luminance or self.watts or 1.0) / amount)

    def emission(self, folders: Folders) -> SpectralColour:
        """Return the light; what has no amount of its own needs one."""
        relative = "daylight_k" if self.daylight_k is not None else "illuminant" if self.illuminant else None
        if relative is not None and self.scale is not None:
            raise refuse(
                f"means nothing for {relative}, which has no amount of its own", got=self.scale,
                allowed="luminance or watts instead", path=("scale",),
            )  # fmt: skip
        if relative is not None and self.luminance is None and self.watts is None:
            raise refuse(f"{relative} needs an amount beside it", allowed="luminance or watts")
        if self.blackbody_k is not None and not (self.scale or self.luminance or self.watts):
            raise refuse("blackbody_k needs an amount beside it", allowed="scale (1: Planck's law), luminance or watts")
        return self.light(folders)

    def _shape(self, folders: Folders) -> tuple[Spectrum, Lines]:
        if self.blackbody_k is not None:
            return blackbody(self.blackbody_k), ()
        if self.daylight_k is not None:
            return daylight(self.daylight_k), ()
        if self.illuminant is not None:
            return illuminant(self.illuminant), ()
        if self.lines_nm is not None:
            return lines_on_grid(self.lines_nm), self.lines_nm
        rows = self.rows(folders, LARGEST_VALUE, "is too bright for sums in float32")
        return on_grid(*rows, beyond=0.0), ()


def albedo(spectrum: TabulatedSpectrum, folders: Folders) -> SpectralColour:
    """Return shares of light; the table's ends hold beyond it."""
    return SpectralColour.of_reflectance(on_grid(*spectrum.rows(folders, 1.0, "would reflect more light than arrives")))


def coefficient(spectrum: TabulatedSpectrum, folders: Folders) -> SpectralColour:
    """Return coefficients of absorption; the table's ends hold beyond it."""
    return SpectralColour.of_coefficient(on_grid(*spectrum.rows(folders, LARGEST_VALUE, "is too large for float32")))


def radiance(spectrum: LightSpectrum, folders: Folders) -> SpectralColour:
    """Return the light of an emitter."""
    return spectrum.emission(folders)


def tint(spectrum: LightSpectrum, folders: Folders) -> SpectralColour:
    """Return light of luminance 1."""
    made = spectrum.light(folders)
    bright = float(exact_luminance(made))
    if bright <= 0:
        raise refuse("is dark, and has no colour", allowed="a spectrum with light from 380 to 780 nm")
    return made.scaled(1 / bright)
