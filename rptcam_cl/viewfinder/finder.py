"""The viewfinder of one scene, for any number of pages over any transport."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from rptcam_cl.core.errors import RptcamError
from rptcam_cl.scene import Scene
from rptcam_cl.viewfinder import messages
from rptcam_cl.viewfinder.client import Client
from rptcam_cl.viewfinder.engine import Engine
from rptcam_cl.viewfinder.lens_choice import lens_entries
from rptcam_cl.viewfinder.origin import Origin, place_of, scene_error
from rptcam_cl.viewfinder.state import MOST_CLIENTS
from rptcam_cl.viewfinder.studio import Studio, text_of
from rptcam_cl.viewfinder.watch import Watch

LOG = logging.getLogger("rptcam_cl.viewfinder")


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
        self._clients: dict[int, Client] = {}
        self._last_number = 0
        self.origin = Origin(scene, overrides)
        self._studio = Studio(self.origin, device, size, self.clients)
        found = self._studio.load()
        self.warnings = found.warnings
        self._engine = Engine(self._studio, self.clients)
        self._engine.start()
        lens_entries(found)  # which the first page wants to know; meanwhile the engine opens the device
        self._watch: Watch | None = None
        if self.origin.path is not None:
            self._watch = Watch(lambda: self.origin.files, self._read_again)
            self._watch.start()

    def clients(self) -> list[Client]:
        """Return those that are connected."""
        with self._lock:
            return list(self._clients.values())

    @property
    def holds_device(self) -> bool:
        """Whether a device is held: while a page looks, and before the first has come."""
        return not self._studio.is_closed

    def connect(self, wake: Callable[[], None], token: str | None = None) -> Client:
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
            client = Client(self._last_number, wake, token)
            self._clients[client.number] = client
        self._engine.wake()
        return client

    def disconnect(self, client: Client) -> None:
        """Forget a client; the device is freed when it was the last."""
        with self._lock:
            self._clients.pop(client.number, None)
        self._engine.wake()

    def receive(self, client: Client, text: str) -> None:
        """Take a message of a client; whatever is wrong with it is reported to the client alone."""
        try:
            message = messages.read_message(text)
        except messages.BadMessageError as problem:
            client.error(str(problem), problem.id, "message", place_of(str(problem)))
            return
        if isinstance(message, messages.Ack):
            client.outbox.acknowledged(message.frame)
            self._engine.wake()
        elif isinstance(message, messages.Ping | messages.Hello):
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
        self._engine.post(None, messages.SceneRead(scene=scene))

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
