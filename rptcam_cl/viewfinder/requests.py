"""What the viewfinder does for each kind of message."""

from __future__ import annotations

import contextlib
import logging
import math
import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, replace
from functools import partial
from typing import Any

from rptcam_cl.api.combined import focus_stack
from rptcam_cl.core.errors import DeviceError, InputError, StateError, near_name
from rptcam_cl.imaging.image import Image
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.lens_settings import METHODS
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies.focus.controller import autofocus
from rptcam_cl.studies.focus.drives import focus_drive
from rptcam_cl.studies.focus.probe import FocusReport, NoContrast, Probe
from rptcam_cl.studies.focus.servo import FrameFocus, FrameTracker
from rptcam_cl.viewfinder import messages, things, timeline
from rptcam_cl.viewfinder.background import Background, BackgroundTask
from rptcam_cl.viewfinder.dials import turn_dial, turn_focus, zoom_by
from rptcam_cl.viewfinder.panel import Clock
from rptcam_cl.viewfinder.slot import Slot
from rptcam_cl.viewfinder.studio import History, Studio, place_of, scene_error, text_of, values_before

LOG = logging.getLogger("rptcam_cl.viewfinder")
CHANGE_THE_CAMERA = ("set", "dial", "move", "time", "lamp", "add")
_LEAVES_FOCUS = {"exposure", "picture", "sensor", "sequence"}  # parts whose change leaves a search for focus as it is
_LEAD_TO_STATES = ("set", "dial", "move", "reset", "focus", "autofocus", "compare", "lamp", "add")
_WITH_OWN_ANSWER = ("focus", "autofocus", "save", "stack", "scene", "command", "pointer", "magnify", "select")


