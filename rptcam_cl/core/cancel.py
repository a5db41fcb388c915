"""Long work that can be given up: whoever does it for somebody asks at each step whether it is still wanted."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from contextvars import ContextVar

_CHECK: ContextVar[Callable[[], None] | None] = ContextVar("whether work is still wanted", default=None)


class CancelledError(Exception):
    """Nobody wants the work any more."""


def checkpoint() -> None:
    """Raise what ends the work under way, or wait, where `cancellable` says so; nothing otherwise."""
    check = _CHECK.get()
    if check is not None:
        check()


def is_cancellable() -> bool:
    """Whether somebody is asked at checkpoints, so that the device's queue is to be kept short between them."""
    return _CHECK.get() is not None


@contextlib.contextmanager
def cancellable(check: Callable[[], None]) -> Iterator[None]:
    """Have ``check`` called at every checkpoint that this thread comes to; it may wait, or raise a CancelledError."""
    token = _CHECK.set(check)
    try:
        yield
    finally:
        _CHECK.reset(token)
