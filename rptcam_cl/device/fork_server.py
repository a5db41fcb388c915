"""Another process that carries out orders, forked before anything began or started later; marks of those at work."""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import pickle
import secrets
import select
import signal
import struct
import subprocess
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any, BinaryIO, NoReturn

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


def _leave_work() -> None:
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
# Another process, which carries out orders one at a time.
#
# To start Python and import what a driver takes costs a fifth of a second. A process that is forked before anything
# began has it all. Later, threads and drivers are at work here, which a fork would lack: then a new Python is started.

_STANDARD_ERROR = 2
IDLE = 20.0  # [s] after which a forked process ends: it holds what the driver has read
_SECONDS_TO_END = 0.2  # that a process which was started has to end by itself
_ANSWER = b"\n\x02answer "  # before the answer; a driver may print anything else
_CHILD = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from rptcam_cl.device import fork_server; "
    "fork_server.serve(0, 1)"
)

_Child = tuple["subprocess.Popen[bytes] | int", IO[bytes], IO[bytes]]
"""A process, or the number of one that was forked; where it reads orders, and where it answers."""


class ServerEndedError(Exception):
    """It came to an end: with which exit code, a negative signal as of `subprocess`, and what it had printed."""

    def __init__(self, code: int, said: str) -> None:
        super().__init__(code, said)
        self.code, self.said = code, said


class CompileServer:
    """A process that carries out orders; it ends with this one.

    Parameters
    ----------
    child
        That of `start_fork_server`, which also ends when it is idle. Without it, a new Python is started at the first
        order, and again after one that failed.

    Attributes
    ----------
    is_closed : bool
        Whether it carries out nothing more.
    """

    def __init__(self, child: _Child | None = None) -> None:
        self._child, self._is_forked = child, child is not None
        self._asking, self._changing = threading.Lock(), threading.Lock()
        self.is_closed = False

    @property
    def is_there(self) -> bool:
        """Whether there is a process that has not come to an end."""
        return self._child is not None

    def ask(self, function: Callable[..., Any], *arguments: Any, timeout_s: float | None = None) -> Any:
        """Call a function of a module there; it returns what JSON holds.

        Raises
        ------
        ServerEndedError
            It has ended, perhaps by an error of the function.
        TimeoutError
            It did not answer in time [s], and was ended.
        """
        return self._carry_out(pickle.dumps((function, arguments)), timeout_s)

    def compile(self, order: bytes) -> bool:
        """Call a pickled function with its arguments there; return whether that has worked.

        The process may fail, crash or be closed.
        """
        try:
            self._carry_out(order, None)
        except ServerEndedError:
            return False
        return True

    def close(self) -> None:
        """End the process, whatever a started one does; no other begins."""
        self.is_closed = True
        child = self._child
        self._end()
        if child is not None:
            with self._asking:  # who still reads its answers comes to their end
                child[2].close()

    def _carry_out(self, order: bytes, timeout_s: float | None) -> Any:
        with self._asking:
            child = self._running()
            if child is None:
                raise ServerEndedError(0, "")
            _, orders, answers = child
            said, end = b"", time.monotonic() + (timeout_s or 0.0)
            with contextlib.suppress(OSError, ValueError):  # how it has ended is found below
                orders.write(struct.pack("<Q", len(order)) + order)
                orders.flush()
            while not (said.endswith(b"\n") and _ANSWER in said):
                if timeout_s is not None and not select.select([answers], [], [], max(end - time.monotonic(), 0.0))[0]:
                    self._end(at_once=True)
                    answers.close()
                    raise TimeoutError
                piece = os.read(answers.fileno(), 1 << 16)
                if not piece:
                    answers.close()
                    raise ServerEndedError(self._end(), said.decode(errors="replace"))
                said += piece
            return json.loads(said.split(_ANSWER)[1])

    def _running(self) -> _Child | None:
        with self._changing, contextlib.suppress(OSError):  # no process can be started
            if self._child is None and not self._is_forked and not self.is_closed and sys.executable:
                self._child = _start_python()
        return self._child

    def _end(self, *, at_once: bool = False) -> int:
        """End the process and return its exit code."""
        with self._changing:
            child, self._child = self._child, None
        if child is None:
            return 0
        process, orders, _ = child
        with contextlib.suppress(OSError):
            orders.close()  # it ends by itself if it has nothing to do
        if isinstance(process, int):
            if at_once:
                os.kill(process, signal.SIGKILL)
            return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
        try:
            return process.wait(0.0 if at_once else _SECONDS_TO_END)
        except subprocess.TimeoutExpired:
            process.kill()
            return process.wait()


def _start_python() -> _Child:
    process = subprocess.Popen(
        [sys.executable, "-c", _CHILD, json.dumps(sys.path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, start_new_session=True,  # Ctrl-C is for the parent, which ends this one
    )  # fmt: skip
    assert process.stdin is not None and process.stdout is not None
    return process, process.stdin, process.stdout


def start_fork_server() -> CompileServer | None:
    """Fork a process like this one that carries out orders; None where that is unsafe.

    It is safe before other threads and drivers begin, as those would be missing in it.
    """
    if not sys.platform.startswith("linux") or threading.active_count() > 1:
        return None
    with contextlib.suppress(OSError), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # numpy's threads end before a fork and begin again when they are wanted
        pipes = orders, to_orders, answers, to_answers = *os.pipe(), *os.pipe()
        if min(pipes) <= _STANDARD_ERROR:  # one of the standard streams is closed, whose place it would take there
            for each in pipes:
                os.close(each)
            return None
        process = os.fork()
        if process == 0:
            os.close(to_orders)
            os.close(answers)
            _leave_work()
            serve(orders, to_answers, IDLE)
        os.close(orders)
        os.close(to_answers)
        return CompileServer((process, os.fdopen(to_orders, "wb"), os.fdopen(answers, "rb")))
    return None


def serve(orders: int, answers: int, idle_s: float | None = None) -> NoReturn:
    """Carry out orders in another process, one at a time, until none comes any more or for so long; then end it."""
    code = 1
    try:
        nothing, pickled = os.open(os.devnull, os.O_RDWR), os.fdopen(os.dup(orders), "rb")
        for to, place in ((nothing, 0), (answers, 1), (answers, 2)):
            os.dup2(to, place)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        while idle_s is None or select.select([pickled], [], [], idle_s)[0]:
            if len(head := pickled.read(8)) < 8:
                break
            function, arguments = pickle.loads(pickled.read(struct.unpack("<Q", head)[0]))
            answer = function(*arguments)
            sys.stdout.flush()
            sys.stderr.flush()
            os.write(1, _ANSWER + json.dumps(answer).encode() + b"\n")
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        end_work()
        sys.stderr.flush()
        os._exit(code)  # a driver may never come back from tidying up
