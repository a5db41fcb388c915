"""Numbers, vectors, colours, spectra and durations of a scene, and their bounds."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from numbers import Integral, Real
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    WithJsonSchema,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from rptcam_cl.core.colour import (
    COOLEST_DAYLIGHT,
    HOTTEST_DAYLIGHT,
    WAVELENGTHS_NM,
    Spectrum,
    blackbody,
    daylight,
    exact_luminance,
    illuminant,
    linear_from_srgb,
    lines_on_grid,
    on_grid,
    srgb_from_reflectance,
    srgb_from_spectrum,
    within_srgb,
)
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.files import Folders, read_whole
from rptcam_cl.scene.base import FLOAT32_MIN_NORMAL, Alternatives, FileName, SceneModel, number_at, read_number, refuse

# A colour that is known at every wavelength, and tables of spectra from a scene or a file of two columns.

Lines = tuple[tuple[float, float], ...]


class SpectralColour(tuple[float, float, float]):
    """Linear sRGB of a spectrum, which it keeps.

    Attributes
    ----------
    samples : array (401,)
        Values at `rptcam_cl.core.colour.WAVELENGTHS_NM`, read-only: shares of light, coefficients, or densities of
        a light per nm.
    lines : tuple of (float, float)
        Lines of a light, wavelength [nm] and amount; `samples` has them too, shared by their neighbours on the grid.
    """

    samples: Spectrum
    lines: Lines

    def __new__(cls, srgb: ArrayLike, samples: ArrayLike, lines: Lines = ()) -> SpectralColour:
        """Return the colour of three channels that has these samples and lines."""
        red, green, blue = map(float, np.asarray(srgb))
        made = super().__new__(cls, (red, green, blue))
        made.samples = np.array(samples, np.float64)
        made.samples.setflags(write=False)
        made.lines = lines
        return made

    @classmethod
    def of_light(cls, samples: ArrayLike, lines: Lines = ()) -> SpectralColour:
        """Return a light of densities [1/nm]; a colour outside sRGB is cut, its luminance stays."""
        return cls(within_srgb(srgb_from_spectrum(samples)), samples, lines)

    @classmethod
    def of_reflectance(cls, samples: ArrayLike) -> SpectralColour:
        """Return shares of light, whose colour is that under D65, cut to 0 … 1."""
        return cls(np.clip(srgb_from_reflectance(samples), 0.0, 1.0), samples)

    @classmethod
    def of_coefficient(cls, samples: ArrayLike) -> SpectralColour:
        """Return coefficients of absorption, whose channels are means over what a channel sees of D65, cut at 0."""
        return cls(np.maximum(srgb_from_reflectance(samples), 0.0), samples)

    def scaled(self, factor: float) -> SpectralColour:
        """Return a light that is so many times as strong."""
        lines = tuple((wavelength, amount * factor) for wavelength, amount in self.lines)
        return SpectralColour(np.multiply(self, factor), self.samples * factor, lines)

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, SpectralColour)
            and tuple(self) == tuple(other)
            and np.array_equal(self.samples, other.samples)
            and self.lines == other.lines
        )

    def __ne__(self, other: object) -> bool:  # a tuple has one of its own
        return not self == other

    def __hash__(self) -> int:
        return hash((tuple(self), self.samples.tobytes(), self.lines))

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return SpectralColour, (tuple(self), self.samples, self.lines)

    def __repr__(self) -> str:
        return f"SpectralColour({', '.join(f'{channel:.6g}' for channel in self)})"

    def described(self) -> dict[str, Any]:
        """Return it as plain data, with as many digits as tell two pictures apart."""
        samples = [float(f"{value:.9g}") for value in self.samples]
        return {"samples": samples, "lines": [list(line) for line in self.lines]}


_SUFFIXES = (".csv", ".txt", ".tsv", ".spd")
_LARGEST_VALUE = 1e30
_MOST_ROWS = 10_000
LARGEST_FILE = 4_000_000  # bytes
_SHORTEST, _LONGEST = WAVELENGTHS_NM[0], WAVELENGTHS_NM[-1]


def _numbers_of(value: Any) -> tuple[float, ...]:
    """Return a list of at least two numbers."""
    items = value.tolist() if isinstance(value, np.ndarray) else value
    if not isinstance(items, (list, tuple)):
        raise refuse("must be a list of numbers", allowed="a list of at least 2 numbers")
    if not 2 <= len(items) <= _MOST_ROWS:
        raise refuse(f"has {len(items)} numbers", allowed=f"2 to {_MOST_ROWS} numbers")
    return tuple(_number(item, index) for index, item in enumerate(items))


def _number(value: Any, index: int) -> float:
    """Return a number of a list; the tails of a spectrum may be smaller than float32 has numbers, and are 0 then."""
    return 0.0 if isinstance(value, float) and abs(value) < FLOAT32_MIN_NORMAL else number_at(value, (index,))


def _read_lines(value: Any) -> Lines:
    """Return lines, sorted, from a mapping of wavelength [nm] to amount."""
    if not isinstance(value, dict) or not value:
        raise refuse("must be a mapping from wavelength to amount", allowed="for instance {546.1: 1, 577: 0.5}")
    lines = []
    for key, item in value.items():
        try:
            wavelength = float(key)
        except (TypeError, ValueError):
            raise refuse("is no wavelength", got=key, allowed="a number of nm", path=(key,)) from None
        if isinstance(key, bool) or not _SHORTEST <= wavelength <= _LONGEST:
            span = f"{_SHORTEST:g} to {_LONGEST:g} nm"
            raise refuse("has a wavelength out of range", got=key, allowed=span, path=(key,))
        amount = read_number(item) if not isinstance(item, str) else -1.0
        if not 0 < amount <= _LARGEST_VALUE:
            raise refuse("is no amount of light", got=item, allowed=f"above 0 to {_LARGEST_VALUE:g}", path=(key,))
        lines.append((wavelength, amount))
    return tuple(sorted(lines))


def read_rows(
    name: str, folders: Folders, meanings: Sequence[str] = ("a value",)
) -> tuple[Spectrum, NDArray[np.float64]]:
    """Read the table of a file: wavelengths [nm] that rise, and columns of values, shape (columns, rows).

    A line holds a wavelength and its values; comments begin with #, one heading may lead.

    Parameters
    ----------
    name : str
        Name of the file in the scene.
    folders : Folders
        Where it may lie.
    meanings : sequence of str
        What the columns after the wavelength hold.

    Raises
    ------
    InputError
        When it is no such table; the message does not name the file.
    """
    if not name.lower().endswith(_SUFFIXES):
        raise InputError(f"is not a table of a spectrum (allowed: files {', '.join(_SUFFIXES)}; a picture is a texture "
                         "of `kind: image`)")  # fmt: skip
    lines = _text(folders.find(name)).splitlines()
    given = [(number, text) for number, line in enumerate(lines, 1) if (text := line.partition("#")[0].strip())]
    if given and not _numbers(given[0][1]):
        given = given[1:]
    rows = []
    for number, text in given:
        row = _numbers(text)
        if len(row) != 1 + len(meanings):
            wanted = " and ".join(("a wavelength", *meanings))
            raise InputError(f"line {number} does not hold {wanted} (got {text[:40]!r})")
        rows.append(row)
    if not 2 <= len(rows) <= _MOST_ROWS:
        raise InputError(f"holds {len(rows)} rows (allowed: 2 to {_MOST_ROWS})")
    wavelengths, *columns = np.array(rows, np.float64).T
    fault = fault_of(wavelengths)
    if fault is not None:
        index, problem = fault
        raise InputError(f"line {given[index][0]} {problem}")
    return wavelengths, np.array(columns)


def fault_of(wavelengths: Sequence[float] | Spectrum) -> tuple[int, str] | None:
    """The first row of a table whose wavelength is wrong, and why; None where all rise and some are visible."""
    falls = np.flatnonzero(np.diff(wavelengths) <= 0)
    if len(falls):
        return int(falls[0]) + 1, "has a wavelength that is not longer than the one before it"
    if wavelengths[0] > _LONGEST or wavelengths[-1] < _SHORTEST:
        hint = "; these look like micrometres" if wavelengths[-1] < 20 else ""
        return 0, f"begins a table without a wavelength from {_SHORTEST:g} to {_LONGEST:g} nm{hint}"
    return None


def check_wavelengths(wavelengths: Sequence[float]) -> None:
    """Refuse the key `wavelengths_nm` of a table where they do not rise, or miss what is visible."""
    if (fault := fault_of(wavelengths)) is not None:
        index, problem = fault
        path = ("wavelengths_nm", index)
        raise refuse(problem, got=wavelengths[index], allowed="rising wavelengths in nm", path=path)


def _numbers(text: str) -> list[float]:
    """Return the finite numbers of a line, none where it holds anything else."""
    try:
        row = [float(word) for word in text.replace(",", " ").replace(";", " ").split()]
    except ValueError:
        return []
    return row if np.isfinite(row).all() else []


def _text(path: Path) -> str:
    try:
        return read_whole(path, LARGEST_FILE).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError("is not text in UTF-8") from None
    except StateError as problem:
        raise InputError(str(problem)) from None


# How a scene writes spectra: the keys of each form, and the colour that they stand for.

_NUMBERS = {"type": "array", "items": {"type": "number"}, "minItems": 2}
Numbers = Annotated[tuple[float, ...], BeforeValidator(_numbers_of), WithJsonSchema(_NUMBERS)]
Factor = Annotated[float, Field(gt=0, le=_LARGEST_VALUE), BeforeValidator(read_number)]
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
        check_wavelengths(self.wavelengths_nm)
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

    lines_nm: Annotated[Lines, BeforeValidator(_read_lines), WithJsonSchema(
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
        rows = self.rows(folders, _LARGEST_VALUE, "is too bright for sums in float32")
        return on_grid(*rows, beyond=0.0), ()


def _albedo(spectrum: TabulatedSpectrum, folders: Folders) -> SpectralColour:
    """Return shares of light; the table's ends hold beyond it."""
    return SpectralColour.of_reflectance(on_grid(*spectrum.rows(folders, 1.0, "would reflect more light than arrives")))


