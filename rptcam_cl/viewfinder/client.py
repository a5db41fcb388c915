"""One page that looks through the viewfinder: what it wants to see, and what waits for it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field, replace
from typing import Any

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.viewfinder.messages import Magnify, View
from rptcam_cl.viewfinder.outbox import Outbox
from rptcam_cl.viewfinder.pictures import Format


@dataclass(frozen=True)
class Wishes:
    """How a client wants its pictures; see `View`."""

    width: int = 1920
    height: int = 1080
    overlays: Mapping[str, bool] = field(default_factory=dict)
    zebra_level: float = 0.95
    peaking_level: float = 0.5
    format: Format = "jpeg"
    quality: int = 85
    panels: tuple[str, ...] = ()

    def changed(self, view: View) -> Wishes:
        """Return the wishes with those that a message gives."""
        given = view.model_dump(exclude_none=True, exclude={"type", "id"})
        if "panels" in given:
            given["panels"] = tuple(given["panels"])
        if "overlays" in given:
            given["overlays"] = {**self.overlays, **given["overlays"]}
        return replace(self, **given)

    def overlays_on(self) -> tuple[str, ...]:
        """Return the names of the overlays that are wanted."""
        return tuple(name for name, wanted in self.overlays.items() if wanted)


class Client:
    """A page, its wishes and its outbox.

    Parameters
    ----------
    number
        Of the client, from 1.
    wake
        Called, from any thread, when there is something to send.
    token
        What it is to come back with; None where it knows that.
    """

    def __init__(self, number: int, wake: Callable[[], None], token: str | None = None) -> None:
        self.token = token
        self.number = number
        self.outbox = Outbox(wake)
        self.wishes = Wishes()
        self.pointer: tuple[float, float] | None = None
        self.magnifier: Magnify | None = None
        self.shown: dict[str, int] = {}  # by slot: number of the picture that was sent last
        self.counted: dict[str, int] = {}  # and of the one whose histogram was sent last
        self.answers: int | None = None  # the change of this client that is in force
        self.lens_at: tuple[tuple[float, float] | None, int] | None = None  # pointer and generation of the last panel
        self.pointed_at: tuple[tuple[float, float] | None, int | None] | None = None  # and the picture under it
        self.was_greeted = False

    def forget_pictures(self) -> None:
        """Take whatever comes next for new."""
        self.shown.clear()
        self.counted.clear()
        self.lens_at = self.pointed_at = None

    def done(self, number: int | None, generation: int, **more: Any) -> None:
        """Say that a request is in force."""
        if number is not None:
            self.outbox.answer({"type": "done", "id": number, "generation": generation, **more})

    def error(self, message: str, number: int | None, source: str, where: str | None = None) -> None:
        """Say what is wrong."""
        self.outbox.answer({"type": "error", "id": number, "message": message, "where": where, "source": source})
