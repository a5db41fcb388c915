"""Files that are either the old one or the whole new one, whatever happens while they are written."""

import contextlib
import hashlib
import os
import secrets
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from rptcam_cl.core.errors import InputError, StateError

if TYPE_CHECKING:
    import tempfile

STRAY_SECONDS = 7 * 24 * 3600  # after which a file that is still being written has been left behind


def _process_space() -> str:
    """Return what identifies the scope of process numbers: a boot of a system, a container; empty if unknown.

    Host names do not: two containers with one name have processes of the same numbers.
    """
    try:
        start = Path("/proc/sys/kernel/random/boot_id").read_text("ascii").strip()
        space = os.stat("/proc/self/ns/pid").st_ino  # noqa: PTH116 -- the link's own target cannot be opened
    except (OSError, ValueError):
        return ""
    return hashlib.sha256(f"{start} {space}".encode()).hexdigest()[:16]


_SPACE = _process_space()


def _name_of_process() -> str:
    return f".rptcam-{_SPACE or 'unknown'}-{os.getpid()}-"


def _temporary_name() -> str:
    return f"{_name_of_process()}{secrets.token_hex(4)}.tmp"


def scratch_folder() -> "tempfile.TemporaryDirectory[str]":
    """A folder among the system's temporary ones; where the process is killed, it goes with the next such folder."""
    import tempfile

    remove_strays(Path(tempfile.gettempdir()))
    return tempfile.TemporaryDirectory(prefix=_name_of_process(), suffix=".tmp", ignore_cleanup_errors=True)


@contextlib.contextmanager
def utf8_name(path: str | os.PathLike[str]) -> Iterator[str]:
    """A name of a file for libraries that take UTF-8 alone: its own, or else a link to it."""
    try:
        name = os.fspath(path)
        name.encode()
    except UnicodeEncodeError:
        with scratch_folder() as folder:
            link = os.path.join(folder, f"link{Path(path).suffix}")  # noqa: PTH118
            os.symlink(os.path.abspath(path), link)  # noqa: PTH100, PTH211
            yield link
    else:
        yield name


def _is_alive(pid: int) -> bool:
    if os.name != "posix":
        return True  # signal 0 is a query on POSIX only; elsewhere it would be sent
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def remove_strays(folder: Path) -> None:
    """Remove temporary files and folders that killed runs left: those of this system and container, or a week old."""
    for stray in folder.glob(".rptcam-*-*.tmp"):
        space, pid = stray.name.split("-")[1:3]
        with contextlib.suppress(OSError):
            is_here = bool(_SPACE) and space == _SPACE and pid.isdecimal()
            is_dead = is_here and not _is_alive(int(pid))
            is_old = stray.lstat().st_mtime < time.time() - STRAY_SECONDS
            if stray.is_dir() and not stray.is_symlink():
                if is_dead or (is_old and not is_here):
                    _remove_tree(stray)
            elif is_dead or is_old:
                stray.unlink()


def _remove_tree(folder: Path) -> None:
    import shutil

    shutil.rmtree(folder, ignore_errors=True)


def _sync(path: Path, flags: int) -> None:
    descriptor = os.open(path, flags)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A temporary path beside ``path``; what is written there takes its place when the block ends without an error.

    The new file is on the disk before it takes the name, so that a reader, a crash or a full disk never meets half a
    file. A symbolic link keeps pointing where it did, and its target is replaced.
    """
    target = Path(os.path.realpath(path))
    temporary = target.parent / _temporary_name()
    try:
        remove_strays(target.parent)
        yield temporary
        _sync(temporary, os.O_RDWR)
        if target.exists():
            temporary.chmod(target.stat().st_mode & 0o7777)
        temporary.replace(target)
        if os.name == "posix":
            _sync(target.parent, os.O_RDONLY)  # the new name, too, has to survive a power cut
    except (OSError, RuntimeError) as error:
        raise StateError(f"{path}: cannot be written: {_reason(error)}") from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


def unlinked(path: Path) -> Path:
    """Return the path of a file in a folder that the program fills; a symbolic link in its place is removed.

    Links that a user names as an output are written through. In such a folder they would lead files out of it.

    Raises
    ------
    StateError
        It cannot be removed.
    """
    try:
        if path.is_symlink():
            path.unlink()
    except OSError as error:
        raise StateError(f"{path}: is a link, and cannot be replaced: {_reason(error)}") from error
    return path


def _reason(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error)


def check_writable(path: str | os.PathLike[str], inputs: Iterable[str | os.PathLike[str]] = ()) -> None:
    """Raise an error when a file could not be written at ``path``. Nothing is left behind.

    Parameters
    ----------
    path
        Where the file is to go.
    inputs
        Files that it must not overwrite.

    Raises
    ------
    InputError
        The file is one of the inputs.
    StateError
        There is no folder, or no permission, or something else in the way.
    """
    target = Path(os.path.realpath(path))
    if any(target == Path(os.path.realpath(source)) for source in inputs):
        raise InputError(f"{path}: is an input; choose another name")
    if target.is_symlink():
        raise StateError(f"{path}: is a symbolic link that leads back to itself; remove it or choose another name")
    if target.is_dir():
        raise StateError(f"{path}: is a folder; name a file in it")
    if target.exists() and not target.is_file():
        raise StateError(f"{path}: is not a regular file")
    if not target.parent.is_dir():
        raise StateError(f"{path}: there is no folder {target.parent}; make it first")
    if target.exists() and not os.access(target, os.W_OK):
        raise StateError(f"{path}: exists and may not be overwritten")
    probe = target.parent / _temporary_name()
    try:
        probe.touch(exist_ok=False)
        probe.unlink()
    except OSError as error:
        raise StateError(f"{path}: cannot be written: {_reason(error)}") from error
