"""One picture of the viewfinder: a render session, the dials of its camera, and how much to render at once."""

from __future__ import annotations

import importlib.util
import itertools
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.api.compiling import OF_LIGHT, stands_still
from rptcam_cl.api.session import Change, Frame, RenderSession
from rptcam_cl.core.colour import luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.imaging.formats import RawImage
from rptcam_cl.imaging.image import Image, mixed, relit, with_picture_settings
from rptcam_cl.scene.film import LIGHT_LAYER, PictureSettings
from rptcam_cl.scene.scene import Scene
from rptcam_cl.viewfinder.dials import follow_light
from rptcam_cl.viewfinder.instruments import film_reading
from rptcam_cl.viewfinder.messages import Codes, codes_of
from rptcam_cl.viewfinder.panel import Dials, Panel, read_dials, value_per_radiance

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

    def __init__(self) -> None:
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
        worth = max(TAKE_S, self._show_s / SHOWN_SHARE) / each
        most = int(max(LONGEST_S, TAKE_S) / each)
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
        if seconds > GLANCE_S and self._index < len(SCALES) - 1:
            steps = 1 if seconds <= 4 * GLANCE_S else 2
            self._index = min(self._index + steps, len(SCALES) - 1)
        elif self._index > 0 and seconds * 4 < _HEADROOM * GLANCE_S:
            self._index -= 1

    def note_take(self, samples: int, seconds: float) -> None:
        """Note what a take took."""
        if samples > 0:
            each = seconds / samples
            self._sample_s = each if self._sample_s is None else _NEWS * each + (1 - _NEWS) * self._sample_s


