"""What conversions of other programs' scenes share: places in text, a report, files beside the scene, and the whole."""

from __future__ import annotations

import gzip
import re
import tempfile
import zlib
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.files import replacing
from rptcam_cl.scene.load import load_scene, scene_text

# The text of a file, and places in it.

_LONGEST_MESSAGE = 1000


@dataclass(frozen=True, eq=False)
class Source:
    """The text of one file.

    Attributes
    ----------
    name : str
        File name for messages.
    text : str
    path : Path
        Where it was read from.
    """

    name: str
    text: str = field(repr=False)
    path: Path

    @cached_property
    def _line_starts(self) -> list[int]:
        if self.text.isascii():
            characters: NDArray[Any] = np.frombuffer(self.text.encode("ascii"), np.uint8)
        else:
            characters = np.frombuffer(self.text.encode("utf-32-le"), np.uint32)
        ends = np.flatnonzero(characters == ord("\n"))
        return [0, *(ends + 1).tolist()]

    def line_and_column(self, offset: int) -> tuple[int, int]:
        """Return line and column, from 1, of a character."""
        line = bisect_right(self._line_starts, offset)
        return line, offset - self._line_starts[line - 1] + 1


@dataclass(frozen=True)
class Place:
    """A character of a file."""

    source: Source
    offset: int

    @property
    def line_number(self) -> int:
        """Line, from 1."""
        return self.source.line_and_column(self.offset)[0]

    @property
    def line(self) -> str:
        """``FILE:LINE``."""
        return f"{self.source.name}:{self.line_number}"

    def error(self, problem: str) -> InputError:
        """Return the error of this place: ``FILE:LINE:COL: problem``."""
        line, column = self.source.line_and_column(self.offset)
        return InputError(f"{self.source.name}:{line}:{column}: {one_line(problem)}")


def one_line(message: str) -> str:
    """Return a message fit for one line of a terminal: names of a file may hold anything."""
    shown = message if len(message) <= _LONGEST_MESSAGE else message[:_LONGEST_MESSAGE] + "…"
    return "".join(mark if mark.isprintable() else f"\\x{ord(mark):02x}" for mark in shown)


def read_limited(path: Path, name: str, limit: int) -> bytes:
    """Return the content of a regular file of at most ``limit`` bytes; a .gz file is unpacked, to no more than that."""
    try:
        if not path.is_file():
            raise InputError(f"{name}: {'is not a regular file' if path.exists() else 'no such file'} (got {path})")
        with gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb") as file:
            raw = file.read(limit + 1)
    except (zlib.error, EOFError, gzip.BadGzipFile) as problem:
        raise InputError(f"{name}: is not a whole gzip file ({problem})") from None
    except OSError as problem:
        raise StateError(one_line(f"{name}: cannot be read ({problem.strerror})")) from None
    except ValueError as problem:  # a NUL byte in the name
        raise InputError(f"{name!r}: is not a usable path ({problem})") from None
    if len(raw) > limit:
        raise InputError(f"{name}: holds more than {limit} bytes")
    return raw


def nested(keys: Any) -> int:
    """How many mixtures stand in each other in a texture of ours."""
    if not isinstance(keys, dict) or keys["kind"] != "mixture":
        return 0
    return 1 + max(nested(keys.get(name)) for name in ("first", "second", "amount"))


# What a conversion ignored or approximated, with the lines of the source.

# Lines named per message; a scene of ten thousand shapes may break one rule ten thousand times.
_LINES_NAMED = 8


