"""The scene before the viewfinder: where it comes from, its slots A and B, its device, and the states that were."""

from __future__ import annotations

import base64
import contextlib
import io
import json
import logging
import math
import re
import shlex
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from rptcam_cl.api.session import Change, RenderSession
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, RptcamError
from rptcam_cl.core.files import FileState, file_state, named_files, plain
from rptcam_cl.core.strict_yaml import read_yaml
from rptcam_cl.scene.changes import change_scene, set_keys
from rptcam_cl.scene.film import LIGHT_LAYER
from rptcam_cl.scene.load import load_scene, scene_text
from rptcam_cl.scene.scene import Scene
from rptcam_cl.viewfinder import instruments, lens_panel, messages, things, timeline
from rptcam_cl.viewfinder.background import Background
from rptcam_cl.viewfinder.panel import Clock, Dials, read_dials
from rptcam_cl.viewfinder.slot import Slot, with_changes
from rptcam_cl.viewfinder.timeline import Recorder

LOG = logging.getLogger("rptcam_cl.viewfinder")

# The first picture of a scene, by hand where its camera finds no focus or no light by itself.

_WITHOUT_METER = {"exposure": "relative"}


def open_session(scene: Scene, device: str | None) -> tuple[RenderSession, dict[str, Any], InputError | None]:
    """Open a session of a scene.

    Where autofocus or the exposure meter fails, the focus is set to the target of the camera and the exposure to
    ``relative``, so that there is a picture to aim by.

    Returns
    -------
    session : RenderSession
    by_hand : dict
        What was set by hand in the scene for it.
    problem : InputError or None
        Why.

    Raises
    ------
    InputError, DeviceError
        It cannot be rendered by hand either; the error is that of the scene as it is.
    """
    try:
        return RenderSession(scene, device=device, wait=False), {}, None
    except InputError as problem:
        for by_hand in _ways_by_hand(scene):
            try:
                session = RenderSession(set_keys(scene, by_hand), device=device, wait=False)
            except InputError:
                continue
            return session, by_hand, problem
        raise


def _ways_by_hand(scene: Scene) -> list[dict[str, Any]]:
    """Return the keys that set what the camera of a scene is to find: the focus, the exposure, both."""
    focus: dict[str, Any] = {}
    exposure: dict[str, Any] = {}
    camera = scene.camera
    if scene.requested_autofocus is not None:
        distance_m = scene.metres_per_unit * math.dist(camera.eye, camera.target)
        focus = {f"camera.focus{'_' if camera.lens_camera is None else '.'}distance_m": distance_m}
    if scene.exposure.mode == "auto":
        exposure = dict(_WITHOUT_METER)
    return [keys for keys in (focus, exposure, {**focus, **exposure} if focus and exposure else {}) if keys]


# Where a scene comes from, and what the page has changed of it: as a scene, as YAML, as a command line.

_PLACE = re.compile(r"^(?P<where>\S[^:\n]*:\d+:\d+): |^(?P<key>[A-Za-z_][\w.\[\]]*): ")


