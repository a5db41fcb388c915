"""The thread that owns the device: it answers requests, renders what somebody waits for, and sleeps otherwise."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable

from rptcam_cl.core.errors import RptcamError
from rptcam_cl.core.host_memory import give_back
from rptcam_cl.viewfinder.client import Client
from rptcam_cl.viewfinder.delivery import Delivery
from rptcam_cl.viewfinder.inbox import Inbox, Request
from rptcam_cl.viewfinder.messages import Compare, Dial, Message, Move, Set
from rptcam_cl.viewfinder.reports import Reports
from rptcam_cl.viewfinder.requests import Requests
from rptcam_cl.viewfinder.slot import Slot
from rptcam_cl.viewfinder.studio import Studio

LOG = logging.getLogger("rptcam_cl.viewfinder")
LINGER_S = 0.4  # after the last client has gone, for a page that is only loaded again
COURTESY_S = 0.06  # for pages to paint a first picture, before anything else takes the processor
TIDY_S = 10.0  # between two times that freed memory is given back, which takes some milliseconds
_POLL_S = 0.02  # between checks whether a compilation has ended
_CHANGES = (Dial, Set, Move, Compare)


class Engine:
    """Renders for the clients of a viewfinder.

    Parameters
    ----------
    studio
        The scene and its slots; the engine's thread alone uses it once it runs.
    clients
        Returns those that are connected.
    """

    def __init__(self, studio: Studio, clients: Callable[[], Iterable[Client]]) -> None:
        self._studio, self._clients = studio, clients
        self._inbox = Inbox()
        self._delivery = Delivery()
        self._requests = Requests(studio)
        self._reports = Reports(studio, self._delivery)
        self._ends = threading.Event()
        self._refining: Slot | None = None
        self._interrupted = False
        self._leaves_alone_until = 0.0
        self._alone_since: float | None = None
        self._tidied = time.monotonic()
        self._thread = threading.Thread(target=self._run, name="rptcam-viewfinder", daemon=True)

    def start(self) -> None:
        """Begin to render."""
        self._thread.start()

    def post(self, client: Client | None, message: Message) -> None:
        """Ask for something; any thread. Requests that newer ones make needless are done at once.

        Raises
        ------
        OverflowError
            Too many requests wait.
        """
        older = self._inbox.put(Request(client, message))
        if isinstance(message, _CHANGES):
            self._interrupt()
        if older is not None and older.client is not None:
            older.client.done(older.message.id, self._studio.generation, superseded=True)

    def wake(self) -> None:
        """Look whether there is something to do: a client has come, gone, or has room again."""
        self._inbox.wake()

    def stop(self, timeout_s: float) -> bool:
        """End and free the device; return whether that was done in time."""
        self._ends.set()
        self._interrupt()
        self._inbox.wake()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _interrupt(self) -> None:
        """End the samples under way, which nobody will see."""
        self._interrupted = True
        slot = self._refining
        if slot is not None:
            slot.session.cancel()

    def _run(self) -> None:
        timeout: float | None = 0.0
        while not self._ends.is_set():
            requests = self._inbox.take(timeout)
            try:
                timeout = self._turn(requests)
            except RptcamError as problem:
                self._studio.fail(problem)
                timeout = None
            except Exception as problem:
                LOG.exception("the viewfinder met an unexpected error")
                self._studio.fail(problem)
                timeout = None
        self._studio.close()

    def _turn(self, requests: list[Request]) -> float | None:
        """Do what is asked and one piece of rendering; return how long there is nothing to do [s]."""
        clients = list(self._clients())
        if (idle := self._leave(clients)) is not None and not requests:
            return idle
        if clients:
            self._studio.open()
        for client in clients:
            self._reports.greet(client)
        for request in requests:
            self._requests.answer(request)
        self._requests.answer_waiting()
        if self._studio.is_closed:
            return None
        hurries = any(slot.wants_glance for slot in self._studio.slots)
        if not hurries and self._deliver(clients):  # what was made before they came
            self._leaves_alone_until = time.monotonic() + COURTESY_S
        if not hurries and (left := self._leaves_alone(clients)) > 0:
            return left
        if not hurries:
            self._reports.inform(clients)
        timeout = self._render(clients)
        if not clients and timeout is None:
            self._reports.prepare()
        self._deliver(clients)
        for slot in self._studio.slots:
            slot.follow()
        a, b = self._studio.a, self._studio.b
        if a is not None and b is not None and self._studio.compares_difference:
            self._delivery.difference(a, b, clients)
        if hurries and self._inbox.is_empty:  # the first picture leaves alone, what is said of it comes next
            self._leaves_alone_until = time.monotonic() + COURTESY_S
        else:
            self._reports.inform(clients)
            self._tidy()
        if self._requests.any_waits:
            timeout = _POLL_S if timeout is None else min(timeout, _POLL_S)
        return timeout if self._inbox.is_empty else 0.0

    def _deliver(self, clients: list[Client]) -> bool:
        """Hand over what is shown to clients that have not had it; return whether there was any."""
        return True in [self._delivery.deliver(slot, clients) for slot in self._studio.slots]

    def _tidy(self) -> None:
        """Give back freed memory now and then; the heap of a day of changes does not grow by its gaps."""
        if time.monotonic() >= self._tidied + TIDY_S:
            give_back()
            self._tidied = time.monotonic()

    def _leaves_alone(self, clients: list[Client]) -> float:
        """Return how long the processor is left to pages that paint a first picture [s]: until they say it is there."""
        if all(client.outbox.is_clear for client in clients):
            return 0.0
        return self._leaves_alone_until - time.monotonic()

    def _leave(self, clients: list[Client]) -> float | None:
        """Free the device when the last client has been gone for a while; return how long there is nothing to do.

        Before the first client comes, the picture is made for it.
        """
        if clients:
            self._alone_since = None
            return None
        if not self._studio.was_seen:
            self._studio.open()
            return None
        now = time.monotonic()
        if self._alone_since is None:
            self._alone_since = now
        left = self._alone_since + LINGER_S - now
        if left > 0:
            return left
        self._studio.close()
        give_back()
        return 1e6

    def _render(self, clients: list[Client]) -> float | None:
        """Render a piece of what is most wanted; return how long there is nothing to render [s]."""
        slots = self._studio.slots
        for slot in slots:
            self._studio.check_compiled(slot)
        compiling = any(slot.compiling for slot in slots)
        if self._studio.paused or (clients and not any(client.outbox.has_room for client in clients)):
            return _POLL_S if compiling else None
        answers = {client.number: client.answers for client in clients}
        for slot in slots:
            if slot.wants_glance:
                slot.show(slot.glance(), slot.rests_in() > 0, answers)
                return 0.0
            if slot.wants_showing:
                slot.show(slot.again(), slot.rests_in() > 0, answers)
                return 0.0
        resting = [slot for slot in slots if not slot.is_done and slot.refines_in() <= 0]
        if not clients and all(slot.shown is not None for slot in slots):
            return _POLL_S if compiling else None
        if resting:
            self._refine(min(resting, key=lambda slot: slot.session.spp), answers)
            return 0.0
        waits = [slot.refines_in() for slot in slots if not slot.is_done] + [_POLL_S] * compiling
        return min(waits) if waits else None

    def _refine(self, slot: Slot, answers: dict[int, int | None]) -> None:
        self._refining, self._interrupted = slot, False
        try:
            if self._inbox.is_empty and not self._ends.is_set():
                frame = slot.refine(lambda: not self._interrupted)
                if frame is not None:
                    slot.show(frame, False, answers)
        finally:
            self._refining = None
