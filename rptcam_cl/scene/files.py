"""Files that a scene may name: inside its own folder, or inside folders that the caller allows."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from pydantic import Field

from rptcam_cl.errors import InputError, StateError

FileName = Annotated[str, Field(min_length=1, max_length=1000)]

LENS_SUFFIXES = (".yaml", ".yml", ".json", ".dat")


def is_file_reference(reference: str) -> bool:
    """Return whether a reference to a lens is a path and not a name."""
    return "/" in reference or "\\" in reference or reference.lower().endswith(LENS_SUFFIXES)


@dataclass(frozen=True)
class Folders:
    """Where a scene may read files.

    Attributes
    ----------
    base : Path
        Folder where relative paths start, and inside which files may lie.
    allowed : tuple of Path
        Further folders inside which files may lie.
    """

    base: Path = field(default_factory=Path.cwd)
    allowed: tuple[Path, ...] = ()

    def find(self, reference: str) -> Path:
        """Return the real path of a file that a scene names.

        Raises
        ------
        InputError
            When it lies elsewhere (also by a symbolic link), does not exist or is not a regular file.
        """
        try:
            path = (self.base / reference).resolve()
            roots = [root.resolve() for root in (self.base, *self.allowed)]
            inside = any(path.is_relative_to(root) for root in roots)
            regular, exists = path.is_file(), path.exists()
        except (OSError, ValueError, RuntimeError) as problem:
            raise InputError(f"is not a usable path ({problem})") from None
        if not inside:
            raise InputError(f"lies outside the scene's folder (got {path}; allowed: files in {roots[0]})")
        if not exists:
            raise InputError(f"no such file (got {path})")
        if not regular:
            raise InputError(f"is not a regular file (got {path})")
        return path

    def find_beside(self, path: Path) -> Callable[[Path], Path]:
        """Return what finds the files that a file of the scene names relative to itself."""
        return lambda reference: self.find(str(path.parent / reference))


def digest(path: Path) -> str:
    """Return the SHA-256 of a file's content."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as problem:
        raise StateError(f"{path}: cannot be read ({problem.strerror})") from None
