"""The scene before the viewfinder: its slots A and B, opened and closed with the device, and what is said to all."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import re
import shlex
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from rptcam_cl.api.session import Change, Frame, RenderSession
from rptcam_cl.core.colour import luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, RptcamError
from rptcam_cl.core.files import FileState, file_state, named_files, plain
from rptcam_cl.imaging.formats import RawImage
from rptcam_cl.imaging.image import Image, with_picture_settings
from rptcam_cl.scene.film import PictureSettings
from rptcam_cl.scene.load import change_scene, load_scene, scene_text, set_keys
from rptcam_cl.scene.scene import Scene
from rptcam_cl.viewfinder import timeline
from rptcam_cl.viewfinder.background import Background
from rptcam_cl.viewfinder.dials import follow_light
from rptcam_cl.viewfinder.instruments import as_model, film_reading
from rptcam_cl.viewfinder.lens_panel import LensPanel
from rptcam_cl.viewfinder.messages import Client, Codes, codes_of
from rptcam_cl.viewfinder.panel import Clock, Dials, Panel, read_dials
from rptcam_cl.viewfinder.things import is_there
from rptcam_cl.viewfinder.timeline import Recorder

# How much to render at once: the scale of a glance and the samples of a take, from the speed measured.

SCALES = (1.0, 0.5, 0.25, 0.125)
GLANCE_S = 0.07  # a glance may take: with the way to the page, more than ten of them a second
TAKE_S = 0.15  # samples of a resting picture may take at first; what the user does next ends them at once
LONGEST_S = 3.0  # of a take
SHOWN_SHARE = 0.08  # of the time of a take, that showing it may take
GROWTH = 4  # a take has this part of the samples that are there, as fewer are hardly seen
_HEADROOM = 0.6  # of the time that a larger scale may be foreseen to take before it is tried
_NEWS = 0.5  # weight of the last measurement
_MOST_SAMPLES = 4096  # of one take


class Pace:
    """Chooses the scale of glances and the samples of takes so that each keeps its time.

    A glance takes a fixed time and one in proportion to its pixels; both are unknown, so that the smaller scales are
    foreseen by the share of their pixels alone, which is never too little for a larger and never too much for a smaller
    scale.
    """

    def __init__(self, glance_s: float = GLANCE_S, take_s: float = TAKE_S) -> None:
        self._glance_s, self._take_s = glance_s, take_s
        self._index = 1
        self._measured = False
        self._sample_s: float | None = None
        self._show_s = 0.0

    @property
    def scale(self) -> float:
        """Scale of the next glance."""
        return SCALES[self._index]

    def samples(self, done: int, of_wave: int = 1) -> int:
        """Return the samples per pixel of the next take of a film that has some.

        Where they come near to those of a wave, the take ends with one, as parts of waves cost more a sample.
        """
        if self._sample_s is None:
            return 1
        each = max(self._sample_s, 1e-6)
        worth = max(self._take_s, self._show_s / SHOWN_SHARE) / each
        most = int(max(LONGEST_S, self._take_s) / each)
        count = max(1, min(_MOST_SAMPLES, int(max(worth, done / GROWTH)), most))
        if 2 * count < of_wave:
            return count
        end = done + count
        ends = (-(-end // of_wave) * of_wave, end // of_wave * of_wave)
        return next((whole - done for whole in ends if 0 < whole - done <= most), count)

    def note_show(self, seconds: float) -> None:
        """Note what it took to show a picture at full scale."""
        self._show_s = _NEWS * seconds + (1 - _NEWS) * self._show_s if self._show_s else seconds

    def note_glance(self, scale: float, seconds: float) -> None:
        """Note what a glance took; the scale goes down at once where it was too slow, and up where there is room."""
        if scale != self.scale:
            return
        if seconds > self._glance_s and self._index < len(SCALES) - 1:
            steps = 1 if seconds <= 4 * self._glance_s else 2
            self._index = min(self._index + steps, len(SCALES) - 1)
        elif self._index > 0 and seconds * 4 < _HEADROOM * self._glance_s:
            self._index -= 1

    def note_take(self, samples: int, seconds: float) -> None:
        """Note what a take took."""
        if samples > 0:
            each = seconds / samples
            self._sample_s = each if self._sample_s is None else _NEWS * each + (1 - _NEWS) * self._sample_s


# The first picture of a scene, by hand where its camera finds no focus or no light by itself.

WITHOUT_METER = {"exposure": "relative"}


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
        exposure = dict(WITHOUT_METER)
    return [keys for keys in (focus, exposure, {**focus, **exposure} if focus and exposure else {}) if keys]


# Where a scene comes from, and what the page has changed of it: as a scene, as YAML, as a command line.

_PLACE = re.compile(r"^(?P<where>\S[^:\n]*:\d+:\d+): |^(?P<key>[A-Za-z_][\w.\[\]]*): ")


def with_changes(changes: Mapping[str, Any], keys: Mapping[str, Any]) -> dict[str, Any]:
    """Add changed keys, in the order of their last change; those below a changed key are forgotten with it."""
    merged = dict(changes)
    for key, value in keys.items():
        for old in [old for old in merged if old == key or old.startswith((f"{key}.", f"{key}["))]:
            del merged[old]
        merged[key] = value
    return merged


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
        """Return the scene that is shown as YAML."""
        beside = f"; lies beside {self.name}, whose files it names" if len(self.files) > 1 else ""
        return scene_text(_data(shown), (f"{self.name} as the viewfinder showed it{beside}",))

    def command(self, shown: Scene, spp: int) -> str:
        """Return the command that renders what is shown.

        Parameters
        ----------
        spp
            Samples per pixel that it is to have.
        """
        assert self._loaded is not None, "a scene is loaded before it is shown"
        changes = _differences("", _data(self._loaded), _data(shown))
        changes = {key: value for key, value in changes.items() if key.split(".")[0] != "sequence"}  # of frames alone
        own = [f"{key}={json.dumps(value, ensure_ascii=False)}" for key, value in changes.items()]
        sets = [word for text in (*self._overrides, *own) for word in ("--set", text)]
        name = self.name if self.path is None else str(self.path)
        output = f"{Path(self.name).stem}.png"
        return shlex.join(["rptcam", "render", name, *sets, "--spp", str(max(spp, 1)), "-o", output])


def _data(scene: Scene) -> dict[str, Any]:
    """The data of a scene as in a scene file; parts of a scene made in Python are written out."""
    given = {name: value for name, value in scene.made_of.items() if value is not None}
    if all(map(_is_plain, given.values())):
        return dict(plain(given))
    dumped = scene.model_dump(mode="json", exclude_unset=True)
    return {name: plain(value) if _is_plain(value) else dumped.get(name) for name, value in given.items()}


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


def changes_between(before: Scene, after: Scene) -> dict[str, Any]:
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


# One picture of the viewfinder: a render session, the dials of its camera, and how far it is.

REST_S = 0.25  # after the last movement of what is held, before the picture is refined
PAUSE = 2.0  # times what a take took, that the old picture leaves to the compilation of what comes after it
POLL_S = 0.05  # between two looks whether the kernels of the film are there
_SAME_FILM = ("none", "picture")  # kinds of change after which the film is as it was
_FILMS = itertools.count(1)
_GROWN = 1.25  # by how much the samples of a film grow before it is finished once more
_BODY = ("exposure", "shutter", "sensor", "camera")  # parts of the scene that the dials read
# Relative standard error of a pixel that is not seen any more: contrast of fine detail that a person just sees, about
# 0.02 at 20 cycles per degree (Campbell and Robson, J. Physiol. 197, 1968).
CLEAN = 0.02
DARKEST = 0.01  # of white, below which a screen shows hardly any differences
DENOISED_S = 5.0  # of a film whose picture has what comes last: that is added to the noisy one


@dataclass(frozen=True)
class Shown:
    """A frame that was rendered, developed."""

    number: int
    frame: Frame
    codes: Codes
    moving: bool
    stale: bool
    answers: Mapping[int, int | None]  # by client: its last change that the frame shows
    raw: RawImage | None = None  # what the sensor puts out for it, where there is one
    lacks: tuple[str, ...] = ()  # what a saved picture has beyond it
    clean: NDArray[np.float32] | None = None  # what was made of the frame's pixels to take their noise away

    @property
    def pixels(self) -> NDArray[np.float32]:
        """Linear film as it is seen, (height, width, 3)."""
        return self.frame.pixels if self.clean is None else self.clean


@dataclass(frozen=True)
class Finished:
    """A film with what takes long: ghosts, diffraction, sensor. It is developed as a saved picture is."""

    film: int  # as `Slot.film`
    frame: Frame
    image: Image
    codes: Codes
    raw: RawImage | None
    picture: PictureSettings  # that it is developed by


def visible_noise(pixels: NDArray[np.float32], clean: NDArray[np.float32]) -> float:
    """Return the relative noise of most pixels of a film (height, width, 3) on a screen, where white has none.

    Parameters
    ----------
    clean
        The film without its noise.
    """
    seen, true = (np.minimum(luminance(each[::2, ::2], np.float32), 1.0) for each in (pixels, clean))
    return float(1.4826 * np.median(np.abs(seen - true) / (true + DARKEST)))  # of a normal distribution


class Slot:
    """A picture, ``A`` or ``B``. Only the engine's thread uses it.

    Parameters
    ----------
    name
        ``A`` or ``B``.
    session
        What renders; the slot closes it.
    changes
        Those that lead from the scene file to the scene of the session.
    dials
        The state of the camera's body; read from the scene by default.
    """

    def __init__(
        self, name: str, session: RenderSession, changes: Mapping[str, Any], dials: Dials | None = None
    ) -> None:
        self.name = name
        self.session = session
        self.changes = changes
        self.dials = read_dials(session.scene) if dials is None else dials
        self.pace = Pace()
        self.shown: Shown | None = None
        self.reading_cd_m2: float | None = None
        self.messages: tuple[str, ...] = ()
        self.follows_light = True  # dials that go by the light may change once for each change of the user's
        self.wants_glance, self.wants_showing = True, False
        self.compiling = False  # the last change waits for its kernels, and the picture is the one before
        self.awaits_kernels = False  # of the film, while glances have theirs
        self._moving_until = self._paused_until = 0.0
        self.shown_changes = (changes, self.dials)  # those of the last picture
        self._number = self._metered = 0
        self._answers: Mapping[int, int | None] = {}
        self._next_samples = 1
        self._last: Frame | None = None  # of what is there now
        self._stays_for = 0  # samples of a film that is begun anew, until which the picture before is shown
        self.film = next(_FILMS)  # a number of the film's own
        self.finished: Finished | None = None  # the last picture of this film that lacks nothing
        self._reaches_noise = False  # the requested noise
        self._unread = False  # whether the film has samples that no picture was made of
        self.denoises = True
        self._clean: tuple[Frame | None, NDArray[np.float32] | None] = None, None  # a frame, and what was made of it
        self._film_begun = time.monotonic()
        self._visible = 0.0, 0  # noise of the film that is seen, and its samples then

    @property
    def scene(self) -> Scene:
        """As requested."""
        return self.session.scene

    @property
    def resolved(self) -> Scene:
        """In focus and exposed."""
        return self.session.resolved

    @property
    def panel(self) -> Panel:
        """The camera in use."""
        return Panel(self.dials, self.scene, self.resolved, self.reading_cd_m2)

    @property
    def target_spp(self) -> int:
        """Samples per pixel at which the picture is done."""
        return self.scene.render.most_spp

    def change(self, keys: Mapping[str, Any], *, transient: bool = False, dials: Dials | None = None) -> Change:
        """Change the scene, at once or not at all.

        Parameters
        ----------
        keys
            Values by key path; None removes.
        transient
            Whether more will come at once, as from a control that is held.
        dials
            The camera's body afterwards; without it the scene says.

        Raises
        ------
        InputError
            A value is wrong; nothing is changed.
        """
        change = self.session.change(dict(keys), wait=False)
        self.changes = with_changes(self.changes, keys)
        if dials is not None:
            self.dials = dials
        elif any(part in _BODY for part in change.keys):
            self.dials = read_dials(self.scene, self.dials)
        self.note_change(transient, change)
        return change

    def note_change(self, transient: bool, change: Change) -> None:
        """Note what a change came to: the picture is another from here on, or the film is developed in another way."""
        self.follows_light = True
        self._moving_until = time.monotonic() + (REST_S if transient else 0.0)
        self.compiling = self.session.is_waiting
        is_shown = change.kind in _SAME_FILM and self.show_again()
        if not is_shown and not self.compiling:
            self._begin_anew()

    def show_again(self) -> bool:
        """Have the picture that is there shown anew; return whether there is one."""
        self.wants_showing = self._last is not None and not self.wants_glance
        return self.wants_showing

    def arrive(self) -> bool:
        """Show the change that has waited for its kernels, if they are there now; return whether they are."""
        if not self.compiling and self.rests_in() <= 0 and not self.wants_glance and self.session.relieve():
            shown = self._last
            self._begin_anew()
            if shown is not None and shown.scale == 1:  # which stays until there is one as good
                self.wants_glance, self._last, self._stays_for = False, shown, min(shown.spp, self.target_spp)
            return True
        if not (self.compiling and self.session.ready):
            return False
        self.compiling, self.follows_light = False, True
        self._begin_anew()
        return True

    def _begin_anew(self) -> None:
        self.wants_glance, self._last, self._stays_for = True, None, 0
        self.film, self.finished = next(_FILMS), None
        self._reaches_noise = self._unread = False
        self._next_samples = 1
        self._film_begun, self._visible = time.monotonic(), (0.0, 0)

    @property
    def next_generation(self) -> int:
        """The generation whose frames show the last change."""
        return self.session.generation + self.compiling

    def rests_in(self) -> float:
        """Return the time until the picture is refined [s]; 0 where nothing moves."""
        return max(0.0, self._moving_until - time.monotonic())

    def refines_in(self) -> float:
        """Return the time until more samples are taken [s]; longer while another program compiles."""
        pause = self._paused_until - time.monotonic() if self.compiling or self.awaits_kernels else 0.0
        return max(pause, self.rests_in())

    @property
    def is_done(self) -> bool:
        """Whether there is nothing left to render."""
        return not self.wants_glance and not self._unread and self._has_all

    @property
    def _has_all(self) -> bool:
        return self._reaches_noise or self.session.spp >= self.target_spp

    def glance(self) -> Frame:
        """Return a first picture of what is there now, at the scale that keeps pace."""
        scale = self.pace.scale
        self.wants_glance = self.wants_showing = False
        begun = time.perf_counter()
        self._last = self.session.glance(scale)
        self._denoised(self._last)
        self.pace.note_glance(scale, time.perf_counter() - begun)
        return self._last

    def _denoised(self, frame: Frame) -> NDArray[np.float32] | None:
        """Return a frame without its noise; None where it is shown as it is: clean, or while kernels compile."""
        if self.denoises and not self._is_clean(frame):
            if self._clean[0] is not frame or self._clean[1] is None:
                self._clean = frame, self.session.denoised(frame)
                if frame.scale == 1 and self._clean[1] is not None and frame.spp >= 2 * self._visible[1]:
                    self._visible = visible_noise(frame.pixels, self._clean[1]), frame.spp
            return self._clean[1]
        self._clean = None, None
        return None

    def _is_clean(self, frame: Frame) -> bool:
        """Whether a frame needs no denoising: it is done, its noise is not seen, or what comes last is to be seen."""
        if frame.scale < 1 or frame.spp == 0:
            return False
        late = bool(self.comes_last) and time.monotonic() > self._film_begun + DENOISED_S
        noise = self.visible_noise(frame)
        return late or frame.spp >= self.target_spp or (noise is not None and noise <= CLEAN)

    def visible_noise(self, frame: Frame) -> float | None:
        """Return the noise of a frame of the film that is seen, by `visible_noise` at fewer samples."""
        noise, spp = self._visible
        return noise * math.sqrt(spp / frame.spp) if spp and frame.spp >= spp and frame.scale == 1 else None

    def clean_at(self, frame: Frame) -> dict[str, float] | None:
        """How many samples it takes until the noise is not seen, and how long from the film's beginning [s]."""
        noise = self.visible_noise(frame)
        if noise is None:
            return None
        share = max((noise / CLEAN) ** 2, 1.0)
        seconds = share * (time.monotonic() - self._film_begun)
        return {"noise": noise, "spp": share * frame.spp, "seconds": seconds}

    def again(self) -> Frame:
        """Return the picture that is there, to be developed anew."""
        assert self._last is not None, "there is one where a change leaves the film"
        self.wants_showing = False
        return self._last if self.finished is None else self.finished.frame

    def refine(self, is_wanted: Callable[[], bool]) -> Frame | None:
        """Return the picture with more samples; None where it has none yet, was left within one, or is finished.

        Parameters
        ----------
        is_wanted
            Whether it is still wanted: otherwise the samples are left where they are, and nothing is made of them.
        """
        if not self._has_all:
            self.awaits_kernels = not self.session.is_film_ready()
            if self.awaits_kernels:
                self._paused_until = time.monotonic() + POLL_S
                return None
            self._add(is_wanted)
        self._unread = not is_wanted()
        if self.session.spp == 0 or self._unread:
            return None
        frame = self.session.frame()
        if frame.spp == 0:  # kernels that were waited for have come within this call: the film is another
            return None
        if frame.spp < self._stays_for and not self._reaches_noise:
            return None
        self._last = frame
        return None if self.finished is not None else self._last

    def _add(self, is_wanted: Callable[[], bool]) -> None:
        before, begun = self.session.spp, time.monotonic()
        wanted = self.pace.samples(before, self.session.samples_per_wave)
        count = max(1, min(self._next_samples, wanted, self.target_spp - before))
        complete = self.session.add(count, lambda: not is_wanted())
        took = time.monotonic() - begun
        self.pace.note_take(self.session.spp - before, took)
        self._next_samples = 2 * count
        self._paused_until = begun + (1 + PAUSE) * took
        self._reaches_noise = complete and self.session.spp == before

    def show(self, frame: Frame, moving: bool, answers: Mapping[int, int | None]) -> None:
        """Develop a frame; what takes long it lacks, until `show_finished`."""
        stale = self.compiling
        if not stale:
            self._answers = answers
            self.shown_changes = (self.changes, self.dials)
        finished, lacks, clean = self.finished, self.comes_last, None
        if finished is not None and finished.frame is frame and self.scene.sensor is None:
            image, lacks = with_picture_settings(finished.image, self.scene.picture), ()
        else:
            clean = self._denoised(frame)
            image = self._plain_image(frame.pixels if clean is None else clean)
        self._number += 1
        self.shown = Shown(self._number, frame, codes_of(image), moving, stale, self._answers, None, lacks, clean)

    @property
    def comes_last(self) -> tuple[str, ...]:
        """What of the picture takes so long that it is added at rest, off the thread of frames."""
        described = self.session.metadata
        has = {
            "diffraction": described.get("diffraction", {}).get("on", False),
            "ghosts": "ghosts" in described,
            "sensor": self.scene.sensor is not None,
        }
        return tuple(name for name, is_there in has.items() if is_there)

    @property
    def wants_finishing(self) -> bool:
        """Whether the picture at rest lacks what comes last, and is to have it now."""
        last, done = self._last, self.finished
        if not self.comes_last or self.compiling or self.wants_glance or self.wants_showing or self.rests_in() > 0:
            return False
        if last is None or last.scale < 1 or not last.complete or last.spp == 0 or last.spp != self.session.spp:
            return False
        if not self.session.is_whole:  # what is left of a sample may take long
            return False
        if self.shown is not None and self.shown.clean is not None:  # which looks better for now
            return False
        if done is None or done.picture != self.scene.picture:
            return True
        return last.spp >= _GROWN * done.frame.spp or (self.is_done and last.spp > done.frame.spp)

    def picture_later(self) -> Callable[[], Finished]:
        """Read the film; return what finishes its picture, in any thread."""
        film, frame, done, picture = self.film, self._last, self.finished, self.scene.picture
        assert frame is not None, "as `wants_finishing` says"
        later = self.session.image_later() if done is None or done.frame is not frame else lambda: done.image

        def finish() -> Finished:
            image = with_picture_settings(later(), picture)
            return Finished(film, frame, image, codes_of(image), image.raw() if image.has_sensor else None, picture)

        return finish

    def show_finished(self, finished: Finished) -> None:
        """Show a finished picture, unless there is another film by now."""
        if finished.film == self.film and not self.wants_glance:
            self.finished = finished
            self._number += 1
            self.shown = Shown(
                self._number, finished.frame, finished.codes, False, self.compiling, self._answers, finished.raw
            )

    def follow(self) -> None:
        """Meter what is shown, once it is on its way; dials that follow the light follow it."""
        shown = self.shown
        if shown is None or shown.stale or shown.number == self._metered:
            return
        self._metered = shown.number
        self.reading_cd_m2 = film_reading(shown.frame.pixels, self.resolved, self.dials.meter)
        if self.follows_light:
            turned = follow_light(self.panel)
            if turned.changes:
                self.change(turned.changes, dials=turned.dials, transient=shown.moving)
            self.dials, self.follows_light = turned.dials, False

    def _plain_image(self, pixels: NDArray[np.float32]) -> Image:
        metadata = {"spectrum": self.session.metadata.get("spectrum", "rgb")}
        return with_picture_settings(Image(pixels, metadata), self.scene.picture)

    def close(self) -> None:
        """Free the device."""
        self.session.close()


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
    background
        Whose jobs end when the device is let go of.
    """

    def __init__(
        self,
        origin: Origin,
        device: str | None,
        size: tuple[int, int] | None,
        clients: Callable[[], Iterable[Client]],
        background: Background,
    ) -> None:
        self.origin, self._background = origin, background
        self._device, self._size, self._clients = device, size, clients
        self._scene: Scene | None = None
        self._kept: tuple[Mapping[str, Any], Dials | None] = ({}, None)
        self._by_hand: dict[str, Any] = {}  # what the scene's camera did not find by itself
        self.a: Slot | None = None
        self.b: Slot | None = None
        self.panel: LensPanel | None = None
        self.compare: dict[str, Any] = dict(NO_COMPARISON)
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
        return name if name is not None and self.a is not None and is_there(self.a.scene, name) else None

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
                changes = with_changes(changes, WITHOUT_METER)
                session.change(changes)
                dials = read_dials(session.scene, dials)
        self.a = Slot("A", session, changes, dials)
        self.a.denoises = self._denoises
        if problem is not None:
            self.file_error = scene_error(str(problem))
        for client in self._clients():
            client.forget_pictures()
        self.panel = LensPanel(session.device.beside())  # the worker "lens" alone calls it
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
    ) -> Change:
        """Change a slot; what A gets, B gets too, where it has nothing else for it.

        Raises
        ------
        InputError
            Nothing is changed then.
        """
        slot = self.slot(name)
        change = slot.change(keys, transient=transient, dials=dials)
        self._tell_compiling(slot, not slot.compiling)
        if name == "A" and self.b is not None:
            own = {key: value for key, value in keys.items() if not _touches(key, self.b_keys)}
            try:
                self.b.change(own, transient=transient)
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
            keys = {**as_model(self.a.scene, self.a.resolved, wanted["model"]), **keys}
        session = RenderSession(self.a.scene, device=self._device, wait=False)
        try:
            change = session.change(keys, wait=False)
        except BaseException:
            session.close()
            self.compare = dict(NO_COMPARISON)
            raise
        self.b = Slot("B", session, with_changes(self.a.changes, keys))
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
