"""Ctrl-C that ends a render after the pass at hand instead of losing it."""

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType

from rptcam_cl.core.errors import DeviceError

INTERRUPTED = 128 + signal.SIGINT
"""Exit code of an interrupted command, as shells count."""


@contextlib.contextmanager
def stop_on_interrupt() -> Iterator[threading.Event]:
    """An event that the first Ctrl-C (or termination) sets; the second raises `KeyboardInterrupt` at once.

    So does a device that fails after the first: Ctrl-C takes a compiler's files away while it works.
    Outside the main thread, where signals do not arrive, the event stays unset.
    """
    stop = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return

    def handle(number: int, frame: FrameType | None) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    except DeviceError:
        if stop.is_set():
            raise KeyboardInterrupt from None
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