@dataclass
class Report:
    """Messages in the order of files and lines, each with all the lines that it concerns.

    Attributes
    ----------
    objects : Counter
        How many objects each line of the source says something of, by file and line.
    """

    objects: Counter[tuple[str, int]] = field(default_factory=Counter)
    _lines: dict[str, set[tuple[str, int]]] = field(default_factory=dict)

    def ignored(self, place: Place, what: str) -> None:
        """Note something that the scene of ours does not have."""
        self._note(place, f"ignored: {what}")

    def approximated(self, place: Place, what: str) -> None:
        """Note something that the scene of ours has in another way."""
        self._note(place, f"approximated: {what}")

    def noted(self, place: Place, what: str) -> None:
        """Note something that a user may want to know, such as a file that was copied."""
        self._note(place, f"note: {what}")

    def _note(self, place: Place, message: str) -> None:
        self._lines.setdefault(one_line(message), set()).add((place.source.name, place.line_number))

    def described(self) -> list[dict[str, Any]]:
        """List the messages as plain data: what becomes of what, in which lines, and of how many objects."""
        return [
            {"effect": effect, "message": text, "lines": [f"{file}:{line}" for file, line in places],
             "objects": sum(self.objects[place] for place in places)}
            for places, message in self._sorted()
            for effect, _, text in [message.partition(": ")]
        ]  # fmt: skip

    def _sorted(self) -> list[tuple[list[tuple[str, int]], str]]:
        return sorted((sorted(places), message) for message, places in self._lines.items())

    def __iter__(self) -> Iterator[str]:
        for ((file, line), *others), message in self._sorted():
            named = ", ".join(
                str(other) if name == file else f"{name}:{other}" for name, other in others[:_LINES_NAMED]
            )
            rest = len(others) - _LINES_NAMED
            more = f" (also on {named}{f' and {rest} more' if rest > 0 else ''})" if others else ""
            yield f"{file}:{line}: {message}{more}"

    def __len__(self) -> int:
        return len(self._lines)


TABLED = 32  # places from which a table holds them


# Files that the scene of ours names: referenced where a scene may read them, copied beside it otherwise.

_LARGEST_COPY = 4 << 30


@dataclass
class FileStore:
    """Names of the files beside a scene, and what is to be written there once all is converted.

    Attributes
    ----------
    folder : Path
        Of the scene file of ours; a scene may read files below it only.
    stem : str
        Of its name: new files go to ``STEM_files/`` and ``STEM_meshes/``.
    """

    folder: Path
    stem: str
    report: Report
    _pending: dict[str, Callable[[Path], object]] = field(default_factory=dict)
    _copied: dict[Path, str] = field(default_factory=dict)
    _referenced: set[str] = field(default_factory=set)

    def reference(self, path: Path, place: Place, check: Callable[[Path], object] | None = None) -> str:
        """Return the name under which the scene of ours reads a file.

        Parameters
        ----------
        check
            Reads a file that is to be copied, and raises an InputError when it is not of the kind that is meant.

        Raises
        ------
        InputError
            When there is no such file, or not one of its kind.
        """
        real = self._real(path, place)
        home = self.folder.resolve()
        packed = real.suffix.lower() == ".gz"
        if real.is_relative_to(home) and not packed:
            name = real.relative_to(home).as_posix()
            if name in self._pending:
                raise place.error(
                    f"lies where a new file goes (got {name}; allowed: another name or folder for the scene)"
                )
            self._referenced.add(name)
            return name
        if real not in self._copied:
            if check is not None:
                _check_file(check, real, place)
            name = self.new_name("files", real.name.removesuffix(".gz") if packed else real.name)
            self._copied[real] = name
            self._pending[name] = lambda target: _copy(real, target)
            reason = "unpacked" if packed else "copied, as it lies outside the folder of the scene"
            self.report.noted(place, f"its file: {reason}, to {self.stem}_files/")
        return self._copied[real]

    def new_name(self, kind: str, name: str) -> str:
        """Return a name below ``STEM_KIND/`` that nothing of this conversion has."""
        stem, dot, suffix = re.sub(r"[^\w.-]+", "-", name).rpartition(".")
        wanted = f"{self.stem}_{kind}/{stem or suffix}{dot}{suffix if stem else ''}".rstrip(".")
        count = 1
        taken = {name.lower() for name in (*self._pending, *self._referenced)}
        while wanted.lower() in taken:
            count += 1
            wanted = f"{self.stem}_{kind}/{stem}-{count}{dot}{suffix}"
        return wanted

    def add(self, kind: str, name: str, write: Callable[[Path], object]) -> str:
        """Return the name of a new file below ``STEM_KIND/``, to be written by a function of its path."""
        chosen = self.new_name(kind, name)
        self._pending[chosen] = write
        return chosen

    def stage(self, folder: Path) -> None:
        """Write the files below a folder, from which they are moved to their places once the whole is good.

        Parameters
        ----------
        folder
            An empty one beside the scene file.
        """
        for name, write in self._pending.items():
            target = folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            write(target)

    def place(self, staged: Path) -> None:
        """Move the files that were staged to their places, each at once."""
        for name in self._pending:
            target = self.folder / name
            target.parent.mkdir(exist_ok=True)
            (staged / name).replace(target)

    def named_in(self, staged: Path, value: Any) -> Any:
        """Return a part of the scene in which new files have their names below the staging folder."""
        if isinstance(value, dict):
            return {key: self.named_in(staged, item) for key, item in value.items()}
        if isinstance(value, list):
            return [self.named_in(staged, item) for item in value]
        if not isinstance(value, str) or value not in self._pending:
            return value
        return (staged / value).relative_to(self.folder).as_posix()

    def _real(self, path: Path, place: Place) -> Path:
        try:
            real = path.resolve()
            if not real.is_file():
                raise place.error(f"no such file (got {path})")
        except (OSError, ValueError, RuntimeError) as problem:
            raise place.error(f"is not a usable path ({problem})") from None
        return real


