"""The render session: a scene on a device that is changed and rendered again; only what changes is redone."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Hashable, Mapping
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.api.ahead import key_of
from rptcam_cl.api.frames import Change, Frame, NoiseAtHand, Pace
from rptcam_cl.api.preparation import Preparation, of_glance
from rptcam_cl.api.scene_state import (
    OF_DEVELOPMENT,
    SceneState,
    changed_parts,
    focused_as,
    focuses_anew,
    image_of,
    kind_of,
    reading_of,
    scaled,
)
from rptcam_cl.api.settings import RenderSettings
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.device import Session, open_sessions
from rptcam_cl.imaging import Image, check_sensor
from rptcam_cl.plan import Plan
from rptcam_cl.rendering import FilmLayout, FilmRun, SceneBuffers, window
from rptcam_cl.scene import Scene, load_scene, set_keys


class RenderSession:
    """A scene on a device, to be changed and rendered again: poses, lenses, materials, whatever a scene file says.

    What does not change stays on the device, compiled. After N samples the film has the very bits of
    `rptcam_cl.render` with ``spp=N`` of `scene`, whatever was changed before.

    Focus is found as by a camera's single autofocus: at the beginning, and whenever a change sets the focus to ``auto``
    or takes another lens. Every other change leaves the focus as it was found, and `scene` names it in place of
    ``auto``. Exposure ``auto`` is metered anew for each changed film, as a camera does until the exposure is locked
    (``exposure.lock_cd_m2``); glances go by the last reading.

    All methods are for one thread, but for `cancel` and `ready`.

    Parameters
    ----------
    scene
        A scene, or anything that `load_scene` takes.
    device
        As for `render`, but one device.
    size, seed
        Replace the scene's resolution [pixels] and seed.
    wait
        Whether to wait for kernels. Otherwise glances come from ones that compile soonest until others have been
        compiled in the background; they may differ by rounding. The film never comes from them.

    Raises
    ------
    InputError, DeviceError
        As `render` does.
    """

    def __init__(
        self,
        scene: Scene | str | Path | Mapping[str, Any],
        *,
        device: str | Session | None = None,
        size: tuple[int, int] | None = None,
        seed: int | None = None,
        wait: bool = True,
    ) -> None:
        self._begun = time.perf_counter()
        self._settings = RenderSettings(size=size, seed=seed)
        given = self._given(scene)
        sessions, _ = open_sessions(device)
        if len(sessions) > 1:
            raise InputError("device: a session renders on one device (name one of them)")
        self._device = sessions[0]
        self._preparation = Preparation(self._device, waits=wait)
        self._ahead = self._preparation.ahead
        self._cancelled = threading.Event()
        self._pace = Pace(self._cancelled)
        self._generation = 0
        self._run: FilmRun | None = None
        self._of_film: tuple[Plan, SceneBuffers] | None = None
        self._noise = NoiseAtHand()
        self._waiting: SceneState | None = None
        self._seconds, self._added_s, self._complete = 0.0, 0.0, True  # spent on the film; by the last samples
        self._shown = self._preparation.first(given)
        self._reading = self._shown.found.metered_cd_m2  # of the exposure meter, for glances
        self._preparation.compile_soonest(self._shown)
        self._hash: str | None = given.content_hash()

    @property
    def device(self) -> Session:
        """The device that it renders on."""
        return self._device

    @property
    def scene(self) -> Scene:
        """The scene as requested; what autofocus found for an earlier scene stands in place of ``auto``."""
        return self._newest.scene

    @property
    def resolved(self) -> Scene:
        """The scene in focus, with its camera model and its exposure."""
        return self._newest.found.scene

    @property
    def metadata(self) -> dict[str, Any]:
        """How focus, camera model and exposure were found, and what the picture's metadata say of the spectrum."""
        return self._newest.plan.spectrum.metadata | self._newest.found.metadata

    @property
    def resolution(self) -> tuple[int, int]:
        """Width and height of the frames [pixels]."""
        _, _, width, height = window(self._shown.scene)
        return width, height

    @property
    def generation(self) -> int:
        """Counts the changes that are shown."""
        return self._generation

    @property
    def spp(self) -> int:
        """Samples that every pixel of the film has."""
        return 0 if self._run is None else self._run.done

    @property
    def is_waiting(self) -> bool:
        """Whether frames still show the scene before the last change, whose kernels are not compiled yet."""
        return self._waiting is not None

    @property
    def ready(self) -> bool:
        """Whether nothing is compiled in the background."""
        return self._ahead.ready

    def is_film_ready(self) -> bool:
        """Return whether samples can be taken at once; otherwise what they need is compiled in the background.

        So are the full kernels of glances, after those of the film. A session that waits is always ready.
        """
        self._arrive()
        return self._preparation.is_film_ready(self._shown, self._film_plan)

    def change(self, changes: Mapping[str, Any], *, wait: bool = True) -> Change:
        """Set keys of the scene, as `rptcam_cl.scene.set_keys` does; the film is empty then, unless it stays the same.

        Parameters
        ----------
        changes
            Values as a scene file has them, by key path: ``{"camera.f_number": 4, "objects.2.radius": 0.5}``. None
            removes a key; one that excludes others replaces them.
        wait
            Whether to wait where kernels have to be compiled. Otherwise the session goes on with the scene before,
            whose film can have more samples meanwhile, until they are.

        Raises
        ------
        InputError
            When the changed scene is not valid; the session is as it was.
        """
        self._check_open()
        scene = self._changed(changes)
        return self._take_over(scene, focus_anew=focuses_anew(changes, scene), wait=wait)

    def replace(self, scene: Scene | str | Path | Mapping[str, Any], *, wait: bool = True) -> Change:
        """Take another scene, as `change` does; its focus and exposure are found anew.

        Raises
        ------
        InputError
            When it is not valid; the session is as it was.
        """
        self._check_open()
        given = self._given(scene)
        content = given.content_hash()
        files_changed = content != self._hash  # a lens or a picture, though the scene may say the same
        change = self._take_over(given, focus_anew=True, wait=wait, anyway=files_changed)
        self._hash = content
        return change

    def prepare(self, changes: Mapping[str, Any]) -> None:
        """Compile in the background what a change would need; nothing that is shown changes.

        Raises
        ------
        InputError
            As `change` would.
        """
        self._check_open()
        state = self._preparation.beside(self._newest, focused_as(self._newest, self._changed(changes)), self._reading)
        self._preparation.begin(state)

    def is_carried_out(self, kind: Hashable, order: Callable[[], bytes]) -> bool:
        """Return whether another process has carried out an order about this scene; see `Ahead.is_carried_out`."""
        state = self._newest
        return self._ahead.is_carried_out((kind, key_of(state.plan, state.buffers, state.scene.render)), order)

    def take(self, samples: int = 1) -> Frame:
        """Add samples to the film and return it; a sample that was left is the first of them.

        Raises
        ------
        InputError
            When less than one is requested.
        """
        self.add(samples)
        return self.frame()

    def add(self, samples: int = 1) -> bool:
        """Add samples to the film as `take` does, but read nothing of it; return whether all of them are there."""
        if samples < 1:
            raise InputError(f"samples: is out of range (got {samples!r}; allowed: at least 1)")
        begun = time.perf_counter()
        self._complete = self._add(self._film(), samples)
        self._added_s = time.perf_counter() - begun
        self._seconds += self._added_s
        return self._complete

    def frame(self) -> Frame:
        """Return the film as it is after `add`."""
        begun, run = time.perf_counter(), self._film()
        sums = run.wavefront.sums()
        pixels = run.wavefront.layout.picture(sums, run.samples_of_tiles())
        noise = self._noise.of(run, sums)
        seconds = self._added_s + time.perf_counter() - begun
        return Frame(pixels, run.done, self._complete, seconds, noise, 1.0, self._generation)

    def glance(self, scale: float = 0.25) -> Frame:
        """Return one sample per pixel of the same view at a share of its resolution; the film stays as it is.

        Raises
        ------
        InputError
            When the scale is not above 0 and at most 1.
        """
        if not 0 < scale <= 1:
            raise InputError(f"scale: is out of range (got {scale!r}; allowed: above 0, at most 1)")
        begun = time.perf_counter()
        self._arrive()
        state = self._shown
        plan, film = scaled(state, scale, self._reading)
        buffers = self._preparation.pool.upload(plan)
        pool = self._preparation.pool_of_glances(state)
        run = FilmRun(pool.wavefront(plan, buffers, FilmLayout.of(film), of_glance(state.scene), "glance"))
        complete = self._add(run, 1)
        pixels = run.pixels()
        if complete and state.found.metered_cd_m2 is not None:
            self._reading = reading_of(pixels, plan, state, film) or self._reading
        return Frame(pixels, run.done, complete, time.perf_counter() - begun, None, scale, self._generation)

    def cancel(self) -> None:
        """End a `take` or `glance` under way in another thread: it returns with what there is."""
        self._cancelled.set()

    def pixels(self) -> NDArray[np.float32]:
        """Return the film so far, (height, width, 3); black before the first sample."""
        return self._film().pixels()

    def image(self) -> Image:
        """Return the film so far as `render` returns it, with its metadata and statistics.

        Raises
        ------
        InputError
            Before the first sample.
        """
        run = self._film()
        while not run.is_whole:
            self._add(run, 1)
        if run.done == 0:
            raise InputError("the session has no samples yet (call take() first)")
        settings = replace(self._settings, device=self._device)
        return image_of(self._shown, self._film_plan()[0], run, settings, seconds=self._seconds, begun=self._begun)

    def close(self) -> None:
        """Let go of the device; the session is of no use then."""
        self._run, self._waiting = None, None
        self._preparation.close()
        self._closed = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    _closed = False

    @property
    def _newest(self) -> SceneState:
        return self._waiting or self._shown

    def _check_open(self) -> None:
        if self._closed:
            raise StateError("the session is closed (make another one)")

    def _given(self, scene: Scene | str | Path | Mapping[str, Any]) -> Scene:
        found = self._settings.applied_to(scene if isinstance(scene, Scene) else load_scene(scene))
        check_sensor(found, *window(found)[2:])
        return found

    def _changed(self, changes: Mapping[str, Any]) -> Scene:
        scene = set_keys(self.scene, changes)
        check_sensor(scene, *window(scene)[2:])
        return scene

    def _take_over(self, scene: Scene, *, focus_anew: bool, wait: bool, anyway: bool = False) -> Change:
        before = self._newest
        keys = changed_parts(before.scene, scene)
        if not keys and not anyway:
            return Change("none", (), self._waiting is None)
        if set(keys) <= OF_DEVELOPMENT and not anyway:
            self._replace_scene(scene)
            return Change("picture", keys, self._waiting is None)
        if focus_anew:
            state = self._preparation.first(scene)
        else:
            state = self._preparation.beside(before, focused_as(before, scene), self._reading)
        self._hash = None
        compiled = self._preparation.knows(state)
        if not compiled and not wait:
            self._waiting = state
            self._preparation.begin(state)
            return Change("program", keys, ready=False)
        self._preparation.compile(state)
        self._show(state)
        return Change(kind_of(before.plan, state.plan, compiled, keys), keys)

    def _show(self, state: SceneState) -> None:
        self._shown, self._waiting, self._run, self._of_film = state, None, None, None
        self._noise, self._seconds = NoiseAtHand(), 0.0
        self._reading = self._reading or state.found.metered_cd_m2
        self._generation += 1

    def _replace_scene(self, scene: Scene) -> None:
        """Take a scene that gives the same film."""
        if self._waiting is not None:
            self._waiting = replace(self._waiting, scene=scene)
        else:
            self._shown = replace(self._shown, scene=scene)
            self._generation += 1

    def _arrive(self) -> None:
        """Show the scene that has been waited for, once it is compiled."""
        self._check_open()
        waiting = self._waiting
        if waiting is not None and self._ahead.ready:
            self._preparation.compile(waiting)
            self._show(waiting)

    def _film(self) -> FilmRun:
        """Return the film of the scene that is shown, metered."""
        self._arrive()
        if self._run is None:
            plan, buffers = self._film_plan()
            scene = self._shown.scene
            wavefront = self._preparation.pool.wavefront(plan, buffers, FilmLayout.of(scene.film), scene.render, "film")
            self._run = FilmRun(wavefront, scene.render.noise)
        return self._run

    def _film_plan(self) -> tuple[Plan, SceneBuffers]:
        """Return the plan of the film of what is shown, and its arrays."""
        if self._of_film is None:
            if not self._shown.is_final:
                self._shown = self._preparation.final(self._shown)
                self._reading = self._shown.found.metered_cd_m2
            self._of_film = self._preparation.of_film(self._shown)
        return self._of_film

    def _add(self, run: FilmRun, samples: int) -> bool:
        """Add samples to a film unless that is cancelled; return whether all are there."""
        self._cancelled.clear()
        end = run.done + samples
        count, most = self._pace.enqueued(run.wavefront.finish), run.wavefront.samples_per_wave
        complete = True
        while complete and run.done < end and not run.watch.satisfied:
            complete = run.add(min(end - run.done, most), count, slots=self._pace.slots)
            complete = complete and not (self._cancelled.is_set() and run.done < end)
        run.wavefront.finish()
        return complete