class Origin:
    """The scene file, or the data, that a viewfinder was opened with.

    Parameters
    ----------
    scene
        A path, a mapping as of a scene file, or a scene.
    overrides
        As ``--set`` takes them.
    """

    def __init__(self, scene: Scene | str | Path | Mapping[str, Any], overrides: Iterable[str] = ()) -> None:
        self.path = Path(scene) if isinstance(scene, str | Path) else None
        self._given = scene
        self._overrides = tuple(overrides)
        self._loaded: Scene | None = None
        self.files: frozenset[Path] = frozenset()

    @property
    def name(self) -> str:
        """File name of the scene, without its folder."""
        return "scene.yaml" if self.path is None else self.path.name

    def load(self) -> Scene:
        """Return the scene as it is now in its files; `files` are then those that it names, and its own.

        Raises
        ------
        InputError, StateError
            As `load_scene` does; `files` are then the earlier ones and those that were named up to the error.
        """
        own = frozenset() if self.path is None else frozenset({self.path.resolve()})
        with named_files() as named:
            try:
                scene = self._given if isinstance(self._given, Scene) else load_scene(self._given, self._overrides)
                if scene.camera.lens_camera is not None:
                    scene.load_lens()
            except BaseException:
                self.files = self.files | own | named
                raise
        self.files = own | named
        self._loaded = scene
        return scene

    def text(self, shown: Scene) -> str:
        """Return the scene that is shown as YAML: the author's own text with what was changed, where that is known."""
        beside = f"; lies beside {self.name}, whose files it names" if len(self.files) > 1 else ""
        if self.path is not None and (kept := _rewritten(self.path, _data(shown))) is not None:
            return kept
        return scene_text(_data(shown), (f"{self.name} as the viewfinder showed it{beside}",))

    def command(self, shown: Scene, spp: int, mix: Mapping[str, float]) -> str:
        """Return the command that renders what is shown; where lamps are mixed, with the one that mixes them.

        Parameters
        ----------
        spp
            Samples per pixel that it is to have.
        mix
            Factors on the light of groups of lamps.
        """
        assert self._loaded is not None, "a scene is loaded before it is shown"
        changes = _differences("", _data(self._loaded), _data(shown))
        of_frames = {key for key in changes if key.split(".")[0] == "sequence"} - {"sequence.continuous_focus"}
        changes = {key: value for key, value in changes.items() if key not in of_frames}
        own = [f"{key}={json.dumps(value, ensure_ascii=False)}" for key, value in changes.items()]
        sets = [word for text in (*self._overrides, *own) for word in ("--set", text)]
        name = self.name if self.path is None else str(self.path)
        film, output = f"{Path(self.name).stem}.exr", f"{Path(self.name).stem}.png"
        render = ["rptcam", "render", name, *sets, "--spp", str(max(spp, 1)), "-o", film if mix else output]
        factors = [word for group, gain in mix.items() for word in ("--set", f"{LIGHT_LAYER}{group}={gain:g}")]
        develop = ["rptcam", "develop", film, "-o", output, *factors]
        return " && ".join(map(shlex.join, [render, develop] if mix else [render]))


def _data(scene: Scene) -> dict[str, Any]:
    """The data of a scene as in a scene file; parts of a scene made in Python are written out."""
    given = {name: value for name, value in scene.made_of.items() if value is not None}
    if all(map(_is_plain, given.values())):
        return dict(plain(given))
    dumped = scene.model_dump(mode="json", exclude_unset=True)
    return {name: plain(value) if _is_plain(value) else dumped.get(name) for name, value in given.items()}


def _rewritten(path: Path, data: dict[str, Any]) -> str | None:
    """Return the text of a scene file with other data, its comments and order kept.

    None without the package that does it, for files of other formats, and where the text would not read back so.
    """
    if path.suffix.lower() not in (".yaml", ".yml"):
        return None
    try:
        from ruamel.yaml import YAML
    except ImportError:
        return None
    written, text = YAML(), io.StringIO()
    written.preserve_quotes, written.width = True, 160
    written.indent(mapping=2, sequence=4, offset=2)
    try:
        tree = written.load(path.read_text("utf-8"))
        _put(tree, data)
        written.dump(tree, text)
        read_back = read_yaml(text.getvalue()).data
    except Exception:  # whatever another reader of YAML takes amiss
        return None
    return text.getvalue() if read_back == data else None


def _put(node: Any, data: Any) -> None:
    """Make the values of a tree those of data, and leave what is the same as it stands."""
    if isinstance(data, Mapping):
        for key in [key for key in node if key not in data]:
            del node[key]
        places: Iterable[tuple[Any, Any]] = data.items()
    else:
        del node[len(data) :]
        places = enumerate(data)
    for key, value in places:
        is_there = key in node if isinstance(data, Mapping) else key < len(node)
        before = node[key] if is_there else None
        if isinstance(value, Mapping | list) and type(value) in map(type, (plain(before),)):
            _put(before, value)
        elif not is_there and not isinstance(data, Mapping):
            node.append(value)
        elif not is_there or before != value or type(before) is not type(value):
            node[key] = value


