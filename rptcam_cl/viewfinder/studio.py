"""The scene before the viewfinder: its slots A and B, opened and closed with the device, and what is said to all."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from rptcam_cl.api import RenderSession
from rptcam_cl.core.errors import InputError, RptcamError
from rptcam_cl.scene import Scene, change_scene, set_keys
from rptcam_cl.viewfinder.client import Client
from rptcam_cl.viewfinder.compare import as_model
from rptcam_cl.viewfinder.dials import Dials, read_dials
from rptcam_cl.viewfinder.lens_panel import LensPanel
from rptcam_cl.viewfinder.opening import WITHOUT_METER, open_session
from rptcam_cl.viewfinder.origin import Changes, Origin, scene_error
from rptcam_cl.viewfinder.slot import Slot

NO_COMPARISON: dict[str, Any] = {"mode": "off", "model": None, "changes": {}, "difference": False}


class Studio:
    """What the engine's thread works on.

    Parameters
    ----------
    origin
        The scene file.
    device, size
        As `RenderSession` takes them.
    clients
        Returns those that are connected.
    """

    def __init__(
        self, origin: Origin, device: str | None, size: tuple[int, int] | None, clients: Callable[[], Iterable[Client]]
    ) -> None:
        self.origin = origin
        self._device, self._size, self._clients = device, size, clients
        self._scene: Scene | None = None
        self._kept: tuple[Changes, Dials | None] = (Changes(), None)
        self._by_hand: dict[str, Any] = {}  # what the scene's camera did not find by itself
        self.a: Slot | None = None
        self.b: Slot | None = None
        self.panel: LensPanel | None = None
        self.compare: dict[str, Any] = dict(NO_COMPARISON)
        self.paused = False
        self.was_seen = False
        self.file_error: dict[str, Any] | None = None
        self._busy: dict[str, bool] = {}
        self.generation = 0

    @property
    def is_closed(self) -> bool:
        """Whether no device is held."""
        return self.a is None

    @property
    def slots(self) -> list[Slot]:
        """The slots that are open."""
        return [slot for slot in (self.a, self.b) if slot is not None]

    @property
    def compares_difference(self) -> bool:
        """Whether the difference of both pictures is wanted."""
        return self.b is not None and bool(self.compare["difference"])

    def slot(self, name: str) -> Slot:
        """Return a slot by its name.

        Raises
        ------
        InputError
            It is not open.
        """
        found = self.a if name == "A" else self.b
        if found is None:
            raise InputError(f"slot: {name} is not open (allowed: A{', and B while two are compared' * (name == 'B')})")
        return found

    def load(self) -> Scene:
        """Return the scene of the file.

        Raises
        ------
        InputError, StateError
            It cannot be used.
        """
        self._scene = self._sized(self.origin.load())
        return self._scene

    def open(self) -> None:
        """Take the device, unless it is held: the scene is as it was when it was left."""
        if self.a is not None:
            return
        assert self._scene is not None, "loaded before the engine starts"
        opened = open_session(self._scene, self._device)
        session, (kept, dials) = opened.session, self._kept
        turned = self._turned(kept)
        self._by_hand = opened.by_hand
        changes = Changes({**self._by_hand, **turned})
        if turned:
            try:
                session.change(changes.as_dict())
            except InputError:  # the camera was turned to where its meter finds no light
                changes.add(WITHOUT_METER)
                session.change(changes.as_dict())
                dials = read_dials(session.scene, dials)
        self.a = Slot("A", session, changes, dials)
        if opened.problem is not None:
            self.file_error = scene_error(str(opened.problem))
        for client in self._clients():
            client.forget_pictures()
        self.panel = LensPanel(session.device)
        self.set_compare(self.compare)

    def _sized(self, scene: Scene) -> Scene:
        return scene if self._size is None else change_scene(scene, film={"resolution": self._size})

    def close(self) -> None:
        """Free the device; what was changed is kept."""
        if self.a is not None:
            self._kept = (self.a.changes, self.a.dials)
        self._let_go()

    def _let_go(self) -> None:
        slots, self.a, self.b, self.panel, self.paused = self.slots, None, None, None, False
        for slot in slots:
            slot.close()

    def fail(self, problem: Exception) -> None:
        """Say to all that the device or a frame failed, and free it.

        The next client or request takes it anew, with the changes that were shown last: others may be why it failed.
        """
        self.tell({"type": "error", "id": None, "message": text_of(problem), "where": None, "source": "device"})
        if self.a is not None:
            self._kept = self.a.shown_changes
        self.compare = dict(NO_COMPARISON)
        with contextlib.suppress(Exception):  # what is broken may not close either
            self._let_go()

    def tell(self, message: Mapping[str, Any]) -> None:
        """Say something to all clients."""
        for client in self._clients():
            client.outbox.answer(message)

    def change(
        self, name: str, keys: Mapping[str, Any], *, transient: bool = False, dials: Dials | None = None
    ) -> None:
        """Change a slot; what A gets, B gets too, where it has nothing else for it.

        Raises
        ------
        InputError
            Nothing is changed then.
        """
        slot = self.slot(name)
        slot.change(keys, transient=transient, dials=dials)
        self._tell_compiling(slot, not slot.compiling)
        if name == "A" and self.b is not None:
            own = {key: value for key, value in keys.items() if not _touches(key, self.b_keys)}
            try:
                self.b.change(own, transient=transient)
                self._tell_compiling(self.b, not self.b.compiling)
            except InputError as problem:
                self.b.messages = (f"B keeps its own: {problem}",)
        self.generation = slot.next_generation

    @property
    def b_keys(self) -> tuple[str, ...]:
        """Keys that B has of its own."""
        return tuple(self.compare["changes"]) + (("camera",) if self.compare["model"] else ())

    def check_compiled(self, slot: Slot) -> None:
        """See whether the kernels of a slot are compiled."""
        slot.arrive()
        self._tell_compiling(slot, not (slot.compiling or slot.awaits_kernels))

    def _tell_compiling(self, slot: Slot, ready: bool) -> None:
        if self._busy.get(slot.name, False) == (not ready):
            return
        self._busy[slot.name] = not ready
        text = "until then the old picture gets finer" if slot.compiling else "until then the picture is coarse"
        text = "" if ready else f"the kernels are being compiled; {text}"
        for client in self._clients():
            client.outbox.news(
                ("compiling", slot.name), {"type": "compiling", "slot": slot.name, "busy": not ready, "text": text}
            )

    def set_compare(self, wanted: Mapping[str, Any]) -> None:
        """Open, change or close the second slot.

        Raises
        ------
        InputError
            B cannot be as wanted; it is closed then.
        """
        self.compare = dict(wanted)
        if self.b is not None:
            self.b.close()
            self.b = None
        if self.a is None or wanted["mode"] == "off":
            return
        keys = dict(wanted["changes"])
        if wanted["model"] is not None:
            keys = {**as_model(self.a.scene, self.a.resolved, wanted["model"]), **keys}
        session = RenderSession(self.a.scene, device=self._device, wait=False)
        try:
            change = session.change(keys, wait=False)
        except BaseException:
            session.close()
            self.compare = dict(NO_COMPARISON)
            raise
        changes = Changes(self.a.changes.as_dict())
        changes.add(keys)
        self.b = Slot("B", session, changes)
        self.b.touched(False, change)
        for client in self._clients():
            client.shown.pop("B", None)
            client.shown.pop("difference", None)

    def _turned(self, changes: Changes) -> dict[str, Any]:
        """Return changes without those that stand where the scene's camera found nothing."""
        found = changes.as_dict().items()
        return {key: value for key, value in found if key not in self._by_hand or self._by_hand[key] != value}

    def replace(self, scene: Scene) -> list[str]:
        """Show another state of the scene file, with the changes that still fit; return what did not fit."""
        scene = self._sized(scene)
        if self.a is None:
            self._scene = scene
            return []
        slot = self.a
        turned, by_hand = self._turned(slot.changes), self._by_hand
        try:
            change, self._by_hand = slot.session.replace(scene, wait=False), {}
        except InputError:
            if not by_hand:
                raise
            change = slot.session.replace(set_keys(scene, by_hand), wait=False)
        slot.touched(False, change)
        self._scene = scene
        wanted, slot.changes = {**self._by_hand, **turned}, Changes()
        dropped = _apply(slot, wanted)
        slot.dials = read_dials(slot.scene, slot.dials)
        self._tell_compiling(slot, not slot.compiling)
        try:
            self.set_compare(self.compare)
        except InputError as problem:
            dropped.append(f"the comparison: {problem}")
        return dropped

    def reset(self, prefix: str) -> None:
        """Go back to the scene file, as a whole or in the keys that begin so."""
        assert self._scene is not None and self.a is not None
        self.a.changes.drop(prefix)
        self.replace(self._scene)


def text_of(problem: Exception) -> str:
    """Return what to say of an error."""
    return str(problem) if isinstance(problem, RptcamError) else f"unexpected {type(problem).__name__}: {problem}"


def _apply(slot: Slot, keys: Mapping[str, Any]) -> list[str]:
    """Change a slot, by one key after the other where not all fit together; return what did not fit."""
    if not keys:
        return []
    try:
        slot.change(keys)
    except InputError:
        pass
    else:
        return []
    dropped = []
    for key, value in keys.items():
        try:
            slot.change({key: value})
        except InputError as problem:
            dropped.append(f"{key}: {problem}")
    return dropped


def _touches(key: str, others: Iterable[str]) -> bool:
    """Whether a key path lies on the way to one of others, or below it."""
    return any(key == other or key.startswith(f"{other}.") or other.startswith(f"{key}.") for other in others)
