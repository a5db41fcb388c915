"""What was made of files, kept in memory for the next plan: frames of an animation and focus probes share it."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from threading import Lock
from typing import Any, Protocol, TypeVar

MOST_BYTES = 512 << 20  # of all that is kept; what alone is larger is not


class _Sized(Protocol):
    @property
    def nbytes(self) -> int: ...


Made = TypeVar("Made", bound=_Sized)
_kept: OrderedDict[str, Any] = OrderedDict()  # what was used last comes last
_lock = Lock()


def remembered(key: str, make: Callable[[], Made]) -> Made:
    """Return what was made under a key before, or what ``make`` returns.

    Parameters
    ----------
    key
        Tells everything that the result depends on, files by their content: who changes a file changes the key.
    make
        Called where nothing is kept. The result is shared, so nobody may change it.
    """
    with _lock:
        if key in _kept:
            _kept.move_to_end(key)
            found: Made = _kept[key]
            return found
    made = make()
    with _lock:
        if made.nbytes <= MOST_BYTES:
            _kept[key] = made
        while sum(other.nbytes for other in _kept.values()) > MOST_BYTES:
            _kept.popitem(last=False)
    return made


def forget() -> None:
    """Make everything anew from now on."""
    with _lock:
        _kept.clear()
