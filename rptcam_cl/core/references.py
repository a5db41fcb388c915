"""Files that other files name: looked for inside allowed folders only, and read only if regular and of bearable size.

A scene or a lens may come from a stranger. What it names must therefore lie in the folder that it came in, also behind
symbolic links; a pipe that never ends or a device that holds the whole of memory is refused before it is read.
"""

from __future__ import annotations

import hashlib
import io
import os
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import field
from pathlib import Path

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, MissingFileError, StateError

_NAMED: ContextVar[set[Path] | None] = ContextVar("files that were named", default=None)
_WITHOUT_WAITING = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)


@dataclass(frozen=True)
class Folders:
    """Where files may lie that another file names.

    Attributes
    ----------
    base : Path
        Folder where relative paths start, and inside which files may lie.
    allowed : tuple of Path
        Further folders inside which files may lie.
    owner : str
        What errors call the file that names others.
    """

    base: Path = field(default_factory=Path.cwd)
    allowed: tuple[Path, ...] = ()
    owner: str = "scene"

    def find(self, reference: str) -> Path:
        """Return the real path of a file that is named.

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
        if inside and (named := _NAMED.get()) is not None:
            named.add(path)
        if not inside:
            allowed = ", ".join(dict.fromkeys(map(str, roots)))
            raise InputError(f"lies outside the {self.owner}'s folder (got {path}; allowed: files in {allowed})")
        if not exists:
            raise MissingFileError(f"no such file (got {path})")
        if not regular:
            raise InputError(f"is not a regular file (got {path})")
        return path

    def find_beside(self, path: Path) -> Callable[[Path], Path]:
        """Return what finds the files that a file names relative to itself."""
        return lambda reference: self.find(str(path.parent / reference))

    def beside(self, path: Path) -> Folders:
        """Return where files may lie that a file in these folders names, relative to itself."""
        return Folders(path.parent, (self.base, *self.allowed), self.owner)


class References:
    """Reads the files that one file names, and keeps account of what they said.

    Parameters
    ----------
    folders : Folders
        Where they may lie; the working folder for data that no file holds.
    """

    def __init__(self, folders: Folders | None = None) -> None:
        self._folders = folders
        self._read: dict[str, str] = {}

    def read(self, reference: str, most: int) -> tuple[Path, bytes]:
        """Return the path and the content of a file that is named.

        Raises
        ------
        InputError
            When it may not be read, does not exist, is not a regular file, or has more than ``most`` bytes.
        StateError
            When it cannot be read.
        """
        path = (self._folders or Folders()).find(reference)
        content = read_whole(path, most)
        self._read[reference] = hashlib.sha256(content).hexdigest()
        return path, content

    def digests(self) -> dict[str, str]:
        """Return the SHA-256 of each file that was read, by the name in the request."""
        return dict(sorted(self._read.items()))


@contextmanager
def named_files() -> Iterator[set[Path]]:
    """A set that takes the real path of every file that is named while the block runs, found or missing."""
    named: set[Path] = set()
    token = _NAMED.set(named)
    try:
        yield named
    finally:
        _NAMED.reset(token)


def open_regular(path: Path, most: int) -> io.BufferedReader:
    """Return a file opened for reading in binary; it is a regular one, of at most ``most`` bytes.

    Raises
    ------
    InputError
        When it is not; the message says why, not which file.
    StateError
        When it cannot be opened.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | _WITHOUT_WAITING)
    except FileNotFoundError:
        raise InputError("no such file") from None
    except ValueError as problem:  # a NUL byte in the name
        raise InputError(f"is not a usable path ({problem})") from None
    except OSError as problem:
        raise StateError(f"cannot be read ({problem.strerror})") from None
    state = os.fstat(descriptor)
    if stat.S_ISREG(state.st_mode) and state.st_size <= most:
        return os.fdopen(descriptor, "rb")
    os.close(descriptor)
    if not stat.S_ISREG(state.st_mode):
        raise InputError("is not a regular file")
    raise InputError(f"is too large (got {state.st_size} bytes; allowed: at most {most})")


def read_whole(source: Path | bytes, most: int) -> bytes:
    """Return the content of a regular file of at most ``most`` bytes, or what is known of it.

    Raises
    ------
    InputError
        When it is not one, or grew beyond that; the message says why, not which file.
    StateError
        When it cannot be read.
    """
    if isinstance(source, bytes):
        content = source
    else:
        with open_regular(source, most) as file:
            try:
                content = file.read(most + 1)
            except OSError as problem:
                raise StateError(f"cannot be read ({problem.strerror})") from None
    if len(content) > most:
        raise InputError(f"is too large (got {len(content)} bytes or more; allowed: at most {most})")
    return content


def digest(path: Path, most: int) -> str:
    """Return the SHA-256 of the content of a regular file of at most ``most`` bytes.

    Raises
    ------
    InputError
        When it is not one; the message names the file.
    StateError
        When it cannot be read.
    """
    try:
        with open_regular(path, most) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except (InputError, StateError) as problem:
        raise type(problem)(f"{path}: {problem}") from None
    except OSError as problem:
        raise StateError(f"{path}: cannot be read ({problem.strerror})") from None
