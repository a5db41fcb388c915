"""Files that the scene of ours names: referenced where a scene may read them, copied beside it otherwise."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import field
from pathlib import Path
from typing import Any

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.importers.pbrt.report import Report
from rptcam_cl.importers.pbrt.source import Place, read_limited

LARGEST_COPY = 4 << 30


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
    _pending: dict[str, Callable[[Path], None]] = field(default_factory=dict)
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
                _checked(check, real, place)
            name = self.new_name("files", real.name.removesuffix(".gz") if packed else real.name)
            self._copied[real] = name
            self._pending[name] = lambda target: _copy(real, target)
            reason = "unpacked" if packed else "copied, as it lies outside the folder of the scene"
            self.report.noted(place, f"{path.name}: {reason}, to {name}")
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

    def add(self, kind: str, name: str, write: Callable[[Path], None]) -> str:
        """Return the name of a new file below ``STEM_KIND/``, to be written by a function of its path."""
        chosen = self.new_name(kind, name)
        self._pending[chosen] = write
        return chosen

    def names(self) -> list[str]:
        """Return the names of the files to be written."""
        return list(self._pending)

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


def _checked(check: Callable[[Path], object], path: Path, place: Place) -> None:
    try:
        check(path)
    except InputError as problem:
        raise place.error(f"{path.name}: is not copied: {problem}") from None


def _copy(source: Path, target: Path) -> None:
    try:
        target.write_bytes(read_limited(source, str(source), LARGEST_COPY))
    except MemoryError:
        raise InputError(f"{source}: is too large to be copied") from None
