"""Marks of the processes at work in a folder, by which a later one sees that an earlier one has not ended well.

Each process keeps a file and a lock on it, which the system takes back however the process ends. At its end it removes
the file. So a file without a lock was left by a process that was killed, or crashed, and may have cut short what it was
writing.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import secrets
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

_SUFFIX = ".at-work"
_of_this_process: dict[Path, tuple[int, BinaryIO, Callable[[], bool]]] = {}
_unfinished: list[None] = []  # one for each piece of work that the end of the process would cut short


def left_behind(folder: Path) -> list[Path]:
    """Return the marks in a folder whose processes have not ended well; none where there is no folder."""
    try:
        marks = [path for path in folder.iterdir() if path.suffix == _SUFFIX]
    except OSError:
        return []
    return [mark for mark in marks if _is_left(mark)]


def _is_left(mark: Path) -> bool:
    import fcntl  # systems of the Unix kind alone have it

    with contextlib.suppress(OSError), mark.open("rb") as file:  # it may just have been removed
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        return True
    return False


def mark_work(folder: Path, *, ended_well: Callable[[], bool]) -> None:
    """Put the mark of this process into a folder, until it ends.

    Parameters
    ----------
    folder
        Made if need be.
    ended_well
        Called at the end: the mark stays where it returns False.

    Raises
    ------
    OSError
        When the folder cannot be written.
    """
    import fcntl

    folder.mkdir(parents=True, exist_ok=True)
    hidden = folder / f"{os.getpid()}-{secrets.token_hex(4)}.new"
    file = hidden.open("xb")
    fcntl.flock(file, fcntl.LOCK_EX)
    mark = hidden.with_suffix(_SUFFIX)
    hidden.rename(mark)  # locked already: nobody takes it for one left behind
    _of_this_process[mark] = os.getpid(), file, ended_well
    atexit.register(end_work)


def leave_work() -> None:
    """Leave the marks to the process that this one was forked from."""
    for _, file, _ in _of_this_process.values():
        file.close()
    _of_this_process.clear()


def end_work() -> None:
    """Remove the marks of this process, which will do no more work; for those that end without Python's own end."""
    while _of_this_process:
        mark, (owner, _, ended_well) = _of_this_process.popitem()
        if os.getpid() == owner and not _unfinished and ended_well():  # not at the end of a child with the same memory
            mark.unlink(missing_ok=True)


@contextlib.contextmanager
def unfinished_work() -> Iterator[None]:
    """Work of a thread that is not waited for: a process that ends meanwhile has not ended well."""
    _unfinished.append(None)
    try:
        yield
    finally:
        _unfinished.pop()
