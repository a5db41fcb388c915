"""A render session in a process of its own, so that what a driver does there cannot take Blender along.

Messages are pickled, each after its length, and go over the standard streams of the process; the arrays in them lie in
files of a folder that both use, in memory where the system has such a folder. The process runs this file by its path:
it imports nothing of the extension.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import queue
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from rptcam_cl import RenderSession, autofocus, render
from rptcam_cl.core import errors

MEMORY = Path("/dev/shm")  # a folder in memory, on Linux
POLL_S = 0.05  # between two questions whether the user has given up
GRACE_S = 10.0  # until a process that does not answer "stop" is ended
STOP = ("stop", ())
FUNCTIONS: dict[str, Callable[..., Any]] = {"render": render, "autofocus": autofocus}


def send(stream: BinaryIO, arrays: Path, message: Any) -> None:
    """Write a message, its arrays to a file of their own."""
    buffers: list[pickle.PickleBuffer] = []
    body = pickle.dumps(message, protocol=5, buffer_callback=buffers.append)
    parts = [buffer.raw() for buffer in buffers]
    if parts:
        with arrays.open("wb") as file:
            file.writelines(parts)
    head = pickle.dumps(([part.nbytes for part in parts], body))
    stream.write(struct.pack("<Q", len(head)) + head)
    stream.flush()


def receive(stream: BinaryIO, arrays: Path) -> Any:
    """Read a message; raises `EOFError` where the other side has ended."""
    length = stream.read(8)
    if len(length) < 8:
        raise EOFError
    sizes, body = pickle.loads(stream.read(struct.unpack("<Q", length)[0]))
    parts = [bytearray(size) for size in sizes]
    if parts:
        with arrays.open("rb") as file:
            for part in parts:
                file.readinto(part)
    return pickle.loads(body, buffers=parts)


def _read_all(stream: BinaryIO, arrays: Path, into: queue.SimpleQueue[Any]) -> None:
    """Queue all messages, and None where they end."""
    with contextlib.suppress(EOFError, OSError, pickle.UnpicklingError):
        while True:
            into.put(receive(stream, arrays))
    into.put(None)


@contextlib.contextmanager
def broken_pipe_is_an_error() -> Iterator[None]:
    """Writing to a process that has ended raises `BrokenPipeError`; its signal would end Blender, unlike Python."""
    if not hasattr(signal, "pthread_sigmask"):  # there is none on Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGPIPE})
    try:
        yield
    finally:
        if signal.SIGPIPE in signal.sigpending():
            signal.sigwait({signal.SIGPIPE})
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class SessionApart:
    """A `RenderSession` in a process of its own, with the part of its interface that the engine takes.

    Raises
    ------
    DeviceError
        By every method, when the process has ended.
    """

    def __init__(self, keys: Mapping[str, Any] | None, device: str | None) -> None:
        self._folder = tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None, prefix="rptcam-")
        self._to, self._back = (Path(self._folder.name) / name for name in ("to", "back"))
        self._process = subprocess.Popen(
            [sys.executable, __file__, str(self._to), str(self._back)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
        assert self._process.stdin is not None and self._process.stdout is not None
        self._stream, self._answers = self._process.stdin, queue.SimpleQueue[Any]()
        arguments = (self._process.stdout, self._back, self._answers)
        threading.Thread(target=_read_all, args=arguments, daemon=True).start()
        self.has_ended = False
        self.resolution, self.spp, self.samples_per_wave, self.is_whole = (0, 0), 0, 1, True
        if keys is not None:
            self.call("open", dict(keys), device)

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    def call(self, name: str, *given: Any, should_stop: Callable[[], bool] = lambda: False) -> Any:
        """Have the process do something and return the result; what `should_stop` ends early is not an error."""
        ends: float | None = None
        try:
            self._send((name, given))
            while True:
                with contextlib.suppress(queue.Empty):
                    answer = self._answers.get(timeout=POLL_S)
                    break
                if ends is None and should_stop():
                    self._send(STOP)
                    ends = time.monotonic() + GRACE_S
                elif ends is not None and time.monotonic() > ends:
                    self._process.kill()
        except (OSError, ValueError):  # of a pipe that nobody reads, or that is closed
            answer = None
        if answer is None:
            raise errors.DeviceError(self._end())
        trouble, result, state = answer
        vars(self).update(state)
        if trouble:
            raise getattr(errors, trouble, errors.RptcamError)(result)
        return result

    def _send(self, message: Any) -> None:
        with broken_pipe_is_an_error():
            send(self._stream, self._to, message)

    def _end(self) -> str:
        """Say how the process ended."""
        self.has_ended = True
        code = self._process.wait()
        how = f"signal {-code}" if code < 0 else f"exit code {code}"
        self.close()
        return f"the renderer's process has ended ({how}), and this render with it; the next one starts another"

    def change(self, changes: Mapping[str, Any]) -> None:
        """Change keys of the scene."""
        self.call("change", dict(changes))

    def add(self, samples: int = 1, should_stop: Callable[[], bool] = lambda: False) -> bool:
        """Add samples to every pixel."""
        return bool(self.call("add", samples, should_stop=should_stop))

    def pixels(self) -> Any:
        """The film so far."""
        return self.call("pixels")

    def image(self) -> Any:
        """The film so far with layers and metadata."""
        return self.call("image")

    def close(self) -> None:
        """End the process."""
        with broken_pipe_is_an_error(), contextlib.suppress(OSError):
            self._stream.close()
        try:
            self._process.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._folder.cleanup()


def main() -> None:
    """Answer messages till they end."""
    arrays, back = map(Path, sys.argv[1:3])
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what drivers print is no message
    inbox: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_read_all, args=(sys.stdin.buffer, arrays, inbox), daemon=True).start()
    session: RenderSession | None = None
    while (message := inbox.get()) is not None:
        name, given = message
        if message == STOP:  # it came when the work was done
            continue
        trouble, result = "", None
        try:
            if name == "open":
                session = RenderSession(given[0], device=given[1])
            elif name in FUNCTIONS:
                result = FUNCTIONS[name](*given[:-1], **given[-1])
            elif name == "add" and session is not None:
                result = session.add(given[0], lambda: not inbox.empty())
            else:
                result = getattr(session, name)(*given)
                result = None if name == "change" else result
        except errors.RptcamError as problem:
            trouble, result = type(problem).__name__, str(problem)
        names = ("resolution", "spp", "samples_per_wave", "is_whole")
        state = {} if session is None else {each: getattr(session, each) for each in names}
        send(out, back, (trouble, result, state))
    if session is not None:
        session.close()


if __name__ == "__main__":
    main()
