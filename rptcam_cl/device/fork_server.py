"""A process forked before anything began, which carries out orders at once; marks of processes at work."""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import secrets
import select
import signal
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

#
# Marks of the processes at work in a folder, by which a later one sees that an earlier one has not ended well.
#
# Each process keeps a file and a lock on it, which the system takes back however the process ends. At its end it
# removes the file. So a file without a lock was left by a process that was killed, or crashed, and may have cut short
# what it was writing.

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


#
# A process that was made like this one before anything began, and carries out orders.
#
# To start Python and import what a driver takes costs a fifth of a second. A process that is forked has it all.

STANDARD_ERROR = 2
IDLE = 20.0  # [s] after which it ends: it holds what the driver has read
_ANSWER = b"\n\x02answer "  # before what was found; a driver may print anything else


class ForkServerEndedError(Exception):
    """It came to an end: with which exit code, a negative signal as of `subprocess`, and what it had printed."""

    def __init__(self, code: int, said: str) -> None:
        super().__init__(code, said)
        self.code, self.said = code, said


class ForkServer:
    """A process, made by `start_fork_server`, that carries out orders; it ends with this one, or when it is idle.

    Attributes
    ----------
    is_there : bool
        Whether it has not come to an end.
    """

    def __init__(self, process: int, orders: int, answers: int) -> None:
        self._process, self._orders, self._answers = process, orders, answers
        self._asking = threading.Lock()
        self.is_there = True

    def ask(self, *order: Any, timeout_s: float) -> Any:
        """Return what it finds when it carries out an order; both are what JSON holds.

        Raises
        ------
        ForkServerEndedError
            It has ended.
        TimeoutError
            It did not answer in time [s], and was ended.
        """
        with self._asking:
            if not self.is_there:
                raise ForkServerEndedError(0, "")
            said, end = b"", time.monotonic() + timeout_s
            with contextlib.suppress(OSError):  # how it has ended is found below
                text = json.dumps(order).encode() + b"\n"
                while text:
                    text = text[os.write(self._orders, text) :]
            while not (said.endswith(b"\n") and _ANSWER in said):
                if not select.select([self._answers], [], [], max(end - time.monotonic(), 0.0))[0]:
                    os.kill(self._process, signal.SIGKILL)
                    self._end()
                    raise TimeoutError
                piece = os.read(self._answers, 1 << 16)
                if not piece:
                    raise ForkServerEndedError(self._end(), said.decode(errors="replace"))
                said += piece
            return json.loads(said.split(_ANSWER)[1])

    def close(self) -> None:
        """Have it end."""
        with self._asking:
            if self.is_there:
                self._end()

    def _end(self) -> int:
        self.is_there = False
        os.close(self._orders)
        os.close(self._answers)
        return os.waitstatus_to_exitcode(os.waitpid(self._process, 0)[1])


def start_fork_server(carry_out: Callable[..., Any]) -> ForkServer | None:
    """Return a process like this one that carries out orders; None where making it is unsafe.

    It is safe before other threads and drivers begin, as those would be missing in it.
    """
    if not sys.platform.startswith("linux") or threading.active_count() > 1:
        return None
    with contextlib.suppress(OSError), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # numpy's threads end before a fork and begin again when they are wanted
        pipes = orders, to_orders, answers, to_answers = *os.pipe(), *os.pipe()
        if min(pipes) <= STANDARD_ERROR:  # one of the standard streams is closed, whose place it would take there
            for each in pipes:
                os.close(each)
            return None
        process = os.fork()
        if process == 0:
            os.close(to_orders)
            os.close(answers)
            _serve(orders, to_answers, carry_out)
        os.close(orders)
        os.close(to_answers)
        return ForkServer(process, to_orders, answers)
    return None


def _serve(orders: int, answers: int, carry_out: Callable[..., Any]) -> NoReturn:
    """Carry out orders in the process that was made, one at a time, until none comes any more, and end it."""
    code = 1
    try:
        leave_work()
        nothing = os.open(os.devnull, os.O_RDWR)
        for to, place in ((nothing, 0), (answers, 1), (answers, 2)):
            os.dup2(to, place)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        with os.fdopen(orders) as lines:
            while select.select([lines], [], [], IDLE)[0] and (line := lines.readline()):
                found = carry_out(*json.loads(line))
                sys.stdout.flush()
                sys.stderr.flush()
                os.write(1, _ANSWER + json.dumps(found).encode() + b"\n")
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        end_work()
        sys.stderr.flush()
        os._exit(code)  # a driver may never come back from tidying up