# The picture: what is shown of it, and how far it is.

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
NETWORK_S = 1.0  # that a film rests before Open Image Denoise takes both cores for almost as long
_NETWORK_WORTH = 8  # times the samples of a frame that it has cleaned, which others need to look as clean
_HAS_NETWORK = importlib.util.find_spec("pyoidn") is not None
_DENOISED_S = 5.0  # of a film whose picture has what comes last: that is added to the noisy one


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
    mix: Mapping[str, float]  # as of the dials


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
        self._mixed: tuple[Frame, Mapping[str, float], Frame] | None = None  # a frame, and how it was mixed to which
        self.has_network = _HAS_NETWORK
        self._network_spp = 0  # of the frame that is shown as Open Image Denoise has cleaned it
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

    def change(
        self, keys: Mapping[str, Any], *, transient: bool = False, dials: Dials | None = None, by_hand: bool = True
    ) -> Change:
        """Change the scene, at once or not at all.

        Parameters
        ----------
        keys
            Values by key path; None removes.
        transient
            Whether more will come at once, as from a control that is held.
        dials
            The camera's body afterwards; without it the scene says.
        by_hand
            Whether it is one of `changes`; not so what the camera finds by itself in each frame.

        Raises
        ------
        InputError
            A value is wrong; nothing is changed.
        """
        before = self.resolved
        change = self.session.change(dict(keys), wait=False)
        if by_hand:
            self.changes = with_changes(self.changes, keys)
        if dials is not None:
            self.dials = dials
        elif any(part in _BODY for part in change.keys):
            self.dials = read_dials(self.scene, self.dials)
        is_lit_alike = set(change.keys) <= OF_LIGHT and stands_still(self.scene)
        self.note_change(transient, change, value_per_radiance(before) if is_lit_alike else None)
        return change

    def note_change(self, transient: bool, change: Change, value: float | None = None) -> None:
        """Note what a change came to: the picture is another from here on, or the film is developed in another way.

        Parameters
        ----------
        value
            The film's value for radiance 1 before, where nothing but that has changed.
        """
        self.follows_light = True
        self.note_hand(transient)
        self.compiling = self.session.is_waiting
        is_shown = change.kind in _SAME_FILM and self.show_again()
        if not is_shown and not self.compiling:
            self._begin_anew(None if value is None else self._brighter(value_per_radiance(self.resolved) / value))
            self.show_again()

    def _brighter(self, factor: float) -> Frame | None:
        """Return the picture that is there in another exposure, which differs from one that is rendered by rounding."""
        last, shown = self._last, self.shown
        if last is None:
            return None
        if shown is not None and shown.clean is not None and shown.frame.generation == last.generation:
            last = last if self.is_mixed else shown.frame  # for which that is known without its noise
        lights, scale = last.lights, np.float32(factor)
        frame = replace(
            last, pixels=last.pixels * scale, generation=self.session.generation,
            lights=lambda: {name: light * scale for name, light in lights().items()},
        )  # fmt: skip
        if shown is not None and shown.frame is last and shown.clean is not None:
            self._clean = frame, shown.clean * scale
        return frame

    def note_hand(self, transient: bool) -> None:
        """Note that a hand has turned something, and whether more will come at once."""
        self._moving_until = time.monotonic() + (REST_S if transient else 0.0)

    def show_again(self) -> bool:
        """Have the picture that is there shown anew; return whether there is one."""
        self.wants_showing = self._last is not None and not self.wants_glance
        return self.wants_showing

    def arrive(self) -> bool:
        """Show the change that has waited for its kernels, if they are there now; return whether they are."""
        if not self.compiling and self.rests_in() <= 0 and not self.wants_glance and self.session.relieve():
            self._begin_anew(self._last)
            return True
        if not (self.compiling and self.session.ready):
            return False
        self.compiling, self.follows_light = False, True
        self._begin_anew()
        return True

    def _begin_anew(self, shown: Frame | None = None) -> None:
        """Begin another film; a picture may stay until there is one as good."""
        stays = shown is not None and not self.wants_glance
        self.wants_glance, self._last = not stays, shown if stays else None
        self._stays_for = min(shown.spp, self.target_spp) if shown is not None and stays else 0
        self.film, self.finished = next(_FILMS), None
        self._reaches_noise = self._unread = False
        self._next_samples, self._network_spp = 1, 0
        self._film_begun, self._visible = time.monotonic(), self._visible if stays else (0.0, 0)

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
        seen = self._see(self._last)
        self._denoise(seen)
        self.pace.note_glance(scale, time.perf_counter() - begun)
        return seen

    def _see(self, frame: Frame) -> Frame:
        """Return a frame with its lamps as bright as a hand has them; itself where they are as they were rendered."""
        mix = {name: gain for name, gain in self.dials.mix.items() if gain != 1}
        lights = frame.lights() if mix else {}
        mix = {name: gain for name, gain in mix.items() if f"{LIGHT_LAYER}{name}" in lights}
        if not mix:
            return frame
        if self._mixed is None or self._mixed[0] is not frame or self._mixed[1] != mix:
            self._mixed = frame, mix, replace(frame, pixels=mixed(frame.pixels, lights, mix), lights=dict)
        return self._mixed[2]

    @property
    def is_mixed(self) -> bool:
        """Whether lamps are shown brighter or darker than they are."""
        return any(self.dials.mix.get(name, 1.0) != 1 for name in self.session.light_groups)

    def image_later(self) -> Callable[[], Image]:
        """Read the film; return what makes its image, with lamps as bright as a hand has them, in any thread."""
        later = self.session.image_later()
        mix = {name: gain for name, gain in self.dials.mix.items() if name in self.session.light_groups}
        return (lambda: relit(later(), mix)) if self.is_mixed else later

    def _denoise(self, frame: Frame) -> NDArray[np.float32] | None:
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
        late = bool(self.comes_last) and time.monotonic() > self._film_begun + _DENOISED_S
        noise = self.visible_noise(frame)
        return late or frame.spp >= self.target_spp or (noise is not None and noise <= CLEAN)

    def visible_noise(self, frame: Frame) -> float | None:
        """Return the noise of a frame of the film that is seen, by `visible_noise` at fewer samples."""
        noise, spp = self._visible
        return noise * math.sqrt(spp / frame.spp) if spp and frame.spp >= spp and frame.scale == 1 else None

    def clean_at(self, frame: Frame) -> dict[str, float] | None:
        """How many samples it takes until the noise is not seen, and how long from the film's beginning [s]."""
        noise = self.visible_noise(frame)
        if noise is None or frame.spp > self.session.spp:  # of the film before
            return None
        share = max((noise / CLEAN) ** 2, 1.0)
        seconds = share * (time.monotonic() - self._film_begun)
        return {"noise": noise, "spp": share * frame.spp, "seconds": seconds}

    def again(self) -> Frame:
        """Return the picture that is there, to be developed anew."""
        assert self._last is not None, "there is one where a change leaves the film"
        self.wants_showing = False
        seen = self._see(self._last)
        return self.finished.frame if self.finished is not None and self.finished.mix == self.dials.mix else seen

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
        stays = self.finished is not None or (self._network_spp > 0 and not self._is_clean(frame))
        return None if stays else self._see(self._last)

    def leave_unread(self) -> None:
        """Note that the picture of the last samples was given up before it was made."""
        self._unread = self.session.spp > 0

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
            clean = self._denoise(frame)
            pixels = frame.pixels if clean is None else clean
            sketch = self.session.sketch_of_ghosts(frame) if "ghosts" in lacks else None
            image = self._plain_image(pixels if sketch is None else pixels + sketch)
        codes = codes_of(image)
        self._number, self._network_spp = self._number + 1, 0
        self.shown = Shown(self._number, frame, codes, moving, stale, self._answers, None, lacks, clean)

    @property
    def wants_network(self) -> bool:
        """Whether Open Image Denoise is to clean the picture at rest now: first, and as samples double."""
        last, shown = self._last, self.shown
        if not self.has_network or last is None or shown is None or shown.clean is None or self.rests_in() > 0:
            return False
        if self.compiling or self.wants_glance or self.wants_showing or shown.frame.scale < 1 or last.scale < 1:
            return False
        rests = time.monotonic() > self._film_begun + NETWORK_S and last.spp <= self.session.spp
        return rests and last.spp >= 2 * self._network_spp and not self._is_clean(last)

    def network_later(self) -> Callable[[], tuple[int, Frame, NDArray[np.float32]]]:
        """Read what `show_network` shows; return what makes it, in any thread."""
        assert self._last is not None, "as `wants_network` says"
        film, frame = self.film, self._see(self._last)
        clean = self.session.denoised_later(frame)
        return lambda: (film, frame, clean())

    def show_network(self, made: tuple[int, Frame, NDArray[np.float32]]) -> None:
        """Show what the network has cleaned, unless there is another film by now, or one of twice its samples."""
        film, frame, clean = made
        shown = self.shown.frame if self.shown is not None and self.film == film else None
        if shown is None or self.wants_glance or not self.denoises or self._is_clean(self._last or frame):
            return
        if shown.scale < 1 or shown.spp < _NETWORK_WORTH * frame.spp:
            self._clean = frame, clean
            self.show(frame, False, self._answers)
            self._network_spp = frame.spp

    @property
    def comes_last(self) -> tuple[str, ...]:
        """What of the picture takes so long that it is added at rest, off the thread of frames."""
        described = self.session.metadata
        has = {
            "diffraction": any(described.get("diffraction", {}).get(key, False) for key in ("on", "film_decides")),
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
        if done is None or (done.picture, done.mix) != (self.scene.picture, self.dials.mix):
            return True
        return last.spp >= _GROWN * done.frame.spp or (self.is_done and last.spp > done.frame.spp)

    def picture_later(self) -> Callable[[], Finished]:
        """Read the film; return what finishes its picture, in any thread."""
        assert self._last is not None, "as `wants_finishing` says"
        film, done, picture, mix = self.film, self.finished, self.scene.picture, self.dials.mix
        frame = self._see(self._last)
        later = self.image_later() if done is None or done.frame is not frame else lambda: done.image

        def finish() -> Finished:
            image = with_picture_settings(later(), picture)
            return Finished(
                film, frame, image, codes_of(image), image.raw() if image.has_sensor else None, picture, mix
            )

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
        lit = shown.frame  # by the lamps as they are, which the exposure goes by
        if self._mixed is not None and self._mixed[2] is lit:
            lit = self._mixed[0]
        self.reading_cd_m2 = film_reading(lit.pixels, self.resolved, self.dials.meter)
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


def with_changes(changes: Mapping[str, Any], keys: Mapping[str, Any]) -> dict[str, Any]:
    """Add changed keys, in the order of their last change; those below a changed key are forgotten with it."""
    merged = dict(changes)
    for key, value in keys.items():
        for old in [old for old in merged if old == key or old.startswith((f"{key}.", f"{key}["))]:
            del merged[old]
        merged[key] = value
    return merged
