"""What the engine says to clients without a request: how the camera stands, and what lies under the pointer."""

from __future__ import annotations

import time
from typing import Any

from rptcam_cl.viewfinder.client import Client
from rptcam_cl.viewfinder.delivery import Delivery
from rptcam_cl.viewfinder.slot import Slot
from rptcam_cl.viewfinder.state import hello_message, state_message
from rptcam_cl.viewfinder.studio import Studio

STATE_S = 0.3  # between two states of a camera that moves; finding the depth of field takes longer than a glance
PANEL_S = 0.1  # between two traces of the rays under the pointer while it moves


class Reports:
    """Reports to clients what has changed; only the engine's thread uses it.

    Parameters
    ----------
    studio
        What the reports are about.
    delivery
        Makes the figures of the picture.
    """

    def __init__(self, studio: Studio, delivery: Delivery) -> None:
        self._studio, self._delivery = studio, delivery
        self._reported: tuple[Any, ...] = ()
        self._is_prepared = False
        self._last_panel = self._last_state = 0.0

    def inform(self, clients: list[Client]) -> None:
        """Tell clients how the camera stands, where that has changed, and what lies under their pointers."""
        slot = self._studio.a
        if slot is not None:
            self._state(slot, clients)
            self._point(slot, clients)
        for each in self._studio.slots:
            self._delivery.count(each, clients)

    def _state(self, slot: Slot, clients: list[Client]) -> None:
        resting = slot.rests_in() <= 0
        if not resting and time.monotonic() < self._last_state + STATE_S:
            return
        answers = tuple((client.number, client.answers) for client in clients)
        here = (slot.session.generation, slot.dials, slot.messages, self._studio.paused, resting)
        reported = (*here, *self._compared(), answers)
        if reported != self._reported and not slot.wants_glance:
            self._reported, self._last_state = reported, time.monotonic()
            message = state_message(self._studio, slot, detailed=resting)
            for client in clients:
                client.outbox.news("state", message | {"answers": client.answers})

    def prepare(self) -> None:
        """Find what the first client will want to know, while it is still on its way."""
        studio = self._studio
        if studio.a is not None and not self._is_prepared:
            self._is_prepared = True
            hello_message(studio, studio.a, 0)
            state_message(studio, studio.a, detailed=True)

    def greet(self, client: Client) -> None:
        """Tell a new client what there is and how the camera stands."""
        studio = self._studio
        if studio.a is None or client.was_greeted:
            return
        token = {} if client.token is None else {"token": client.token}
        client.outbox.answer(hello_message(studio, studio.a, client.number) | token)
        client.outbox.news("state", state_message(studio, studio.a, detailed=True))
        client.was_greeted = studio.was_seen = True
        if studio.file_error is not None:
            client.outbox.answer(studio.file_error)

    def _compared(self) -> tuple[Any, ...]:
        compare = self._studio.compare
        return (compare["mode"], compare["model"], repr(compare["changes"]), compare["difference"])

    def _point(self, slot: Slot, clients: list[Client]) -> None:
        """Meter and trace at the pointers that have moved, or under which the picture has changed."""
        shown = slot.shown
        for client in clients:
            place = (client.pointer, None if shown is None else shown.number)
            if place != client.pointed_at:
                self._delivery.meter(slot, client)
                self._lens(slot, client)
                client.pointed_at = place

    def _lens(self, slot: Slot, client: Client) -> None:
        panel = self._studio.panel
        if panel is None or "lens" not in client.wishes.panels:
            return
        at = (client.pointer, slot.session.generation)
        now = time.monotonic()
        if at == client.lens_at or (slot.rests_in() > 0 and now - self._last_panel < PANEL_S):
            return
        self._last_panel = now
        message: dict[str, Any] = {"type": "lens", "generation": slot.session.generation, "pointer": None}
        if client.lens_at is None or client.lens_at[1] != at[1]:
            message |= {"section": panel.section(slot.resolved), "numbers": panel.numbers(slot.resolved)}
        if client.pointer is not None:
            message["pointer"] = panel.pointer(slot.resolved, *client.pointer)
        client.lens_at = at
        client.outbox.news("lens" if "section" not in message else "lens with section", message)