def coefficient(spectrum: TabulatedSpectrum, folders: Folders) -> SpectralColour:
    """Return coefficients of absorption; the table's ends hold beyond it."""
    return SpectralColour.of_coefficient(on_grid(*spectrum.rows(folders, _LARGEST_VALUE, "is too large for float32")))


def _tint(spectrum: LightSpectrum, folders: Folders) -> SpectralColour:
    """Return light of luminance 1."""
    made = spectrum.light(folders)
    bright = float(exact_luminance(made))
    if bright <= 0:
        raise refuse("is dark, and has no colour", allowed="a spectrum with light from 380 to 780 nm")
    return made.scaled(1 / bright)


# Numbers, vectors, colours and durations of a scene, and their bounds.

Colour = tuple[float, float, float]

# Names of the two forms in the locations of errors; they are no keys.
_CHANNELS, SPECTRUM = "channels", "a spectrum"

_HEX_COLOUR = re.compile(r"#([0-9a-fA-F]{6})")


class ColourForms:
    """How a colour may be written; stands beside the type of a field.

    Parameters
    ----------
    largest : float
        Largest value of a channel.
    excess : str
        What is wrong with larger ones, as a sentence without its subject.
    spectrum : type of TabulatedSpectrum, optional
        The keys of a spectrum that may stand for it; by default none may.
    read : callable, optional
        Makes the colour of a spectrum.
    """

    def __init__(
        self,
        largest: float,
        excess: str,
        spectrum: type[TabulatedSpectrum] | None = None,
        read: Callable[[Any, Folders], SpectralColour] | None = None,
    ) -> None:
        self.largest = largest
        self.excess = excess
        self.spectrum = spectrum
        self.read = read

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """The schema that reads either form."""
        schema: CoreSchema = core_schema.no_info_plain_validator_function(self._channels)
        if self.spectrum is not None:
            keys = handler.generate_schema(self.spectrum)
            spectral = core_schema.with_info_after_validator_function(self._spectrum, keys)
            schema = core_schema.tagged_union_schema({_CHANNELS: schema, SPECTRUM: spectral}, _form)
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
        assert self.read is not None
        folders = info.context["folders"] if info.context else Folders()
        made = self.read(spectrum, folders)
        if max(made) > self.largest or made.samples.max() > self.largest:
            raise refuse(self.excess, got=max(made), allowed=f"0 to {self.largest:g}")
        return made

    def _channels(self, value: Any) -> Colour:
        items = value.tolist() if isinstance(value, np.ndarray) else value
        if isinstance(items, SpectralColour):
            return items
        if isinstance(items, str) and (match := _HEX_COLOUR.fullmatch(items)):
            red, green, blue = (float(linear_from_srgb(byte / 255)) for byte in bytes.fromhex(match[1]))
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
    return SPECTRUM if is_spectrum else _CHANNELS


