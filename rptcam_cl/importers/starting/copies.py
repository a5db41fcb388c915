"""Files that a new scene names: those elsewhere are copied beside it, because a scene reads its own folder only."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import field
from pathlib import Path

from rptcam_cl.core.atomic import replacing
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.references import read_whole

LARGEST_COPY = 4 << 30  # bytes


@dataclass
class Copies:
    """Where the files of a new scene are to lie.

    Attributes
    ----------
    folder : Path
        Of the scene.
    pending : dict
        What is to be copied: the target, and the file that it comes from.
    """

    folder: Path
    pending: dict[Path, Path] = field(default_factory=dict)

    def name_of(self, path: Path) -> str:
        """Return the name by which the scene reads a file, which is copied if it lies elsewhere.

        Raises
        ------
        InputError
            When there is no such file.
        """
        real = path.resolve()
        if not real.is_file():
            raise InputError(f"{path}: {'is not a regular file' if real.exists() else 'no such file'}")
        home = self.folder.resolve()
        if real.is_relative_to(home):
            return real.relative_to(home).as_posix()
        self._add(real, home / real.name)
        return real.name

    def add_companions(self, path: Path, named: Iterable[Path]) -> None:
        """Let further files follow one that is copied: those that it names, at the same places beside it."""
        real, home = path.resolve(), self.folder.resolve()
        if real.is_relative_to(home):
            return
        for other in sorted(set(named)):
            if other != real and other.is_file() and other.is_relative_to(real.parent):
                self._add(other, home / other.relative_to(real.parent))

    def _add(self, source: Path, target: Path) -> None:
        if self.pending.get(target, source) != source:
            raise InputError(
                f"{source} and {self.pending[target]} have one name; copy them into {self.folder} yourself"
            )
        if target.exists() and not (target.is_file() and _content(target) == _content(source)):
            raise InputError(
                f"{source}: a scene reads its own folder only, and another {target.name} is there already "
                f"(got {target}; allowed: a model in the scene's folder, or a folder without that file)"
            )
        self.pending[target] = source

    def write(self) -> list[Path]:
        """Copy what is not there yet, and return it."""
        written = [target for target in self.pending if not target.exists()]
        for target in written:
            content = _content(self.pending[target])
            try:
                target.parent.mkdir(parents=True, exist_ok=True)
            except OSError as problem:
                raise StateError(f"{target.parent}: cannot be made ({problem.strerror})") from None
            with replacing(target) as temporary:
                temporary.write_bytes(content)
        return written


def _content(path: Path) -> bytes:
    try:
        return read_whole(path, LARGEST_COPY)
    except (InputError, StateError) as problem:
        raise type(problem)(f"{path}: {problem}") from None
