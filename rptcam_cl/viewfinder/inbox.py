"""What clients ask of the engine: newer requests replace older ones that they make needless."""

from __future__ import annotations

import threading
from collections.abc import Hashable

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.viewfinder import messages
from rptcam_cl.viewfinder.client import Client

MOST_WAITING = 256


@dataclass(frozen=True)
class Request:
    """A message and the client that sent it; None where nobody waits for an answer."""

    client: Client | None
    message: messages.Message


def _key(request: Request) -> Hashable:
    """Return what a request shares with those that it replaces; None where it replaces none."""
    message = request.message
    if isinstance(message, messages.Dial):
        return ("dial", message.slot, message.name)
    if isinstance(message, messages.Set):
        return ("set", message.slot, frozenset(message.changes))
    if isinstance(message, messages.Move):
        return ("move", message.kind)
    if isinstance(message, messages.Pointer | messages.Magnify):
        return (message.type, request.client)
    return None


def _joined(older: Request, newer: Request) -> Request:
    """Return what stands for two requests of one key: the newer, and of moves both."""
    if not (isinstance(newer.message, messages.Move) and isinstance(older.message, messages.Move)):
        return newer
    before, after = older.message, newer.message
    steps = {name: getattr(before, name) + getattr(after, name) for name in ("dx", "dy", "dz")}
    return Request(newer.client, after.model_copy(update=steps))


class Inbox:
    """Requests in their order; any thread puts, the engine takes."""

    def __init__(self) -> None:
        self._requests: dict[Hashable, Request] = {}
        self._changed = threading.Condition()
        self._woken = False
        self._count = 0

    def put(self, request: Request) -> Request | None:
        """Add a request; return the one that it replaces.

        Raises
        ------
        OverflowError
            Too many wait.
        """
        with self._changed:
            key = _key(request)
            if key is None:
                self._count += 1
                key = self._count
            older = self._requests.pop(key, None)
            if older is None and len(self._requests) >= MOST_WAITING:
                raise OverflowError
            self._requests[key] = request if older is None else _joined(older, request)
            self._woken = True
            self._changed.notify()
            return older

    def wake(self) -> None:
        """Let the engine look around."""
        with self._changed:
            self._woken = True
            self._changed.notify()

    def take(self, timeout_s: float | None) -> list[Request]:
        """Return all requests, once there is one, the engine is woken, or the time is over."""
        with self._changed:
            self._changed.wait_for(lambda: self._woken, timeout_s)
            self._woken = False
            found = list(self._requests.values())
            self._requests.clear()
            return found

    @property
    def is_empty(self) -> bool:
        """Whether nothing waits."""
        return not self._requests