class Requests:
    """Answers messages; only the engine's thread uses it.

    Parameters
    ----------
    studio
        What the messages are about.
    background
        Does what takes long.
    """

    def __init__(self, studio: Studio, background: Background) -> None:
        self._studio = studio
        self._searching, self._saving = background.worker("focus"), background.worker("save")
        self._selecting, self._stacking = background.worker("select"), background.worker("stack")
        self._tracking = background.worker("track")
        self._tracked: tuple[int, dict[str, Any]] | None = None  # frame and changes whose focus was sought last
        self._tracks_later = False  # once its kernels are compiled
        self._tracker: tuple[Any, str, FrameTracker] | None = None  # of a session and a scene; the worker's alone
        self.history = History(studio)
        self._acted = False  # whether somebody changed something since the last state was noted
        self._waiting: list[messages.Request] = []
        self._announced: list[messages.Request] = []  # those whose clients know that they wait
        self._handlers: dict[str, Callable[[messages.Client, Any], None]] = {
            "set": self._set,
            "dial": self._dial,
            "move": self._move,
            "reset": self._reset,
            "focus": self._focus,
            "autofocus": self._autofocus,
            "pointer": self._pointer,
            "magnify": self._magnify,
            "compare": self._compare,
            "save": self._save,
            "stack": self._stack,
            "scene": self._text,
            "command": self._text,
            "pause": self._pause,
            "resume": self._pause,
            "view": self._view,
            "denoise": self._denoise,
            "history": self._history,
            "time": self._time,
            "select": self._select,
            "lamp": self._lamp,
            "add": self._add,
        }

    def answer(self, request: messages.Request | Scene) -> None:
        """Do what a message asks; what is wrong with it is reported to its client."""
        if isinstance(request, Scene):
            self._show_file(request)
            return
        client, message = request
        self._acted = self._acted or message.type in _LEAD_TO_STATES
        try:
            self._handlers[message.type](client, message)
        except (InputError, StateError) as problem:
            text = str(problem)
            client.error(text, message.id, "save" if message.type == "save" else "change", place_of(text))
            return
        except Exception as problem:
            LOG.exception("the viewfinder met an unexpected error in a message %s", message.type)
            client.error(text_of(problem), message.id, "device" if isinstance(problem, DeviceError) else "change")
            if isinstance(problem, DeviceError):
                raise
            return
        if message.type in CHANGE_THE_CAMERA:
            client.answers = message.id
        if message.type not in _WITH_OWN_ANSWER:
            client.done(message.id, self._studio.generation)

    def _set(self, client: messages.Client, message: messages.Set) -> None:
        self._change(message.slot, message.changes, transient=message.transient)

    def _change(self, name: str, keys: Mapping[str, Any], **how: Any) -> None:
        """Change a slot by hand, which ends a search for the focus of another camera, or of another scene."""
        if name == "A":
            panel, transient = self._studio.slot("A").panel, how.get("transient", False)
            keys = self._studio.recorder.rewrite(panel, keys, transient=transient)
        change = self._studio.change(name, keys, **how)
        if name == "A" and not set(change.keys) <= _LEAVES_FOCUS:
            self.leave_search()

    def leave_search(self) -> None:
        """End the search for focus, where one runs or waits."""
        self._searching.end()
        for request in self._waiting:
            self._supersede(*request)
        self._waiting.clear()

    def give_up(self, requests: list[messages.Request | Scene], problem: Exception) -> list[Scene]:
        """Say of requests that a problem has left them undone, and of those that wait for a device that is let go of.

        Returns
        -------
        list of Scene
            The scenes among them, which are still to be shown.
        """
        undone = [request for request in requests if not isinstance(request, Scene)]
        if self._studio.is_closed:
            undone += self._waiting
            self._waiting.clear()
        for client, message in undone:
            if message.id is not None:
                client.error(f"left undone: {text_of(problem)}", message.id, "change")
        return [request for request in requests if isinstance(request, Scene)]

    def _supersede(self, client: messages.Client, message: messages.AnyMessage) -> None:
        """Say of a request that something else has taken its place."""
        client.done(message.id, self._studio.generation, superseded=True)

    @property
    def is_searching(self) -> bool:
        """Whether a search for focus runs."""
        return bool(self._searching.tasks)

    def _dial(self, client: messages.Client, message: messages.Dial) -> None:
        slot = self._studio.slot(message.slot)
        if message.name.startswith("thing_"):
            turned = things.turn_thing(slot.panel, self._studio.selected, message.name, message.value)
        elif message.name.startswith(things.APART):
            groups, together = slot.session.light_groups, [name for name in slot.comes_last if name != "sensor"]
            turned = things.turn_mix(slot.panel, groups, message.name, message.value, together)
        else:
            turned = turn_dial(slot.panel, message.name, message.value)
        slot.messages = turned.messages
        if turned.changes:
            self._change(message.slot, turned.changes, transient=message.transient, dials=turned.dials)
        else:
            slot.note_hand(message.transient)
            slot.show_again()  # which is the answer
        slot.dials = turned.dials

    def _move(self, client: messages.Client, message: messages.Move) -> None:
        slot = self._studio.slot("A")
        if message.kind == "zoom":
            turned = zoom_by(slot.panel, message.dy)
            slot.messages = turned.messages
            if turned.changes:
                self._change("A", turned.changes, transient=message.transient, dials=turned.dials)
        else:
            before = things.viewpoint_of(slot.resolved)
            keys = things.moved(before, message.kind, message.dx, message.dy, message.dz).changes(before)
            if keys:
                self._change("A", keys, transient=message.transient)

    def _reset(self, client: messages.Client, message: messages.Reset) -> None:
        self.leave_search()
        self._studio.reset("camera" if message.what == "camera" else "")

    @property
    def any_waits(self) -> bool:
        """Whether requests wait until their kernels are compiled."""
        return bool(self._waiting) or self._tracks_later

    def answer_waiting(self) -> None:
        """Answer the requests whose kernels have been compiled meanwhile."""
        self._announced, self._waiting = self._waiting, []
        for request in self._announced:
            self.answer(request)

    def _compiles(
        self, client: messages.Client, message: messages.FocusRequest | messages.Autofocus, **place: Any
    ) -> bool:
        """Return whether another process is still at the kernels of a search for focus; the picture goes on then."""
        slot = self._studio.slot("A")
        method = message.method if isinstance(message, messages.Autofocus) else None
        order = partial(focus_order, slot.session.device.info.id, slot.scene, method, place)
        if slot.session.is_carried_out(("focus", method), order):
            return False
        request = (client, message)
        if request not in self._announced:
            text = "autofocus: its kernels are being compiled, the picture goes on"
            client.outbox.news("focus", {"type": "notice", "kind": "focus", "ok": True, "text": text})
        self._waiting.append(request)
        return True

    def track_focus(self) -> None:
        """Have the focus of the frame that is shown found as ``--frames`` finds it, where each frame has its own.

        While frames play the focus comes after them, as the last that was found.
        """
        studio, slot, self._tracks_later = self._studio, self._studio.a, False
        if slot is None or not studio.focuses_each_frame or slot.dials.clock.frame < 1:
            self._tracked = None
            self._tracking.end()
            return
        frame, plays = slot.dials.clock.frame, studio.recorder.is_playing
        state = frame, {key: value for key, value in slot.changes.items() if key.split(".")[0] not in _LEAVES_FOCUS}
        if state == self._tracked or (slot.rests_in() > 0 and not plays) or (plays and self._tracking.tasks):
            return
        file = studio.as_file(slot)
        order = partial(focus_order, slot.session.device.info.id, file, None, {})
        self._tracks_later = not slot.session.is_carried_out(("focus", "frames"), order)
        if self._tracks_later:
            return
        self._tracking.end()
        self._tracked, device = state, slot.session.device.beside()

        def work(task: BackgroundTask) -> tuple[float, str]:
            if file.sequence is None or file.sequence.continuous_focus is None:
                report = autofocus(set_keys(file, timeline.at_frame(file, slot.dials.clock, frame)[0]), device=device)
                return report.state, f"Focus of frame {frame}: {report.focus_distance_m or math.inf:.4g} m"
            name, kept, self._tracker = file.content_hash(), self._tracker, None  # none that is left within a frame
            if kept is None or kept[:2] != (slot.session, name):
                kept = slot.session, name, FrameTracker(file, lambda: device)
            scene, metadata = kept[2].frame(frame)
            self._tracker, found = kept, FrameFocus.of(frame, 0.0, scene, metadata)
            off = "nothing to focus on"
            if found.off is not None:
                off = f"{found.off:+.2f} depths of focus off the subject at {found.subject_m:.4g} m"
            return metadata["continuous_focus"]["state"], f"Focus of frame {frame}: {found.focus_m:.4g} m, {off}"

        def done(found: tuple[float, str]) -> None:
            studio.change("A", state_changes(slot.scene, found[0]), by_hand=False)
            slot.messages = (found[1],)

        def failed(problem: Exception) -> None:
            text = f"the focus of frame {frame} is not found: {text_of(problem)}"
            studio.tell({"type": "notice", "kind": "focus", "ok": False, "text": text})
            if not isinstance(problem, InputError | StateError):
                raise problem

        self._tracking.start(BackgroundTask(f"focus of frame {frame}", work, done, failed))

    def _focus(self, client: messages.Client, message: messages.FocusRequest) -> None:
        self._leave_other_search(message)
        if not self._compiles(client, message, point=(message.x, message.y)):
            self._search(client, message, partial(focus_at, x=message.x, y=message.y))

    def _autofocus(self, client: messages.Client, message: messages.Autofocus) -> None:
        self._leave_other_search(message)
        zones = None if message.zones is None else [tuple(zone) for zone in message.zones]
        check_search(message.method, zones)
        if not self._compiles(client, message, zones=zones):
            self._search(client, message, partial(autofocus, method=message.method, zones=zones))

    def _leave_other_search(self, message: messages.FocusRequest | messages.Autofocus) -> None:
        if all(waiting is not message for _, waiting in self._announced):
            self.leave_search()

    def _search(
        self,
        client: messages.Client,
        message: messages.FocusRequest | messages.Autofocus,
        find: Callable[..., FocusReport],
    ) -> None:
        """Search for the focus while the picture goes on; the camera follows what is found by and by."""
        slot = self._studio.slot("A")
        scene, device = slot.scene, slot.session.device.beside()
        curve: list[dict[str, Any]] = []
        followed: set[str] = set()  # keys that the search has changed

        def on_probe(task: BackgroundTask, probe: Probe) -> None:
            point = {"position": probe.place, "score": probe.measures[0].value, "round": probe.round}
            curve.append(point | {"quantity": "contrast" if probe.images else "displacement"})
            points = list(curve)
            task.post(lambda: client.outbox.news("search", {"type": "search", "curve": points}))

        def work(task: BackgroundTask) -> FocusReport:
            def follow(state: float) -> None:
                task.post(lambda: self._follow(scene, state, followed))

            return find(scene, device=device, on_probe=partial(on_probe, task), on_state=follow)

        def done(report: FocusReport) -> None:
            self._studio.change("A", self._changes_to(scene, report))
            client.outbox.answer({"type": "focused", "id": message.id, **describe_focus(report)})

        def failed(problem: Exception) -> None:
            client.error(text_of(problem), message.id, "change", place_of(str(problem)))
            if not isinstance(problem, InputError | StateError):
                raise problem
            if followed:
                self._studio.change("A", values_before(scene, followed))

        ended = partial(self._supersede, client, message)
        self._searching.start(BackgroundTask("focus search", work, done, failed, ended=ended))

    def _changes_to(self, scene: Scene, report: FocusReport) -> Mapping[str, Any]:
        """Return the changes that set the focus that was found: where it has keys, by its distance, as these are."""
        recorder, panel = self._studio.recorder, self._studio.slot("A").panel
        if recorder.is_on or timeline.is_keyed(scene, "focus"):
            keys = turn_focus(panel, report.focus_distance_m or 0.0).changes
            return recorder.rewrite(panel, keys, transient=False)
        return state_changes(scene, report.state)

    def _follow(self, scene: Scene, state: float, followed: set[str]) -> None:
        """Set the focus to where a search takes it to be by now."""
        if self._studio.recorder.is_on or timeline.is_keyed(scene, "focus"):
            return
        keys = state_changes(scene, state)
        with contextlib.suppress(InputError):  # what cannot be shown is not
            self._studio.change("A", keys)
            followed.update(keys)

    def _pointer(self, client: messages.Client, message: messages.Pointer) -> None:
        client.pointer = message.place

    def _magnify(self, client: messages.Client, message: messages.Magnify) -> None:
        client.magnifier = None if message.place is None else message
        client.forget_picture("A")

    def _view(self, client: messages.Client, message: messages.ViewRequest) -> None:
        client.settings = client.settings.changed(message)
        client.forget_pictures()

    def _compare(self, client: messages.Client, message: messages.Compare) -> None:
        wanted = message.model_dump(include={"mode", "model", "changes", "difference"})
        now = self._studio.compare
        both_on = "off" not in (wanted["mode"], now["mode"])
        if both_on and all(wanted[key] == now[key] for key in ("model", "changes")):
            self._studio.compare = wanted
        else:
            self._studio.set_compare(wanted)

    def _save(self, client: messages.Client, message: messages.Save) -> None:
        slot = self._studio.slot(message.slot)
        if slot.session.spp == 0:
            slot.session.take(1)
        name, media = messages.file_name(message.name, message.format), messages.FILE_MEDIA[message.format]
        if message.format == "dng" and slot.scene.sensor is None:
            raise InputError(messages.NO_RAW)
        later = slot.image_later()

        def done(data: bytes) -> None:
            client.outbox.answer({"type": "file", "id": message.id, "name": name, "media": media}, data)

        def failed(problem: Exception) -> None:
            client.error(text_of(problem), message.id, "save")

        def ended() -> None:
            client.error(f"{name} is not saved: the device was let go of", message.id, "save")

        def work(task: BackgroundTask) -> bytes:
            return messages.file_bytes(messages.exposed_longer(later(), message.ev), message.format)

        self._saving.start(BackgroundTask(f"saving {name}", work, done, failed, ended=ended))

    def _stack(self, client: messages.Client, message: messages.Stack) -> None:
        """Render many focuses of the scene that is shown, with the samples that it has, beside the picture."""
        self._stacking.end()
        slot, near_m, far_m = self._studio.slot("A"), message.near_m, message.far_m
        if near_m is None or far_m is None:
            client.done(message.id, self._studio.generation)
            return
        if slot.is_mixed:
            raise InputError("stack: it is rendered by the lamps as they are (allowed: lamps that are not mixed)")
        scene, device, spp = slot.scene, slot.session.device.beside(), max(slot.session.spp, 1)
        pictures: dict[str, bytes] = {}

        def work(task: BackgroundTask) -> tuple[str, str, bytes]:
            def say(number: int, count: int, _: float) -> None:
                text = f"focus stack, picture {number} of {count}"
                task.post(lambda: setattr(task, "text", text))  # by which the engine wakes, and tells it

            def keep(number: int, distance_m: float, image: Image) -> None:
                name = messages.file_name(f"{message.name} {number} at {distance_m:.4g} m", message.format)
                pictures[name] = messages.file_bytes(image, message.format)

            stacked = focus_stack(
                scene, near_m, far_m, steps=message.steps, spp=spp, device=device, on_picture=say,
                on_image=keep if message.pictures else None,
            )  # fmt: skip
            name = messages.file_name(message.name, message.format)
            data = messages.file_bytes(stacked, message.format)
            if not message.pictures:
                return name, messages.FILE_MEDIA[message.format], data
            return f"{message.name}.zip", messages.ZIP, messages.zipped({name: data, **pictures})

        def done(file: tuple[str, str, bytes]) -> None:
            name, media, data = file
            client.outbox.answer({"type": "file", "id": message.id, "name": name, "media": media}, data)

        def failed(problem: Exception) -> None:
            client.error(text_of(problem), message.id, "save", place_of(str(problem)))

        ended = partial(self._supersede, client, message)
        self._stacking.start(BackgroundTask("focus stack", work, done, failed, ended=ended))

    def _text(self, client: messages.Client, message: messages.TextRequest) -> None:
        slot, origin = self._studio.slot(message.slot), self._studio.origin
        if message.type == "scene":
            answer = {"yaml": origin.text(self._studio.as_file(slot)), "name": origin.name}
        else:
            answer = {"text": origin.command(slot.scene, slot.session.spp, slot.dials.mix if slot.is_mixed else {})}
        client.outbox.answer({"type": message.type, "id": message.id, **answer})

    def _pause(self, client: messages.Client, message: messages.Signal) -> None:
        self._studio.paused = message.type == "pause"

    def note_state(self) -> None:
        """Note the state that is shown, to go back to."""
        if not self.is_searching and self.history.note(acted=self._acted):
            self._acted = False

    def _history(self, client: messages.Client, message: messages.HistoryRequest) -> None:
        self.leave_search()
        self._tracked = None  # a state that was may have been noted before its focus was found
        self.history.note(acted=True)
        self._acted = False
        match message.do, message.number:
            case "undo", _:
                self.history.step(-1)
            case "redo", _:
                self.history.step(1)
            case "snap", _:
                self.history.snap()
            case "go", int(number):
                self.history.go(number)
            case "drop", int(number):
                self.history.drop(number)
            case "compare", int(number):
                self.history.compare(number)

    def _select(self, client: messages.Client, message: messages.Select) -> None:
        slot, studio = self._studio.slot("A"), self._studio

        def done(index: int | None) -> None:
            select(None if index is None else f"objects.{index}")

        def select(name: str | None) -> None:
            studio.selected = name
            slot.show_again()
            client.outbox.answer({"type": "selected", "id": message.id, "name": studio.selected})

        def failed(problem: Exception) -> None:
            client.error(text_of(problem), message.id, "change")

        self._selecting.end()
        if message.x is None or message.y is None:
            select(message.name)
        else:
            find = slot.session.object_later(message.x, message.y)
            ended = partial(self._supersede, client, message)
            self._selecting.start(BackgroundTask("selecting", lambda task: find(), done, failed, ended=ended))

    def _lamp(self, client: messages.Client, message: messages.Lamp) -> None:
        slot = self._studio.slot("A")
        turned = things.switch_lamp(slot.panel, message.name, message.mute, message.solo)
        if turned.changes:
            self._change("A", turned.changes)
        dark = {name: getattr(turned.dials, name) for name in ("dark", "mute", "solo")}
        slot.dials = replace(slot.dials, **dark)
        slot.show_again()

    def _add(self, client: messages.Client, message: messages.Add) -> None:
        slot = self._studio.slot("A")
        changes, name = things.add_thing(slot.panel, things.viewpoint_of(slot.resolved), message.what)
        self._change("A", changes)
        self._studio.selected = name

    def _time(self, client: messages.Client, message: messages.Time) -> None:
        slot, recorder = self._studio.slot("A"), self._studio.recorder
        if message.do == "record":
            recorder.is_on = bool(message.on)
            if slot.dials.clock.frame == 0:
                self._go(slot, 1)
            slot.show_again()
            return
        if message.do == "length" and message.frame is not None:
            self._at(replace(slot.dials.clock, frames=max(message.frame, 2)))
            slot.show_again()
            return
        if slot.dials.clock.frame == 0 and message.do != "go":
            self._go(slot, 1)
        if message.do == "go" and message.frame is not None:
            recorder.is_playing = message.playing
            self._go(slot, message.frame, transient=message.transient)
            return
        self._acted = True
        if message.channel is not None:
            self._studio.change("A", timeline.key_changes(slot.panel, message.channel, message.do))
        elif message.from_m is not None and message.to_m is not None and message.seconds is not None:
            changes, clock = timeline.rack_changes(slot.panel, message.from_m, message.to_m, message.seconds)
            self._studio.change("A", changes)
            self._at(clock)

    def _go(self, slot: Slot, frame: int, *, transient: bool = False) -> None:
        """Show a frame; what S and P have found stays, as it does in the frames that are rendered."""
        changes, clock = self._studio.recorder.go(slot.panel, frame)
        self.leave_search()
        self._studio.change("A", changes, transient=transient)
        slot.follows_light = False
        self._at(clock)

    def _at(self, clock: Clock) -> None:
        slot = self._studio.slot("A")
        slot.dials = replace(slot.dials, clock=clock)

    def _denoise(self, client: messages.Client, message: messages.Denoise) -> None:
        self._studio.denoises = message.on

    def _show_file(self, scene: Scene) -> None:
        """Show the scene file as it was read again, with what the page has changed of it."""
        self.leave_search()
        try:
            dropped = self._studio.replace(scene)
        except (InputError, StateError) as problem:
            self._studio.file_error = scene_error(str(problem))
            self._studio.tell(self._studio.file_error)
            return
        self._studio.file_error = None
        self.history.clear()
        text = "; ".join(("the scene file was read again", *(f"no longer possible: {item}" for item in dropped)))
        self._studio.tell({"type": "notice", "kind": "watch", "ok": True, "text": text})