def _check_file(check: Callable[[Path], object], path: Path, place: Place) -> None:
    try:
        check(path)
    except InputError as problem:
        raise place.error(f"{path.name}: is not copied: {problem}") from None


def _copy(source: Path, target: Path) -> None:
    try:
        target.write_bytes(read_limited(source, str(source), _LARGEST_COPY))
    except MemoryError:
        raise InputError(f"{source}: is too large to be copied") from None


# A whole scene.


@dataclass(frozen=True, eq=False)
class Conversion:
    """A converted scene, not yet written.

    Attributes
    ----------
    scene : dict
        The mapping of a scene of ours.
    report : Report
        What was ignored or approximated.
    files : FileStore
        The files that the scene needs beside it.
    """

    source: Path
    scene: dict[str, Any]
    report: Report
    files: FileStore = field(repr=False)

    def write(self, target: Path) -> tuple[str, ...]:
        """Write the scene file and the files beside it, once the whole is known to be a scene that can be used.

        All is written to a hidden folder first and read from there; then the files are moved to their places, the
        scene file last.

        Returns
        -------
        tuple of str
            Warnings about the scene.

        Raises
        ------
        InputError
            When what the pbrt scene became cannot be used; nothing is left of it.
        StateError
            When the files cannot be written.
        """
        try:
            with tempfile.TemporaryDirectory(prefix=".rptcam-convert-", dir=target.parent) as name:
                staged = Path(name)
                self.files.stage(staged)
                warnings = self._load_staged(staged, target)
                self.files.place(staged)
        except OSError as problem:
            raise StateError(f"{target}: cannot be written ({problem.strerror})") from None
        text = scene_text(self.scene, (f"Converted from {self.source.name}.",))
        with replacing(target) as temporary:
            temporary.write_text(text, "utf-8")
        return warnings

    def _load_staged(self, staged: Path, target: Path) -> tuple[str, ...]:
        """Return the warnings of the scene with its staged files, which have their later names there."""
        prefix = f"{staged.name}/"
        try:
            scene = load_scene(self.files.named_in(staged, self.scene), base_dir=target.parent)
            return tuple(text.replace(prefix, "") for text in scene.warnings)
        except InputError as problem:
            reason = str(problem).replace(prefix, "")
            raise InputError(f"{self.source}: became a scene that cannot be used: {reason}") from None