def values_before(scene: Scene, changes: Iterable[str]) -> dict[str, Any]:
    """Return the values that keys of its sections, as ``camera.focus``, have in a scene; None where it has none."""
    paths = {key: key.split(".") for key in changes}
    data = _data(scene)
    return {key: (data.get(section) or {}).get(name) for key, (section, name) in paths.items()}


def _is_plain(value: Any) -> bool:
    if isinstance(value, Mapping):
        return all(map(_is_plain, value.values()))
    if isinstance(value, list | tuple):
        return all(map(_is_plain, value))
    return not isinstance(value, BaseModel)


def _differences(path: str, before: Any, after: Any) -> dict[str, Any]:
    """Return the values of keys that make one part of a scene's data the other; None removes a key."""
    if before == after:
        return {}
    if not (isinstance(before, dict) and isinstance(after, dict)) or any("." in key for key in {*before, *after}):
        return {path: after}  # names with dots, as keys of `sequence`, are no part of a key path
    inside = f"{path}." if path else ""
    changes: dict[str, Any] = {f"{inside}{key}": None for key in before if key not in after}
    for key, value in after.items():
        if key not in before:
            changes[f"{inside}{key}"] = value
        else:
            changes |= _differences(f"{inside}{key}", before[key], value)
    return changes


def _changes_between(before: Scene, after: Scene) -> dict[str, Any]:
    """Return the values of keys that make one scene the other; None removes a key."""
    return _differences("", _data(before), _data(after))


def scene_error(text: str) -> dict[str, Any]:
    """Return the message of an error in the scene file."""
    return {"type": "error", "id": None, "message": text, "where": place_of(text), "source": "scene"}


def place_of(text: str) -> str | None:
    """Return the file, line and column, or else the key path, that an error begins with."""
    match = _PLACE.match(text)
    return None if match is None else match["where"] or match["key"]


# Watches files by looking at them several times a second.

INTERVAL_S = 0.2  # an edit is seen after two looks: when it is there, and when it has come to rest


class Watch:
    """Calls back when files have changed and then stayed the same for one look.

    Parameters
    ----------
    files : callable
        Returns the files to watch; asked at each look. A missing file counts as one that may come.
    on_change : callable
        Called from a thread of the watch's own.
    """

    def __init__(
        self, files: Callable[[], Iterable[Path]], on_change: Callable[[], object], interval_s: float = INTERVAL_S
    ) -> None:
        self._files, self._on_change, self._interval_s = files, on_change, interval_s
        self._known: dict[Path, FileState] = {}
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="rptcam-watch", daemon=True)

    def start(self) -> None:
        """Begin; what the files are now is what they are compared with."""
        self._known = self._states()
        self._thread.start()

    def stop(self) -> None:
        """End; no call comes after this unless one is under way."""
        self._end.set()

    def _states(self) -> dict[Path, FileState]:
        return {path: file_state(path) for path in self._files()}

    def _run(self) -> None:
        changed = False
        while not self._end.wait(self._interval_s):
            states = self._states()
            moving = any(path in self._known and self._known[path] != state for path, state in states.items())
            self._known = states
            if moving:
                changed = True
            elif changed:
                changed = False
                self._on_change()


