"""A colour that is known at every wavelength, and tables of spectra from a scene or a file of two columns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.colour import WAVELENGTHS_NM, Spectrum, srgb_from_reflectance, srgb_from_spectrum, within_srgb
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.references import Folders, read_whole
from rptcam_cl.scene.base import FLOAT32_MIN_NORMAL, number_at, read_number, refuse

Lines = tuple[tuple[float, float], ...]


class SpectralColour(tuple[float, float, float]):
    """Linear sRGB of a spectrum, which it keeps.

    Attributes
    ----------
    samples : array (401,)
        Values at `rptcam_cl.colour.WAVELENGTHS_NM`, read-only: shares of light, coefficients, or densities of a light
        per nm.
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


SUFFIXES = (".csv", ".txt", ".tsv", ".spd")
LARGEST_VALUE = 1e30
MOST_ROWS = 10_000
LARGEST_FILE = 4_000_000  # bytes
_SHORTEST, _LONGEST = WAVELENGTHS_NM[0], WAVELENGTHS_NM[-1]


class SpectrumRows(NamedTuple):
    """A table that is checked: wavelengths [nm] that rise, and columns of values, shape (columns, rows)."""

    wavelengths: Spectrum
    columns: NDArray[np.float64]


def numbers_of(value: Any) -> tuple[float, ...]:
    """Return a list of at least two numbers."""
    items = value.tolist() if isinstance(value, np.ndarray) else value
    if not isinstance(items, (list, tuple)):
        raise refuse("must be a list of numbers", allowed="a list of at least 2 numbers")
    if not 2 <= len(items) <= MOST_ROWS:
        raise refuse(f"has {len(items)} numbers", allowed=f"2 to {MOST_ROWS} numbers")
    return tuple(_number(item, index) for index, item in enumerate(items))


def _number(value: Any, index: int) -> float:
    """Return a number of a list; the tails of a spectrum may be smaller than float32 has numbers, and are 0 then."""
    return 0.0 if isinstance(value, float) and abs(value) < FLOAT32_MIN_NORMAL else number_at(value, (index,))


def read_lines(value: Any) -> Lines:
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
        if not 0 < amount <= LARGEST_VALUE:
            raise refuse("is no amount of light", got=item, allowed=f"above 0 to {LARGEST_VALUE:g}", path=(key,))
        lines.append((wavelength, amount))
    return tuple(sorted(lines))


def is_table_file(name: object) -> bool:
    """Return whether a name is that of a file that may hold a table."""
    return isinstance(name, str) and name.lower().endswith(SUFFIXES)


def read_rows(name: str, folders: Folders, meanings: Sequence[str] = ("a value",)) -> SpectrumRows:
    """Return the table of a file: a wavelength [nm] and values a line; comments begin with #, one heading may lead.

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
    if not is_table_file(name):
        raise InputError(f"is not a table of a spectrum (allowed: files {', '.join(SUFFIXES)}; a picture is a texture "
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
    if not 2 <= len(rows) <= MOST_ROWS:
        raise InputError(f"holds {len(rows)} rows (allowed: 2 to {MOST_ROWS})")
    wavelengths, *columns = np.array(rows, np.float64).T
    fault = fault_of(wavelengths)
    if fault is not None:
        index, problem = fault
        raise InputError(f"line {given[index][0]} {problem}")
    return SpectrumRows(wavelengths, np.array(columns))


def fault_of(wavelengths: Sequence[float] | Spectrum) -> tuple[int, str] | None:
    """Return what is wrong with the wavelengths of a table and at which row, None if nothing."""
    falls = np.flatnonzero(np.diff(wavelengths) <= 0)
    if len(falls):
        return int(falls[0]) + 1, "has a wavelength that is not longer than the one before it"
    if wavelengths[0] > _LONGEST or wavelengths[-1] < _SHORTEST:
        hint = "; these look like micrometres" if wavelengths[-1] < 20 else ""
        return 0, f"begins a table without a wavelength from {_SHORTEST:g} to {_LONGEST:g} nm{hint}"
    return None


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
