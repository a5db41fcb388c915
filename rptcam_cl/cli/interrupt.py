"""Ctrl-C that ends a render after the pass at hand instead of losing it."""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType

from rptcam_cl.core.errors import DeviceError

INTERRUPTED = 128 + signal.SIGINT
"""Exit code of an interrupted command, as shells count."""

ENDS_LATER = "interrupted: the picture at hand is finished first; Ctrl-C again ends at once"
"""What the first Ctrl-C says where it ends a whole picture later, and not a pass."""


@contextlib.contextmanager
def stop_on_interrupt(words: str | None = None) -> Iterator[threading.Event]:
    """An event that the first Ctrl-C sets, or termination, or the end of the terminal; the second interrupts at once.

    So does a device that fails after the first: Ctrl-C takes a compiler's files away while it works.
    Outside the main thread, where signals do not arrive, the event stays unset.
    With words, the first says them, for a command that goes on for longer than a pass.
    """
    stop = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return

    def handle(number: int, frame: FrameType | None) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()
        if words is not None:  # past Python's buffers, which may be in the middle of another line
            with contextlib.suppress(OSError, ValueError):
                os.write(sys.stderr.fileno(), f"{words}\n".encode())

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    closed = getattr(signal, "SIGHUP", None)  # the terminal is closed; what nohup starts is to go on
    if closed is not None and signal.getsignal(closed) == signal.SIG_DFL:
        before[closed] = signal.signal(closed, handle)
    try:
        yield stop
    except DeviceError:
        if stop.is_set():
            raise KeyboardInterrupt from None
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
