"""The viewfinder: the thread that owns the device, answers requests and renders what somebody waits for."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from rptcam_cl.core.errors import RptcamError
from rptcam_cl.core.files import give_back
from rptcam_cl.core.remember import CancelledError, cancellable
from rptcam_cl.scene.scene import Scene
from rptcam_cl.viewfinder import messages
from rptcam_cl.viewfinder.background import Background, BackgroundTask
from rptcam_cl.viewfinder.delivery import MOST_CLIENTS, Delivery, Reports
from rptcam_cl.viewfinder.dials import lens_entries
from rptcam_cl.viewfinder.requests import CHANGE_THE_CAMERA, Requests
from rptcam_cl.viewfinder.slot import Slot
from rptcam_cl.viewfinder.studio import Origin, Studio, Watch, place_of, scene_error, text_of

LOG = logging.getLogger("rptcam_cl.viewfinder")
WAIT_FOR_RELOAD_S = 0.4  # after the last client has gone, for a page that is only loaded again
TIME_TO_PAINT_S = 0.06  # for pages to paint a first picture, before anything else takes the processor
_TIDY_S = 10.0  # between two times that freed memory is given back, which takes some milliseconds
_POLL_S = 0.02  # between checks whether a compilation has ended
_CHANGES = (*CHANGE_THE_CAMERA, "compare", "history")


class Engine:
    """Renders for the clients of a viewfinder.

    Parameters
    ----------
    studio
        The scene and its slots; the engine's thread alone uses it once it runs.
    clients
        Returns those that are connected.
    background
        Does what takes long.
    inbox
        What waits to be done.
    """

    def __init__(
        self,
        studio: Studio,
        clients: Callable[[], Iterable[messages.Client]],
        background: Background,
        inbox: messages.Inbox,
    ) -> None:
        self._studio, self._clients, self._inbox = studio, clients, inbox
        self._delivery = Delivery(lambda: not inbox.is_empty)
        self._background = background
        self._requests = Requests(studio, background)
        self._reports = Reports(studio, self._delivery, background.worker("lens"))
        self._finishing: dict[str, int] = {}  # by slot, the film whose picture is finished
        self._ends = threading.Event()
        self._refined: Slot | None = None  # whose samples were shown last
        self._show_s = 0.0  # that developing them took
        self._interrupted = False
        self._leaves_alone_until = 0.0
        self._alone_since: float | None = None
        self._tidied = time.monotonic()
        self._thread = threading.Thread(target=self._run, name="rptcam-viewfinder", daemon=True)

    def start(self) -> None:
        """Begin to render."""
        self._thread.start()

    def post(self, client: messages.Client, message: messages.AnyMessage) -> None:
        """Ask for something; any thread. Requests that newer ones make needless are done at once.

        Raises
        ------
        OverflowError
            Too many requests wait.
        """
        if message.type in _CHANGES:  # before the engine can have done it, after which nothing would let workers go on
            self._background.hold(True)
        older = self._inbox.put((client, message))
        if message.type in _CHANGES:
            self._interrupt()
        if isinstance(older, tuple):
            older[0].done(older[1].id, self._studio.generation, superseded=True)

    def show_file(self, scene: Scene) -> None:
        """Show the scene as its files are now; any thread."""
        self._inbox.put(scene)

    def wake(self) -> None:
        """Look whether there is something to do: a client has come, gone, or has room again."""
        self._inbox.wake()

    def stop(self, timeout_s: float) -> bool:
        """End and free the device; return whether that was done in time."""
        self._ends.set()
        self._interrupt()
        self._inbox.wake()
        end = time.monotonic() + timeout_s
        self._thread.join(timeout_s)
        has_ended = self._background.close(max(end - time.monotonic(), 0.05))
        return has_ended and not self._thread.is_alive()

    def _interrupt(self) -> None:
        """End the samples under way, which nobody will see."""
        self._interrupted = True

    def _check(self) -> None:
        """End the plan of a film that nobody will see."""
        if self._interrupted:
            raise CancelledError

    def _run(self) -> None:
        timeout: float | None = 0.0
        while not self._ends.is_set():
            requests = self._inbox.take(timeout)
            try:
                timeout = self._turn(requests)
            except Exception as problem:
                if not isinstance(problem, RptcamError):
                    LOG.exception("the viewfinder met an unexpected error")
                self._studio.fail(problem)
                for scene in self._requests.give_up(requests, problem):
                    self._inbox.put(scene)
                timeout = None if self._studio.is_closed else 0.0
        self._studio.close()

    def _turn(self, requests: list[messages.Request | Scene]) -> float | None:
        """Do what is asked, taking it out, and one piece of rendering; return how long there is nothing to do [s]."""
        clients = list(self._clients())
        if (idle := self._leave(clients)) is not None and not requests:
            return idle
        if clients:
            self._studio.open()
        for client in clients:
            self._reports.greet(client)
        self._background.take()
        while requests:
            self._requests.answer(requests.pop(0))
        self._requests.answer_waiting()
        if self._studio.is_closed:
            return None
        hurries = any(slot.wants_glance or slot.wants_showing for slot in self._studio.slots)
        if not hurries and self._deliver(clients):  # what was made before they came
            self._leaves_alone_until = time.monotonic() + TIME_TO_PAINT_S
        if not hurries and (left := self._leaves_alone(clients)) > 0:
            return left
        if not hurries:
            self._reports.inform(clients)
        timeout = self._render(clients)
        rendered = time.monotonic()
        self._show(clients, timeout)
        if hurries and self._inbox.is_empty:  # the first picture leaves alone, what is said of it comes next
            self._leaves_alone_until = time.monotonic() + TIME_TO_PAINT_S
        elif hurries or self._inbox.is_empty:
            self._reports.inform(clients)
            self._tidy()
        if self._refined is not None:
            self._refined.pace.note_show(self._show_s + time.monotonic() - rendered)
            self._refined = None
        if self._requests.any_waits:
            timeout = _POLL_S if timeout is None else min(timeout, _POLL_S)
        timeout = self._let_workers_go_on(timeout)
        self._tell_busy(clients)
        self._tell_history(clients)
        return timeout if self._inbox.is_empty else 0.0

    def _show(self, clients: list[messages.Client], timeout: float | None) -> None:
        """Send what was rendered, and have all that follows the picture follow it."""
        self._make_pictures()
        if not clients and timeout is None:
            self._reports.prepare()
        self._deliver(clients)
        for slot in self._studio.slots:
            slot.follow()
        self._requests.track_focus()
        self._requests.note_state()
        a, b = self._studio.a, self._studio.b
        if a is not None and b is not None and self._studio.compares_difference:
            self._delivery.difference(a, b, clients)

    def _let_workers_go_on(self, timeout: float | None) -> float | None:
        """Have workers wait while a hand moves something; return when to look again."""
        slots = self._studio.slots
        rests_in = max((slot.rests_in() for slot in slots), default=0.0)
        glances = timeout == 0.0 and any(slot.wants_glance for slot in slots)  # now: neither paused nor without a page
        if not self._inbox.is_empty or glances:
            return timeout
        self._background.hold(rests_in > 0)
        if rests_in <= 0:
            return timeout
        return rests_in if timeout is None else min(timeout, rests_in)

    def _make_pictures(self) -> None:
        """Have pictures at rest finished off this thread, those of films that are no more no longer."""
        slots = {slot.name: slot for slot in self._studio.slots}
        for name in {*slots, *self._finishing}:
            worker, slot = self._background.worker(f"picture {name}"), slots.get(name)
            if slot is None or self._finishing.get(name) != slot.film:
                worker.end()
            if slot is not None and not worker.tasks and slot.wants_finishing:
                self._finishing[name] = slot.film
                finish = slot.picture_later()
                text = " and ".join(slot.comes_last) + (" of B" if name == "B" else "")
                worker.start(BackgroundTask(text, lambda task, finish=finish: finish(), slot.show_finished))  # type: ignore[misc]
            elif slot is not None and not worker.tasks and slot.wants_network:
                self._finishing[name] = slot.film
                clean = slot.network_later()
                failed = partial(self._leave_network, slot)
                worker.start(BackgroundTask("", lambda task, clean=clean: clean(), slot.show_network, failed))  # type: ignore[misc]

    def _leave_network(self, slot: Slot, problem: Exception) -> None:
        """Do without Open Image Denoise, which is there and does not work."""
        LOG.warning("Open Image Denoise is left out: %s", problem)
        slot.has_network = False

    def _tell_history(self, clients: list[messages.Client]) -> None:
        history = self._requests.history
        for client in clients:
            if client.history == history.version or not client.was_greeted:
                continue
            client.history = history.version
            client.outbox.news("history", history.message())
            for number, data in history.thumbs().items():
                if client.thumbs.get(number) != data:
                    client.outbox.news(("thumb", number), {"type": "thumb", "number": number, "data": data})
            client.thumbs = history.thumbs()

    def _tell_busy(self, clients: list[messages.Client]) -> None:
        texts = [*self._background.texts, *(["kernels of the focus search"] if self._requests.any_waits else [])]
        for client in clients:
            if client.busy != texts:
                client.busy = texts
                client.outbox.news("busy", {"type": "busy", "texts": texts})

    def _deliver(self, clients: list[messages.Client]) -> bool:
        """Hand over what is shown to clients that have not had it; return whether there was any."""
        return True in [self._delivery.deliver(slot, clients) for slot in self._studio.slots]

    def _tidy(self) -> None:
        """Give back freed memory now and then; the heap of a day of changes does not grow by its gaps."""
        if time.monotonic() >= self._tidied + _TIDY_S:
            give_back()
            self._tidied = time.monotonic()

    def _leaves_alone(self, clients: list[messages.Client]) -> float:
        """Return how long the processor is left to pages that paint a first picture [s]: until they say it is there."""
        if all(client.outbox.is_clear for client in clients):
            return 0.0
        return self._leaves_alone_until - time.monotonic()

    def _leave(self, clients: list[messages.Client]) -> float | None:
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
        left = self._alone_since + WAIT_FOR_RELOAD_S - now
        if left > 0:
            return left
        self._studio.close()
        give_back()
        return 1e6

    def _render(self, clients: list[messages.Client]) -> float | None:
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
        if self._requests.is_searching:  # whose probes come first
            return _POLL_S if compiling else None
        if not clients and all(slot.shown is not None for slot in slots):
            return _POLL_S if compiling else None
        if resting:
            self._refine(min(resting, key=lambda slot: slot.session.spp), answers)
            return 0.0
        waits = [slot.refines_in() for slot in slots if not slot.is_done] + [_POLL_S] * compiling
        return min(waits) if waits else None

    def _refine(self, slot: Slot, answers: dict[int, int | None]) -> None:
        self._interrupted = False
        if not self._inbox.is_empty or self._ends.is_set():
            return
        try:
            with cancellable(self._check):
                frame = slot.refine(lambda: not self._interrupted)
                if frame is not None:
                    begun = time.monotonic()
                    slot.show(frame, False, answers)
                    self._refined, self._show_s = slot, time.monotonic() - begun
        except CancelledError:
            slot.leave_unread()


# The viewfinder of one scene, for any number of pages over any transport.


class TooManyClientsError(RptcamError):
    """As many clients as there may be look through the viewfinder."""


class Viewfinder:
    """A scene that is rendered while pages look at it and turn its dials.

    Parameters
    ----------
    scene
        A scene file, which is watched, or what else `load_scene` takes.
    overrides
        Changes of the scene as ``--set`` takes them.
    device
        As ``--device`` on the command line.
    size
        Resolution [pixels] in place of the scene's.

    Raises
    ------
    InputError, StateError
        The scene cannot be used.
    """

    def __init__(
        self,
        scene: Scene | str | Path | Mapping[str, Any],
        overrides: Iterable[str] = (),
        *,
        device: str | None = None,
        size: tuple[int, int] | None = None,
    ) -> None:
        self._lock = threading.Lock()
        self._clients: dict[int, messages.Client] = {}
        self._last_number = 0
        self.origin = Origin(scene, overrides)
        inbox = messages.Inbox()
        background = Background(inbox.wake)
        self._studio = Studio(self.origin, device, size, self.clients, background)
        loaded = self._studio.load()
        self.warnings = loaded.warnings
        self._engine = Engine(self._studio, self.clients, background, inbox)
        self._engine.start()
        lens_entries(loaded)  # which the first page wants to know; meanwhile the engine opens the device
        self._watch: Watch | None = None
        if self.origin.path is not None:
            self._watch = Watch(lambda: self.origin.files, self._read_again)
            self._watch.start()

    def clients(self) -> list[messages.Client]:
        """Return those that are connected."""
        with self._lock:
            return list(self._clients.values())

    @property
    def holds_device(self) -> bool:
        """Whether a device is held: while a page looks, and before the first has come."""
        return not self._studio.is_closed

    def connect(self, wake: Callable[[], None], token: str | None = None) -> messages.Client:
        """Return a new client.

        Parameters
        ----------
        wake
            Called, from any thread, when the client's outbox has something to take.
        token
            What the client is to come back with, where it does not know that.

        Raises
        ------
        TooManyClientsError
            There are four already.
        """
        with self._lock:
            if len(self._clients) >= MOST_CLIENTS:
                raise TooManyClientsError(f"{MOST_CLIENTS} pages look through this viewfinder; close one of them")
            self._last_number += 1
            client = messages.Client(self._last_number, wake, token)
            self._clients[client.number] = client
        self._engine.wake()
        return client

    def disconnect(self, client: messages.Client) -> None:
        """Forget a client; the device is freed when it was the last."""
        with self._lock:
            self._clients.pop(client.number, None)
        self._engine.wake()

    def receive(self, client: messages.Client, text: str) -> None:
        """Take a message of a client; whatever is wrong with it is reported to the client alone."""
        try:
            message = messages.read_message(text)
        except messages.BadMessageError as problem:
            client.error(str(problem), problem.id, "message", place_of(str(problem)))
            return
        if isinstance(message, messages.Ack):
            client.outbox.acknowledge(message.frame)
            self._engine.wake()
        elif message.type in ("ping", "hello"):
            client.done(message.id, self._studio.generation)
        else:
            try:
                self._engine.post(client, message)
            except OverflowError:
                client.error("too many requests wait; this one is left out", message.id, "message")

    def tell(self, message: Mapping[str, Any]) -> None:
        """Say something to all clients."""
        self._studio.tell(message)

    def _read_again(self) -> None:
        """Show the scene as its files are now; an error leaves the last good picture."""
        try:
            scene = self.origin.load()
        except Exception as problem:  # the watch goes on, whatever a file holds
            if not isinstance(problem, RptcamError):
                LOG.exception("the scene file could not be read")
            self._studio.file_error = scene_error(text_of(problem))
            self.tell(self._studio.file_error)
            return
        self._engine.show_file(scene)

    def close(self, timeout_s: float = 0.6) -> bool:
        """End; return whether the device was freed in time, and not still compiling."""
        if self._watch is not None:
            self._watch.stop()
        return self._engine.stop(timeout_s)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close(10.0)
