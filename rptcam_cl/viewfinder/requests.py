"""What the engine does for each kind of message."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

from rptcam_cl.core.errors import DeviceError, InputError, RptcamError, StateError
from rptcam_cl.viewfinder import messages
from rptcam_cl.viewfinder.click_focus import FocusOrder, focus_at, focus_zones
from rptcam_cl.viewfinder.client import Client
from rptcam_cl.viewfinder.dials import turn_dial, zoom_clicks
from rptcam_cl.viewfinder.inbox import Request
from rptcam_cl.viewfinder.moves import moved, viewpoint_of
from rptcam_cl.viewfinder.origin import place_of, scene_error
from rptcam_cl.viewfinder.pictures import FILE_MEDIA, file_bytes, file_name
from rptcam_cl.viewfinder.studio import Studio, text_of

LOG = logging.getLogger("rptcam_cl.viewfinder")


class Requests:
    """Answers messages; only the engine's thread uses it.

    Parameters
    ----------
    studio
        What the messages are about.
    """

    def __init__(self, studio: Studio) -> None:
        self._studio = studio
        self._waiting: list[Request] = []
        self._announced: list[Request] = []  # those whose clients know that they wait
        self._handlers: dict[type[messages.Message], Callable[[Client | None, Any], None]] = {
            messages.Set: self._set,
            messages.Dial: self._dial,
            messages.Move: self._move,
            messages.Reset: self._reset,
            messages.Focus: self._focus,
            messages.Autofocus: self._autofocus,
            messages.Pointer: self._pointer,
            messages.Magnify: self._magnify,
            messages.Compare: self._compare,
            messages.Save: self._save,
            messages.SceneText: self._scene,
            messages.CommandLine: self._command,
            messages.Pause: self._pause,
            messages.Resume: self._pause,
            messages.View: self._view,
            messages.SceneRead: self._scene_read,
        }

    def answer(self, request: Request) -> None:
        """Do what a message asks; what is wrong with it is reported to its client."""
        client, message = request.client, request.message
        try:
            self._handlers[type(message)](client, message)
        except (InputError, StateError) as problem:
            self._refuse(client, message, problem)
            return
        except Exception as problem:
            LOG.exception("the viewfinder met an unexpected error in a message %s", type(message).__name__)
            if client is not None:
                client.error(text_of(problem), message.id, "device" if isinstance(problem, DeviceError) else "change")
            if isinstance(problem, DeviceError):
                raise
            return
        if client is not None and isinstance(message, messages.Set | messages.Dial | messages.Move):
            client.answers = message.id
        if client is not None and not isinstance(message, _WITH_OWN_ANSWER):
            client.done(message.id, self._studio.generation)

    def _refuse(self, client: Client | None, message: messages.Message, problem: RptcamError) -> None:
        if client is not None:
            text = str(problem)
            source = "save" if isinstance(message, messages.Save) else "change"
            client.error(text, message.id, source, place_of(text))

    def _set(self, client: Client | None, message: messages.Set) -> None:
        self._studio.change(message.slot, message.changes, transient=message.transient)

    def _dial(self, client: Client | None, message: messages.Dial) -> None:
        slot = self._studio.slot(message.slot)
        turned = turn_dial(slot.dials, slot.scene, slot.resolved, message.name, message.value, slot.reading_cd_m2)
        slot.messages = turned.messages
        if turned.changes:
            self._studio.change(message.slot, turned.changes, transient=message.transient, dials=turned.dials)
        slot.dials = turned.dials

    def _move(self, client: Client | None, message: messages.Move) -> None:
        slot = self._studio.slot("A")
        if message.kind == "zoom":
            turned = zoom_clicks(slot.dials, slot.scene, slot.resolved, message.dy)
            slot.messages = turned.messages
            if turned.changes:
                self._studio.change("A", turned.changes, transient=message.transient, dials=turned.dials)
        else:
            before = viewpoint_of(slot.resolved)
            keys = moved(before, message.kind, message.dx, message.dy, message.dz).changes(before)
            if keys:
                self._studio.change("A", keys, transient=message.transient)

    def _reset(self, client: Client | None, message: messages.Reset) -> None:
        self._studio.reset("camera" if message.what == "camera" else "")

    @property
    def any_waits(self) -> bool:
        """Whether requests wait until their kernels are compiled."""
        return bool(self._waiting)

    def answer_waiting(self) -> None:
        """Answer the requests whose kernels have been compiled meanwhile."""
        self._announced, self._waiting = self._waiting, []
        for request in self._announced:
            self.answer(request)

    def _compiles(self, client: Client | None, message: messages.Focus | messages.Autofocus, **place: Any) -> bool:
        """Return whether another process is still at the kernels of a search for focus; the picture goes on then."""
        slot = self._studio.slot("A")
        method = message.method if isinstance(message, messages.Autofocus) else None
        order = FocusOrder(slot.session.device.info.id, slot.scene, method, place)
        if slot.session.is_carried_out(("focus", method), order.pickled):
            return False
        request = Request(client, message)
        if client is not None and request not in self._announced:
            text = "autofocus: its kernels are being compiled, the picture goes on"
            client.outbox.news("focus", {"type": "notice", "kind": "focus", "ok": True, "text": text})
        self._waiting.append(request)
        return True

    def _focus(self, client: Client | None, message: messages.Focus) -> None:
        if not self._compiles(client, message, point=(message.x, message.y)):
            slot = self._studio.slot("A")
            self._focused(client, message, focus_at(slot.scene, slot.session.device, message.x, message.y))

    def _autofocus(self, client: Client | None, message: messages.Autofocus) -> None:
        zones = None if message.zones is None else [tuple(zone) for zone in message.zones]
        if not self._compiles(client, message, zones=zones):
            slot = self._studio.slot("A")
            self._focused(client, message, focus_zones(slot.scene, slot.session.device, message.method, zones))

    def _focused(self, client: Client | None, message: messages.Message, focused: Any) -> None:
        self._studio.change("A", focused.changes)
        if client is not None:
            client.outbox.answer({"type": "focused", "id": message.id, **focused.as_dict()})

    def _pointer(self, client: Client | None, message: messages.Pointer) -> None:
        if client is not None:
            client.pointer = message.place

    def _magnify(self, client: Client | None, message: messages.Magnify) -> None:
        if client is not None:
            client.magnifier = None if message.place is None else message
            client.shown.pop("A", None)

    def _view(self, client: Client | None, message: messages.View) -> None:
        if client is not None:
            client.wishes = client.wishes.changed(message)
            client.forget_pictures()

    def _compare(self, client: Client | None, message: messages.Compare) -> None:
        wanted = message.model_dump(include={"mode", "model", "changes", "difference"})
        now = self._studio.compare
        both_on = "off" not in (wanted["mode"], now["mode"])
        if both_on and all(wanted[key] == now[key] for key in ("model", "changes")):
            self._studio.compare = wanted
        else:
            self._studio.set_compare(wanted)

    def _save(self, client: Client | None, message: messages.Save) -> None:
        slot = self._studio.slot(message.slot)
        if slot.session.spp == 0:
            slot.session.take(1)
        data = file_bytes(slot.session.image(), message.format)
        name = file_name(message.name, message.format)
        if client is not None:
            media = FILE_MEDIA[message.format]
            client.outbox.answer({"type": "file", "id": message.id, "name": name, "media": media}, data)

    def _scene(self, client: Client | None, message: messages.SceneText) -> None:
        slot = self._studio.slot(message.slot)
        text = self._studio.origin.text(slot.scene)
        if client is not None:
            client.outbox.answer({"type": "scene", "id": message.id, "yaml": text, "name": self._studio.origin.name})

    def _command(self, client: Client | None, message: messages.CommandLine) -> None:
        slot = self._studio.slot(message.slot)
        text = self._studio.origin.command(slot.scene, slot.session.spp)
        if client is not None:
            client.outbox.answer({"type": "command", "id": message.id, "text": text})

    def _pause(self, client: Client | None, message: messages.Pause | messages.Resume) -> None:
        self._studio.paused = isinstance(message, messages.Pause)

    def _scene_read(self, client: Client | None, message: messages.SceneRead) -> None:
        try:
            dropped = self._studio.replace(message.scene)
        except InputError as problem:
            self._studio.file_error = scene_error(str(problem))
            self._studio.tell(self._studio.file_error)
            return
        self._studio.file_error = None
        text = "; ".join(("the scene file was read again", *(f"no longer possible: {item}" for item in dropped)))
        self._studio.tell({"type": "notice", "kind": "watch", "ok": True, "text": text})


_WITH_OWN_ANSWER = (
    messages.Focus, messages.Autofocus, messages.Save, messages.SceneText, messages.CommandLine, messages.Pointer,
    messages.Magnify,
)  # fmt: skip