# Focus at a click, and autofocus by zones: what `rptcam focus` finds, as changes of the scene and a curve to draw.

_MOST_ZONES = 64


def describe_focus(report: FocusReport) -> dict[str, Any]:
    """Describe a focus as plain values for a page; the curve has its probes in the order in which they were made."""
    return {
        "distance_m": _plain(report.focus_distance_m),
        "film_distance_mm": report.film_distance_mm,
        "method": report.method,
        "confidence": report.confidence,
        "failure": report.failure,
        "warnings": report.warnings,
        "zone": list(astuple(report.zone)),
        "zones": [list(astuple(zone)) for zone in report.zones],
        "samples": report.samples,
        "seconds": report.seconds,
        "curve": [
            {
                "position": probe.film_distance_mm,
                "score": _plain(probe.value),
                "error": _plain(probe.error),
                "quantity": probe.quantity,
                "round": probe.round,
            }
            for probe in report.probes
        ],
    }


def _plain(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def focus_order(device: str, scene: Scene, method: str | None, place: dict[str, Any]) -> bytes:
    """Pickle a search for `CompileServer.compile`: another process makes it first, so that this one has its kernels.

    Parameters
    ----------
    device
        Its id.
    place
        ``point`` or ``zones``, as `autofocus` takes them.
    """
    return pickle.dumps((_search_for_kernels, (device, scene, method, place)))


def _search_for_kernels(device: str, scene: Scene, method: str | None, place: dict[str, Any]) -> None:
    """Search; what is found does not count."""
    with contextlib.suppress(InputError):
        autofocus(scene, method, device=device, **place)


def focus_at(scene: Scene, x: float, y: float, **options: Any) -> FocusReport:
    """Find the focus on a point of the picture, the answer of ``rptcam focus SCENE --point x,y``.

    Where nothing there tells focus from blur, it is by the distance of what is there, and says so.

    Parameters
    ----------
    scene
        As requested: its exposure does not matter.
    x, y
        In fractions of the picture from its left and top.
    **options
        Device and callbacks, as `autofocus` takes them.

    Raises
    ------
    NoContrast, OutOfReach
        Nothing is there; it is nearer than the camera can focus, or farther.
    InputError
        The camera has no focus, or an argument is wrong.
    """
    try:
        found = autofocus(scene, point=(x, y), **options)
        if found.failure is None:
            return found
        fault = found.failure
    except NoContrast as problem:
        fault = str(problem)
    by_distance = autofocus(scene, "depth", point=(x, y), **options)
    return replace(by_distance, remarks=(*by_distance.remarks, f"by distance alone, as by contrast {fault}"))


def check_search(method: str | None, zones: Sequence[Sequence[float]] | None) -> None:
    """Raise `InputError` for a method that there is not, or too many zones."""
    if method is not None and method not in METHODS:
        allowed = ", ".join(METHODS)
        raise InputError(f"method: is none{near_name(method, METHODS)} (got {method!r}; allowed: {allowed})")
    if zones is not None and len(zones) > _MOST_ZONES:
        raise InputError(f"zones: too many (got {len(zones)}; allowed: up to {_MOST_ZONES})")


def state_changes(scene: Scene, state: float) -> dict[str, Any]:
    """Return the key paths of the scene, with their values, that set a focus state."""
    keys = focus_drive(scene).camera_keys(state)
    return {f"camera.{name}": value for name, value in keys.items() if value is not None}