def _plain(colour: Colour) -> Any:
    """Return a colour as plain data."""
    return colour.described() if isinstance(colour, SpectralColour) else list(colour)


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


def _four_rows(value: Any) -> Any:
    """Return the rows of a 3x4 matrix with the last row of a 4x4 one."""
    rows = value.tolist() if isinstance(value, np.ndarray) else value
    if not isinstance(rows, (list, tuple)) or len(rows) not in (3, 4):
        raise refuse("must be 3 or 4 rows", allowed="a list of 3 or 4 rows of 4 numbers")
    return rows if len(rows) == 4 else [*rows, (0, 0, 0, 1)]


def _not_zero(value: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return a vector that is long enough to have a direction."""
    if math.hypot(*value) < SMALLEST_LENGTH:
        raise refuse("must not be the zero vector", allowed=f"a length of at least {SMALLEST_LENGTH:g}")
    return value


def _check_area(zone: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Refuse a rectangle [x0, x1, y0, y1] whose sides do not rise."""
    if not (zone[0] < zone[1] and zone[2] < zone[3]):
        raise refuse("has no area", got=list(zone), allowed="0 <= x0 < x1 <= 1 and 0 <= y0 < y1 <= 1")
    return zone


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
Rectangle = Annotated[tuple[Fraction, Fraction, Fraction, Fraction], AfterValidator(_check_area)]
FilmPoint = Annotated[tuple[Fraction, Fraction], BeforeValidator(list_of(2, "[x, y]"))]

Position = Annotated[
    tuple[Coordinate, Coordinate, Coordinate], BeforeValidator(list_of(3, "a point or vector [x, y, z]"))
]
Direction = Annotated[Position, AfterValidator(_not_zero)]
Row = Annotated[
    tuple[Coordinate, Coordinate, Coordinate, Coordinate], BeforeValidator(list_of(4, "a row of 4 numbers"))
]

_MATRIX_SCHEMA = WithJsonSchema(
    {
        "type": "array",
        "minItems": 3,
        "maxItems": 4,
        "items": {"type": "array", "minItems": 4, "maxItems": 4, "items": {"type": "number"}},
    }
)
AffineRows = Annotated[tuple[Row, Row, Row, Row], BeforeValidator(_four_rows), _MATRIX_SCHEMA]
Albedo = Annotated[Colour, ColourForms(1.0, "would reflect more light than arrives", TabulatedSpectrum, _albedo)]
Radiance = Annotated[
    Colour, ColourForms(LARGEST_RADIANCE, "is too bright for sums in float32", LightSpectrum, LightSpectrum.emission)
]
_MOST_GROUP_LETTERS = 40


def _group_name(name: object) -> object:
    if isinstance(name, str) and not re.fullmatch(rf"[A-Za-z][A-Za-z0-9_-]{{0,{_MOST_GROUP_LETTERS - 1}}}", name):
        raise refuse(
            "is no name of a group", allowed=f"a letter, then letters, digits, _ and -, up to {_MOST_GROUP_LETTERS}"
        )
    return name


GroupName = Annotated[str, BeforeValidator(_group_name)]
LightColour = Annotated[
    Colour, ColourForms(LARGEST_RADIANCE, "is too bright for sums in float32", LightSpectrum, _tint)
]
Coefficient = Annotated[
    Colour, ColourForms(LARGEST_RADIANCE, "is too large for float32", TabulatedSpectrum, coefficient)
]
PatternAlbedo = Annotated[Colour, ColourForms(1.0, "would reflect more light than arrives")]
PatternColour = Annotated[Colour, ColourForms(1.0, "is above 1: a brighter pattern is an image with gain")]
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


# Rows of numbers.


class Vectors:
    """Rows of numbers that do not change: `rows` is an (n, k) float64 array."""

    def __init__(self, rows: NDArray[np.float64]) -> None:
        rows.setflags(write=False)
        self.rows = rows

    def __len__(self) -> int:
        return len(self.rows)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Vectors) and np.array_equal(self.rows, other.rows)

    def __hash__(self) -> int:
        return hash(self.rows.tobytes())

    def plain(self) -> list[Any]:
        """Return the rows as lists."""
        return list(self.rows.tolist())


# Vectors of three numbers, for which numpy's functions for arrays of them take ten times as long.


def cross(first: ArrayLike, second: ArrayLike) -> NDArray[np.float64]:
    """Return the cross product of two vectors, as `numpy.cross` does bit by bit."""
    ax, ay, az = np.asarray(first, dtype=np.float64).tolist()
    bx, by, bz = np.asarray(second, dtype=np.float64).tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
