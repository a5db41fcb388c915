"""One picture of the viewfinder: a render session, the dials of its camera, and how far it is."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from rptcam_cl.api import Change, Frame, RenderSession
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.imaging import Image, RawImage, with_picture_settings
from rptcam_cl.scene import Scene
from rptcam_cl.viewfinder.dials import Dials, follow_light, read_dials
from rptcam_cl.viewfinder.meter import film_reading
from rptcam_cl.viewfinder.origin import Changes
from rptcam_cl.viewfinder.pace import Pace
from rptcam_cl.viewfinder.pictures import Codes, codes_of

REST_S = 0.25  # after the last movement of what is held, before the picture is refined
PAUSE = 2.0  # times what a take took, that the old picture leaves to the compilation of what comes after it
POLL_S = 0.05  # between two looks whether the kernels of the film are there
_SAME_FILM = ("none", "picture")  # kinds of change after which the film is as it was
_BODY = ("exposure", "shutter", "sensor", "camera")  # parts of the scene that the dials read


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

    def __init__(self, name: str, session: RenderSession, changes: Changes, dials: Dials | None = None) -> None:
        self.name = name
        self.session = session
        self.changes = changes
        self.dials = read_dials(session.scene) if dials is None else dials
        self.pace = Pace()
        self.shown: Shown | None = None
        self.reading_cd_m2: float | None = None
        self.messages: tuple[str, ...] = ()
        self._follows = True  # dials that go by the light may change once for each change of the user's
        self.wants_glance, self.wants_showing = True, False
        self.compiling = False  # the last change waits for its kernels, and the picture is the one before
        self.awaits_kernels = False  # of the film, while glances have theirs
        self._moving_until = self._paused_until = 0.0
        self.shown_changes = (Changes(changes.as_dict()), self.dials)  # those of the last picture
        self._number = self._metered = 0
        self._answers: Mapping[int, int | None] = {}
        self._next_samples = 1
        self._last: Frame | None = None  # of what is there now
        self._reaches_noise = False  # the requested noise
        self._unread = False  # whether the film has samples that no picture was made of

    @property
    def scene(self) -> Scene:
        """As requested."""
        return self.session.scene

    @property
    def resolved(self) -> Scene:
        """In focus and exposed."""
        return self.session.resolved

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
        self.changes.add(keys)
        if dials is not None:
            self.dials = dials
        elif any(part in _BODY for part in change.keys):
            self.dials = read_dials(self.scene, self.dials)
        self.touched(transient, change)
        return change

    def touched(self, transient: bool, change: Change) -> None:
        """Note what a change came to: the picture is another from here on, or the film is developed in another way."""
        self._follows = True
        self._moving_until = time.monotonic() + (REST_S if transient else 0.0)
        self.compiling = self.session.is_waiting
        if change.kind in _SAME_FILM and self._last is not None and not self.wants_glance:
            self.wants_showing = True
        elif not self.compiling:
            self._begin_anew()

    def arrive(self) -> bool:
        """Show the change that has waited for its kernels, if they are there now; return whether they are."""
        if not (self.compiling and self.session.ready):
            return False
        self.compiling, self._follows = False, True
        self._begin_anew()
        return True

    def _begin_anew(self) -> None:
        self.wants_glance, self._last = True, None
        self._reaches_noise = self._unread = False
        self._next_samples = 1

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
        self._last = self.session.glance(scale)
        self.pace.glanced(scale, self._last.seconds)
        return self._last

    def again(self) -> Frame:
        """Return the picture that is there, to be developed anew."""
        assert self._last is not None, "there is one where a change leaves the film"
        self.wants_showing = False
        return self._last

    def refine(self, is_wanted: Callable[[], bool]) -> Frame | None:
        """Return the picture with more samples; None where it cannot have any yet, or was left within the first.

        Parameters
        ----------
        is_wanted
            Whether it is still wanted once the samples are there: otherwise nothing is made of them.
        """
        if not self._has_all:
            self.awaits_kernels = not self.session.is_film_ready()
            if self.awaits_kernels:
                self._paused_until = time.monotonic() + POLL_S
                return None
            self._add()
        self._unread = not is_wanted()
        if self.session.spp == 0 or self._unread:
            return None
        self._last = self.session.frame()
        return self._last

    def _add(self) -> None:
        before, begun = self.session.spp, time.monotonic()
        count = max(1, min(self._next_samples, self.pace.samples, self.target_spp - before))
        complete = self.session.add(count)
        took = time.monotonic() - begun
        self.pace.took(self.session.spp - before, took)
        self._next_samples = 2 * count
        self._paused_until = begun + (1 + PAUSE) * took
        self._reaches_noise = complete and self.session.spp == before

    def show(self, frame: Frame, moving: bool, answers: Mapping[int, int | None]) -> None:
        """Develop a frame."""
        self._number += 1
        stale = self.compiling
        if not stale:
            self._answers = answers
            self.shown_changes = (Changes(self.changes.as_dict()), self.dials)
        image = self.image_of(frame)
        raw = image.raw() if image.has_sensor else None
        self.shown = Shown(self._number, frame, codes_of(image), moving, stale, self._answers, raw)

    def follow(self) -> None:
        """Meter what is shown, once it is on its way; dials that follow the light follow it."""
        shown = self.shown
        if shown is None or shown.stale or shown.number == self._metered:
            return
        self._metered = shown.number
        self.reading_cd_m2 = film_reading(shown.frame.pixels, self.resolved, self.dials.meter)
        if self._follows:
            turned = follow_light(self.dials, self.scene, self.resolved, self.reading_cd_m2)
            if turned.changes:
                self.change(turned.changes, dials=turned.dials, transient=shown.moving)
            self.dials, self._follows = turned.dials, False

    def image_of(self, frame: Frame) -> Image:
        """Return a frame as an image that develops as the scene says; glances leave sensor and diffraction out."""
        found = self.session.metadata
        comes_last = self.scene.sensor is not None or found.get("diffraction", {}).get("on", False)
        if comes_last and frame.scale == 1 and self.session.spp > 0:
            return self.session.image()
        metadata = {"spectrum": found.get("spectrum", "rgb")}
        return with_picture_settings(Image(frame.pixels, metadata), self.scene.picture)

    def close(self) -> None:
        """Free the device."""
        self.session.close()
