"""Files that are either the old one or the whole new one, whatever happens while they are written."""

import contextlib
import os
import re
import secrets
import socket
from collections.abc import Iterable, Iterator
from pathlib import Path

from rptcam_cl.errors import InputError, StateError

_HOST = re.sub(r"[^A-Za-z0-9]", "", socket.gethostname())[:32] or "host"


def _temporary_name() -> str:
    return f".rptcam-{_HOST}-{os.getpid()}-{secrets.token_hex(4)}.tmp"


def _is_alive(pid: int) -> bool:
    if os.name != "posix":
        return True  # signal 0 asks on POSIX only; elsewhere it would be sent
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def remove_strays(folder: Path) -> None:
    """Remove temporary files that killed runs on this host left in a folder."""
    for stray in folder.glob(f".rptcam-{_HOST}-*.tmp"):
        pid = stray.name.split("-")[2]
        if pid.isdigit() and not _is_alive(int(pid)):
            with contextlib.suppress(OSError):
                stray.unlink()


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
