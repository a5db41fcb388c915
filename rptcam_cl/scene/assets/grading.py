"""Colour as films and studios grade it: tables in `.cube` files, and the views of OpenColorIO."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, MissingFileError, near_name
from rptcam_cl.core.files import Folders, read_whole
from rptcam_cl.core.remember import Memory
from rptcam_cl.scene.base import listed

Values = NDArray[np.float32]

# Tables of colours: Adobe, "Cube LUT Specification", version 1.0 (2013), and the keys that DaVinci Resolve adds, by
# which a file has curves, a lattice behind them, and the range of each.

_LARGEST_CUBE = 1 << 27  # bytes
_MOST = {"LUT_1D_SIZE": 65536, "LUT_3D_SIZE": 129}  # the specification allows 256: half a gigabyte of text
_RANGES = {"LUT_1D_INPUT_RANGE": "LUT_1D_SIZE", "LUT_3D_INPUT_RANGE": "LUT_3D_SIZE"}
_BOUNDS = {"DOMAIN_MIN": 0, "DOMAIN_MAX": 1}
_KEYS = ("TITLE", *_MOST, *_BOUNDS, *_RANGES)
_LARGEST_NUMBER = 1e30


@dataclass(frozen=True, eq=False)
class TableStage:
    """Curves of the three channels, or a lattice of colours.

    Attributes
    ----------
    low, high : (3,) array
        Values where the table begins and ends; those beyond are taken to be there.
    rows : (rows, 3) array
        The curves at even steps, or the colours of the lattice, red running fastest.
    size : int
        Steps of a curve, or of each side of the lattice.
    is_lattice : bool
        Which of both it is.
    """

    low: Values
    high: Values
    rows: Values
    size: int
    is_lattice: bool

    def apply(self, values: Values) -> Values:
        """Return the colours of the table for values (…, 3)."""
        inside = np.clip(values, self.low, self.high)
        steps = (inside - self.low) * (np.float32(self.size - 1) / (self.high - self.low))
        before = np.minimum(steps.astype(np.int32), np.int32(self.size - 2))
        share = steps - before
        return self._between_colours(before, share) if self.is_lattice else self._along_curves(before, share)

    def _along_curves(self, before: NDArray[np.int32], share: Values) -> Values:
        channel = np.arange(3)
        first, second = self.rows[before, channel], self.rows[before + 1, channel]
        return np.asarray(first + share * (second - first), np.float32)

    def _between_colours(self, before: NDArray[np.int32], share: Values) -> Values:
        """Interpolate in the tetrahedron of each value: from corner to corner, by the largest share first.

        J. Kasson, S. Nin, W. Plouffe, J. Hafner, J. Electronic Imaging 4, 226 (1995). Grey stays grey where the table
        leaves it so, as a straight line from corner to corner passes no others.
        """
        strides = np.array([1, self.size, self.size**2], np.int32)
        order = np.argsort(-share, axis=-1, kind="stable")
        falling = np.take_along_axis(share, order, axis=-1)
        corner = (before * strides).sum(axis=-1, dtype=np.int32)
        mixed = self.rows[corner] * (1 - falling[..., :1])
        for rank in range(3):
            corner = corner + strides[order[..., rank]]
            beyond = falling[..., rank + 1 : rank + 2] if rank < 2 else np.float32(0)
            mixed += self.rows[corner] * (falling[..., rank : rank + 1] - beyond)
        return np.asarray(mixed, np.float32)


@dataclass(frozen=True, eq=False)
class ColourTable:
    """A table of a `.cube` file: curves, a lattice, or a lattice behind curves."""

    stages: tuple[TableStage, ...]
    digest: str

    def apply(self, values: Values) -> Values:
        """Return the colours of the table for values (…, 3)."""
        for stage in self.stages:
            values = stage.apply(values)
        return values


_tables: Memory[ColourTable] = Memory(most=4)


def load_table(name: str, folders: Folders) -> ColourTable:
    """Return the table of a `.cube` file, remembered by its content.

    Raises
    ------
    InputError
        The file may not be read, or is no table; the message names file and line.
    StateError
        It cannot be read.
    """
    if not name.lower().endswith(".cube"):
        raise InputError("is no table of colours (allowed: a file .cube)")
    content = read_whole(folders.find(name), _LARGEST_CUBE)
    digest = hashlib.sha256(content).hexdigest()
    return _tables.find_or_make(digest, lambda: _read_table(content, digest, name))


class _Lines:
    """The lines of a `.cube` file: what keys say, and the rows of numbers that follow."""

    def __init__(self, text: str, name: str) -> None:
        self.name = name
        self.said: dict[str, tuple[float, ...]] = {}
        self.places: dict[str, int] = {}  # the lines of keys
        self.rows: list[tuple[int, str]] = []
        self.last = 0
        for number, line in enumerate(text.splitlines(), 1):
            words = line.split()
            if not words or words[0].startswith("#"):
                continue
            self.last = number
            if words[0][0] in "+-.0123456789":
                self.rows.append((number, line))
            else:
                self._say(number, words[0].upper(), words)

    def fault(self, number: int, problem: str) -> InputError:
        """Return the error of a line."""
        return InputError(f"{self.name}:{number}: {problem}")

    def _say(self, number: int, key: str, words: list[str]) -> None:
        if key not in _KEYS:
            raise self.fault(number, f"unknown key{near_name(key, _KEYS)} (got {key[:40]!r}; allowed: {listed(_KEYS)})")
        if self.rows:
            raise self.fault(number, f"{key} stands after rows of the table (allowed: keys first)")
        if key in self.said:
            raise self.fault(number, f"{key} is said twice (allowed: once)")
        self.places[key] = number
        if key == "TITLE":
            self.said[key] = ()
        elif key in _MOST:
            count = int(words[1]) if len(words) == 2 and re.fullmatch(r"\d{1,9}", words[1]) else 0
            if not 2 <= count <= _MOST[key]:
                got = " ".join(words[1:])[:40]
                raise self.fault(number, f"{key} is out of range (got {got!r}; allowed: 2 to {_MOST[key]})")
            self.said[key] = (count,)
        else:
            count = 3 if key in _BOUNDS else 2
            self.said[key] = tuple(self.numbers(number, " ".join(words[1:]), count))

    def numbers(self, number: int, text: str, count: int) -> list[float]:
        """Return as many numbers as a line should have."""
        try:
            values = [float(word) for word in text.split()]
        except ValueError:
            values = []
        if len(values) != count or not all(abs(value) <= _LARGEST_NUMBER for value in values):
            raise self.fault(number, f"does not hold {count} numbers (got {text.strip()[:40]!r})")
        return values

    def table(self) -> Values:
        """Return all rows, (rows, 3)."""
        words = " ".join(text for _, text in self.rows).split()
        if len(words) == 3 * len(self.rows):
            try:
                values = np.array(words, np.float64)
            except ValueError:
                values = np.array([np.nan])
            if (np.abs(values) <= _LARGEST_NUMBER).all():
                return values.reshape(-1, 3).astype(np.float32)
        return np.array([self.numbers(number, text, 3) for number, text in self.rows], np.float32)


def _read_table(content: bytes, digest: str, name: str) -> ColourTable:
    lines = _Lines(content.decode("utf-8-sig", "replace"), name)
    sizes = {key: int(lines.said[key][0]) for key in _MOST if key in lines.said}
    if not sizes:
        raise lines.fault(max(lines.last, 1), "has no size (allowed: LUT_1D_SIZE or LUT_3D_SIZE before the rows)")
    counts = {key: size if key == "LUT_1D_SIZE" else size**3 for key, size in sizes.items()}
    wanted, held = sum(counts.values()), len(lines.rows)
    if held != wanted:
        place, more = (lines.rows[wanted][0], "goes on") if held > wanted else (lines.last, "ends")
        said = " and ".join(f"{key} {size}" for key, size in sizes.items())
        raise lines.fault(place, f"{more} after {min(held, wanted)} rows (got {held}; {said} needs {wanted})")
    rows, stages, start = lines.table(), [], 0
    for key, size in sizes.items():
        low, high = _domain(lines, key)
        own = rows[start : start + counts[key]]
        stages.append(TableStage(low, high, np.ascontiguousarray(own), size, is_lattice=key == "LUT_3D_SIZE"))
        start += counts[key]
    return ColourTable(tuple(stages), digest)


def _domain(lines: _Lines, size: str) -> tuple[Values, Values]:
    """Return the least and the greatest value of a table, in three channels."""
    ranges = [key for key, of in _RANGES.items() if of == size and key in lines.said]
    keys = ranges or [key for key in _BOUNDS if key in lines.said]
    low, high = lines.said.get("DOMAIN_MIN", (0.0,) * 3), lines.said.get("DOMAIN_MAX", (1.0,) * 3)
    if ranges:
        low, high = ((end,) * 3 for end in lines.said[ranges[0]])
    if not all(b - a > 1e-6 * max(abs(a), abs(b)) for a, b in zip(low, high, strict=True)):
        place = max(lines.places[key] for key in keys)
        got = f"got {listed([f'{a:g}' for a in low])} to {listed([f'{b:g}' for b in high])}"
        raise lines.fault(place, f"the domain is empty ({got}; allowed: each end above its start)")
    return np.array(low, np.float32), np.array(high, np.float32)


# Views of OpenColorIO: film light goes to the scene-linear space of a config, and by its view to a display.

_BUILT_IN = "ocio://"
_FILM = "Linear Rec.709 (sRGB)"  # as OpenColorIO names the colours of our film
_LARGEST_CONFIG, _LARGEST_LUT = 1 << 24, 1 << 27  # bytes


@dataclass(frozen=True)
class DisplayView:
    """A display and a view of a config, with all that it was made of.

    Attributes
    ----------
    config : str or bytes
        Name of a built-in config, or the content of a file.
    display, view, look : str
        Names in the config; the looks that the view has by itself where `look` is empty.
    files : tuple of (str, bytes)
        Files that the view takes from the config's folder.
    is_srgb : bool
        Whether the display encodes as sRGB.
    """

    config: str | bytes
    display: str
    view: str
    look: str
    files: tuple[tuple[str, bytes], ...]
    is_srgb: bool

    @property
    def digest(self) -> str:
        """SHA-256 of all that it was made of."""
        content = self.config.encode() if isinstance(self.config, str) else self.config
        parts = [content, *(part for name, data in self.files for part in (name.encode(), data))]
        return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts)).hexdigest()

    def apply(self, values: Values) -> Values:
        """Return display values from 0 to 1 of linear Rec.709 (…, 3)."""
        shown = np.array(values, np.float32, order="C")
        _processors.find_or_make(self, partial(_rebuild, self)).applyRGB(shown)
        return np.clip(np.nan_to_num(shown, copy=False, nan=0.0), 0, 1, out=shown)


_processors: Memory[Any] = Memory(most=4)


def _rebuild(made: DisplayView) -> Any:
    files = _Files(made.config, held=dict(made.files))
    return _processor(_library(), files.config(_library()), made.display, made.view, made.look)


def load_view(config: str, display: str | None, view: str | None, look: str | None, folders: Folders) -> DisplayView:
    """Return a view of a built-in config, ``ocio://default``, or of a file, whose own files are read now.

    Parameters
    ----------
    display, view
        By default those of the config.
    look
        In place of those that the view has.

    Raises
    ------
    InputError
        OpenColorIO is not installed, a file may not be read, or the config has no such view. The message begins with
        the key, ``view: ``, where it is not the config that is wrong.
    StateError
        A file cannot be read.
    """
    library = _library()
    if config.startswith(_BUILT_IN):
        files = _Files(config)
    else:
        if not config.lower().endswith(".ocio"):
            raise InputError(
                "is no config of OpenColorIO (allowed: ocio://default, another built-in one, or FILE.ocio)"
            )
        path = folders.find(config)
        files = _Files(read_whole(path, _LARGEST_CONFIG), folders.beside(path))
    with _refusals(library, files):
        made = files.config(library)
    display = _choose("display", display, list(made.getDisplays()), made.getDefaultDisplay())
    view = _choose("view", view, list(made.getViews(display)), made.getDefaultView(display))
    with _refusals(library, files, "look: " if look else ""):
        processor = _processor(library, made, display, view, look or "")
    space = made.getDisplayViewColorSpaceName(display, view)
    is_srgb = "srgb" in f"{display} {view} {space}".lower()
    done = DisplayView(files.content, display, view, look or "", tuple(sorted(files.held.items())), is_srgb)
    _processors.add(done, processor)
    return done


def _library() -> Any:
    try:
        import PyOpenColorIO
    except ImportError:
        raise InputError('needs the package opencolorio (pip install "rptcam_cl[ocio]")') from None
    return PyOpenColorIO


def _errors(library: Any) -> tuple[type[BaseException], ...]:
    return (library.Exception, library.ExceptionMissingFile)


class _Files:
    """A config and what it takes from files; they are read once, inside the folders where they may lie."""

    def __init__(
        self, content: str | bytes, folders: Folders | None = None, held: Mapping[str, bytes] | None = None
    ) -> None:
        self.content, self.folders = content, folders
        self.held = dict(held or {})
        self.problem: InputError | None = None

    def find(self, name: str) -> bytes | None:
        """Return the content of a file of the config; None where there is none."""
        if name not in self.held:
            try:
                if self.folders is None:
                    return None
                self.held[name] = read_whole(self.folders.find(name), _LARGEST_LUT)
            except MissingFileError:
                return None
            except InputError as problem:
                self.problem = InputError(f"{name}: {problem}")
                return None
        return self.held[name]

    def config(self, library: Any) -> Any:
        """Return the config as OpenColorIO reads it."""
        if isinstance(self.content, str):
            return library.Config.CreateFromFile(self.content)
        library.ClearAllCaches()  # OpenColorIO remembers files by their names alone
        text, files = self.content.decode("utf-8", "replace"), self

        class Reader(library.PyConfigIOProxy):  # type: ignore[misc]
            """Hands OpenColorIO the files of a config."""

            def getConfigData(self) -> str:  # noqa: N802 -- OpenColorIO's
                return text

            def getLutData(self, name: str) -> list[int]:  # noqa: N802 -- OpenColorIO's
                return list(files.find(name) or b"")

            def getFastLutFileHash(self, name: str) -> str:  # noqa: N802 -- OpenColorIO's
                content = files.find(name)
                return "" if content is None else hashlib.sha256(content).hexdigest()

        reader = Reader()
        made = library.Config.CreateFromConfigIOProxy(reader)
        files.reader = reader  # it is called as long as the config is used
        return made

    reader: Any = None


@contextmanager
def _refusals(library: Any, files: _Files, key: str = "") -> Iterator[None]:
    """Make errors of what OpenColorIO refuses; one about a file that it could not have comes first."""
    try:
        yield
    except _errors(library) as problem:
        if files.problem is not None:
            raise files.problem from None
        raise InputError(f"{key}OpenColorIO refuses it: {' '.join(str(problem).split())}") from None
    if files.problem is not None:
        raise files.problem


def _choose(key: str, name: str | None, names: list[str], default: str) -> str:
    if name is None:
        return default
    if name not in names:
        raise InputError(
            f"{key}: is not in the config{near_name(name, names)} (got {name!r}; allowed: {listed(names)})"
        )
    return name


def _processor(library: Any, config: Any, display: str, view: str, look: str) -> Any:
    """Return the processor that takes float32 of linear Rec.709 to a display."""
    linear = library.ROLE_SCENE_LINEAR
    if not config.hasRole(linear):
        raise InputError("the config has no role scene_linear (allowed: one that says what its scene-linear space is)")
    try:
        steps = library.Config.GetProcessorFromBuiltinColorSpace(_FILM, config, linear).createGroupTransform()
    except _errors(library) as problem:
        raise InputError(
            f"the config does not say which colours its scene_linear space has ({' '.join(str(problem).split())};"
            " allowed: one with the role aces_interchange)"
        ) from None
    pipeline = library.LegacyViewingPipeline()
    pipeline.setDisplayViewTransform(library.DisplayViewTransform(src=linear, display=display, view=view))
    if look:
        pipeline.setLooksOverrideEnabled(True)
        pipeline.setLooksOverride(look)
    for step in pipeline.getProcessor(config).createGroupTransform():
        steps.appendTransform(step)
    return config.getProcessor(steps).getDefaultCPUProcessor()