_NO_COMPARISON: dict[str, Any] = {"mode": "off", "model": None, "changes": {}, "difference": False}


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
    background
        Whose tasks end when the device is let go of.
    """

    def __init__(
        self,
        origin: Origin,
        device: str | None,
        size: tuple[int, int] | None,
        clients: Callable[[], Iterable[messages.Client]],
        background: Background,
    ) -> None:
        self.origin, self._background = origin, background
        self._device, self._size, self._clients = device, size, clients
        self._scene: Scene | None = None
        self._kept: tuple[Mapping[str, Any], Dials | None] = ({}, None)
        self._by_hand: dict[str, Any] = {}  # what the scene's camera did not find by itself
        self.a: Slot | None = None
        self.b: Slot | None = None
        self.panel: lens_panel.LensPanel | None = None
        self.compare: dict[str, Any] = dict(_NO_COMPARISON)
        self.recorder = Recorder()
        self._selected: str | None = None
        self.paused = False
        self._denoises = True
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
    def selected(self) -> str | None:
        """A thing of the scene by its key path; None where it is there no more."""
        name = self._selected
        return name if name is not None and self.a is not None and things.is_there(self.a.scene, name) else None

    @selected.setter
    def selected(self, name: str | None) -> None:
        self._selected = name

    @property
    def compares_difference(self) -> bool:
        """Whether the difference of both pictures is wanted."""
        return self.b is not None and bool(self.compare["difference"])

    @property
    def denoises(self) -> bool:
        """Whether pictures are shown without their noise until they are clean."""
        return self._denoises

    @denoises.setter
    def denoises(self, wanted: bool) -> None:
        self._denoises = wanted
        for slot in self.slots:
            slot.denoises = wanted
            slot.show_again()

    def slot(self, name: str) -> Slot:
        """Return a slot by its name.

        Raises
        ------
        InputError
            It is not open.
        """
        chosen = self.a if name == "A" else self.b
        if chosen is None:
            raise InputError(f"slot: {name} is not open (allowed: A{', and B while two are compared' * (name == 'B')})")
        return chosen

    def load(self) -> Scene:
        """Return the scene of the file.

        Raises
        ------
        InputError, StateError
            It cannot be used.
        """
        self._scene = self._with_size(self.origin.load())
        return self._scene

    def open(self) -> None:
        """Take the device, unless it is held: the scene is as it was when it was left."""
        if self.a is not None:
            return
        assert self._scene is not None, "loaded before the engine starts"
        session, by_hand, problem = open_session(self._scene, self._device)
        kept, dials = self._kept
        turned = self._without_by_hand(kept)
        self._by_hand = by_hand
        changes = with_changes(self._by_hand, turned)
        if turned:
            try:
                session.change(changes)
            except InputError:  # the camera was turned to where its meter finds no light
                changes = with_changes(changes, _WITHOUT_METER)
                session.change(changes)
                dials = read_dials(session.scene, dials)
        self.a = Slot("A", session, changes, dials)
        self.a.denoises = self._denoises
        if problem is not None:
            self.file_error = scene_error(str(problem))
        for client in self._clients():
            client.forget_pictures()
        self.panel = lens_panel.LensPanel(session.device.beside())  # the worker "lens" alone calls it
        self.set_compare(self.compare)

    def _with_size(self, scene: Scene) -> Scene:
        return scene if self._size is None else change_scene(scene, film={"resolution": self._size})

    def close(self) -> None:
        """Free the device; what was changed is kept."""
        if self.a is not None:
            self._kept = (self.a.changes, self.a.dials)
        self._let_go()

    def _let_go(self) -> None:
        self._background.end()
        slots, self.a, self.b, self.panel, self.paused = self.slots, None, None, None, False
        for slot in slots:
            slot.close()

    def fail(self, problem: Exception) -> None:
        """Say to all that the device or a frame failed, and free it; of a meter in the dark, go on without it.

        The next client or request takes it anew, with the changes that were shown last: others may be why it failed.
        """
        in_the_dark = isinstance(problem, InputError) and self._leave_meter()
        source = "change" if in_the_dark else "device"
        self.tell({"type": "error", "id": None, "message": text_of(problem), "where": None, "source": source})
        if in_the_dark:
            return
        if self.a is not None:
            self._kept = self.a.shown_changes
        self.compare = dict(_NO_COMPARISON)
        with contextlib.suppress(Exception):  # what is broken may not close either
            self._let_go()

    def _leave_meter(self) -> bool:
        """Expose by the scene's own values where the meter was asked, as it finds no light; tell whether it was."""
        metered = [slot for slot in self.slots if slot.scene.exposure.mode == "auto"]
        try:
            for slot in metered:
                slot.change(_WITHOUT_METER)
        except Exception as problem:  # the first problem is the one to report
            LOG.warning("the meter cannot be left: %s", problem)
            return False
        return bool(metered)

    def tell(self, message: Mapping[str, Any]) -> None:
        """Say something to all clients."""
        for client in self._clients():
            client.outbox.answer(message)

    def change(
        self,
        name: str,
        keys: Mapping[str, Any],
        *,
        dials: Dials | None = None,
        transient: bool = False,
        by_hand: bool = True,
    ) -> Change:
        """Change a slot, as `Slot.change` does; what A gets, B gets too, where it has nothing else for it.

        Raises
        ------
        InputError
            Nothing is changed then.
        """
        slot = self.slot(name)
        change = slot.change(keys, transient=transient, dials=dials, by_hand=by_hand)
        self._tell_compiling(slot, not slot.compiling)
        if name == "A" and self.b is not None:
            own = {key: value for key, value in keys.items() if not _touches(key, self.b_keys)}
            try:
                self.b.change(own, transient=transient, by_hand=by_hand)
                self._tell_compiling(self.b, not self.b.compiling)
            except InputError as problem:
                self.b.messages = (f"B keeps its own: {problem}",)
        self.generation = slot.next_generation
        return change

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
        text = "until then the old picture gets finer" if slot.compiling else "until then the picture stays as it is"
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
            keys = {**instruments.as_model(self.a.scene, self.a.resolved, wanted["model"]), **keys}
        session = RenderSession(self.a.scene, device=self._device, wait=False)
        try:
            change = session.change(keys, wait=False)
        except BaseException:
            session.close()
            self.compare = dict(_NO_COMPARISON)
            raise
        self.b = Slot("B", session, with_changes(self.a.changes, keys))
        self.b.dials = replace(self.b.dials, mix=wanted.get("mix", {}))
        self.b.denoises = self._denoises
        self.b.note_change(False, change)
        for client in self._clients():
            client.forget_picture("B")
            client.forget_picture("difference")

    def _without_by_hand(self, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Leave out the changes that stand where the scene's camera found nothing."""
        return {key: value for key, value in changes.items() if (key, value) not in self._by_hand.items()}

    def replace(self, scene: Scene) -> list[str]:
        """Show another state of the scene file, with the changes that still fit; return what did not fit."""
        scene = self._with_size(scene)
        if self.a is None:
            self._scene = scene
            return []
        slot = self.a
        framed = timeline.overlaid(slot.scene)  # which begin anew with the first frame
        turned = {key: value for key, value in self._without_by_hand(slot.changes).items() if key not in framed}
        by_hand = self._by_hand
        try:
            change, self._by_hand = slot.session.replace(scene, wait=False), {}
        except InputError:
            if not by_hand:
                raise
            change = slot.session.replace(set_keys(scene, by_hand), wait=False)
        slot.note_change(False, change)
        self._scene = scene
        wanted, slot.changes = {**self._by_hand, **turned}, {}
        dropped = _apply(slot, wanted)
        dark = {path: value for path, value in slot.dials.dark.items() if path in slot.changes}
        kept: dict[str, Any] = {} if dark else {"mute": frozenset(), "solo": frozenset()}
        slot.dials = replace(read_dials(slot.scene, slot.dials), clock=Clock.of(slot.scene), dark=dark, **kept)
        self._tell_compiling(slot, not slot.compiling)
        try:
            self.set_compare(self.compare)
        except InputError as problem:
            dropped.append(f"the comparison: {problem}")
        return dropped

    @property
    def focuses_each_frame(self) -> bool:
        """Whether the camera of A finds the focus of each frame: the file has it so, and no hand has set it."""
        file, slot = self._scene, self.a
        if file is None or slot is None or file.requested_autofocus is None:
            return False
        goes_on = file.sequence is not None and file.sequence.continuous_focus is not None
        by_hand = any(key == "camera" or key.startswith("camera.focus") for key in slot.changes)
        return (goes_on or slot.dials.clock.frame > 0) and not by_hand

    def as_file(self, slot: Slot) -> Scene:
        """Return a scene as it is saved: as it stands in its first frame, its focus as the file has it found."""
        scene = timeline.as_file(slot.scene, self.slot("A").dials.clock)
        if not self.focuses_each_frame:
            return scene
        assert self._scene is not None and self._scene.made_of
        names = [name for each in (scene, self._scene) for name in each.made_of["camera"] if name.startswith("focus")]
        keys = [f"camera.{name}" for name in names]
        if self._scene.sequence is not None:
            keys.append("sequence.continuous_focus")
        return set_keys(scene, values_before(self._scene, keys))

    def reset(self, prefix: str) -> None:
        """Go back to the scene file, as a whole or in the keys that begin so."""
        assert self._scene is not None and self.a is not None
        self.a.changes = {key: value for key, value in self.a.changes.items() if not key.startswith(prefix)}
        self.replace(self._scene)


def text_of(problem: Exception) -> str:
    """The text of an error for a client."""
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


# The states that were, to go back to: undo, redo, snapshots.

_MOST_STATES = 60
_MOST_SNAPSHOTS = 12
_THUMB = (128, 72)  # pixels, at most


@dataclass(eq=False)
class Past:
    """A state that was.

    Attributes
    ----------
    number : int
    label : str
        What led to it.
    scene, changes, dials, compare
        As of the slot A and the studio then.
    thumb : str or None
        Its picture, a JPEG in base64.
    thumb_scale : float
        Share of the full resolution that was made of.
    """

    number: int
    label: str
    scene: Scene
    changes: Mapping[str, Any]
    dials: Dials
    compare: Mapping[str, Any]
    thumb: str | None = None
    thumb_scale: float = 0.0

    def is_now(self, studio: Studio, slot: Slot) -> bool:
        """Whether it is what is shown."""
        return (self.changes, self.dials, self.compare) == (slot.changes, slot.dials, studio.compare)


class History:
    """The states of the slot A, in order, and the snapshots among them. Only the engine's thread uses it.

    Parameters
    ----------
    studio
        Whose states they are.
    """

    def __init__(self, studio: Studio) -> None:
        self._studio = studio
        self._states: list[Past] = []
        self._at = -1
        self.snapshots: list[Past] = []
        self._number = 0
        self.version = 0  # counts what clients have to hear

    def clear(self) -> None:
        """Forget the states: the file is another. Snapshots stay."""
        self._states, self._at = [], -1

    def note(self, *, acted: bool) -> bool:
        """Note the state that is shown, where it is another; return whether a hand has led to it.

        Parameters
        ----------
        acted
            Whether somebody did something since the last time; otherwise the camera has followed the light by itself.
        """
        slot, studio = self._studio.a, self._studio
        if slot is None or slot.rests_in() > 0:
            return False
        here = self._states[self._at] if self._states else None
        if here is not None and here.is_now(studio, slot):
            self._picture(here, slot)
            return False
        label = "as in the file" if here is None else _label(here, slot, studio)
        self.version += 1
        if here is not None and not acted:
            here.changes, here.dials, here.scene, here.compare = slot.changes, slot.dials, slot.scene, studio.compare
            return False
        self._number += 1
        past = Past(self._number, label, slot.scene, slot.changes, slot.dials, studio.compare)
        self._states = [*self._states[: self._at + 1], past][-_MOST_STATES:]
        self._at = len(self._states) - 1
        return True

    def _picture(self, here: Past, slot: Slot) -> None:
        shown = slot.shown
        if shown is None or shown.stale or shown.frame.scale <= here.thumb_scale:
            return
        if shown.frame.generation == slot.session.generation:
            here.thumb = base64.b64encode(
                messages.encode(messages.shrink(shown.codes[..., :3], *_THUMB), "jpeg", 70)
            ).decode()
            here.thumb_scale = shown.frame.scale
            self.version += 1

    def step(self, by: int) -> None:
        """Go back or forward so many states.

        Raises
        ------
        InputError
            There are none.
        """
        if not 0 <= self._at + by < len(self._states):
            raise InputError(f"history: there is nothing to {'undo' if by < 0 else 'do again'}")
        self._go(self._states[self._at + by])
        self._at += by

    def go(self, number: int) -> None:
        """Go to a state or a snapshot; a snapshot becomes the newest state.

        Raises
        ------
        InputError
            There is none of the number, or it cannot be shown any more.
        """
        past = self._find(number)
        self._go(past)
        if past in self._states:
            self._at = self._states.index(past)
        self.version += 1

    def snap(self) -> None:
        """Keep the state that is shown."""
        here = self._states[self._at] if self._states else None
        if here is not None and here not in self.snapshots:
            self.snapshots = [*self.snapshots, here][-_MOST_SNAPSHOTS:]
            self.version += 1

    def drop(self, number: int) -> None:
        """Keep a snapshot no longer."""
        self.snapshots = [each for each in self.snapshots if each.number != number]
        self.version += 1

    def compare(self, number: int) -> None:
        """Show a state as B, under a wipe.

        Raises
        ------
        InputError
            There is none of the number, or it cannot be shown any more.
        """
        slot = self._studio.slot("A")
        past = self._find(number)
        keys, mix = _changes_between(slot.scene, past.scene), past.dials.mix
        self._studio.set_compare({"mode": "wipe", "model": None, "changes": keys, "difference": False, "mix": mix})

    def _find(self, number: int) -> Past:
        for each in (*self._states, *self.snapshots):
            if each.number == number:
                return each
        raise InputError(f"history: there is no state {number}")

    def _go(self, past: Past) -> None:
        studio = self._studio
        slot = studio.slot("A")
        keys = _changes_between(slot.scene, past.scene)
        if keys:
            studio.change("A", keys, dials=past.dials)
        else:
            slot.show_again()  # its lamps may be mixed in another way
        slot.changes, slot.dials = past.changes, past.dials
        if studio.compare != past.compare:
            studio.set_compare(past.compare)
        slot.follows_light = False
        self.version += 1

    def message(self) -> dict[str, Any]:
        """What clients hear of it."""
        return {
            "type": "history",
            "states": [{"number": each.number, "label": each.label} for each in self._states],
            "at": self._states[self._at].number if self._states else None,
            "snapshots": [{"number": each.number, "label": each.label} for each in self.snapshots],
        }

    def thumbs(self) -> dict[int, str]:
        """The pictures of states and snapshots, by number."""
        return {each.number: each.thumb for each in (*self._states, *self.snapshots) if each.thumb is not None}


def _label(before: Past, slot: Slot, studio: Studio) -> str:
    """What leads from a state to the one that is shown, in words."""
    keys = [key for key in {**before.changes, **slot.changes} if before.changes.get(key) != slot.changes.get(key)]
    names = list(dict.fromkeys(key.split(".")[-1].replace("_", " ") for key in keys))
    if {"eye", "target", "up"} & set(names):
        names = ["camera", *(name for name in names if name not in ("eye", "target", "up"))]
    if len(names) > 1:  # keys beside what they are of, and the frame
        names = [name for name in names if name not in ("sequence", "open s", "motion")] or ["keys"]
    names = ["keys" if name in ("sequence", "motion") else "frame" if name == "open s" else name for name in names]
    if studio.compare != before.compare:
        names.append("comparison")
    if before.dials.mix != slot.dials.mix:
        names.append("mix of the lamps")
    if not names:
        names = ["exposure mode"]
    return ", ".join(names[:3])
