"""The render session: a scene on a device that is changed and rendered again; only what changes is redone."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Hashable, Mapping
from dataclasses import replace
from functools import cache
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.api import compiling
from rptcam_cl.api.job import RenderJob, scene_of
from rptcam_cl.api.options import RenderOptions
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, StateError, out_of_range
from rptcam_cl.core.remember import checkpoint, is_cancellable
from rptcam_cl.device.session import Session, open_sessions
from rptcam_cl.imaging.development import check_sensor, denoise
from rptcam_cl.imaging.image import Image
from rptcam_cl.rendering.account import window
from rptcam_cl.rendering.cameras.kinds import camera_of
from rptcam_cl.rendering.film import FilmLayout, group_pictures
from rptcam_cl.rendering.ghosts import Ghosting, sketch_of_ghosts
from rptcam_cl.rendering.layers import object_at
from rptcam_cl.rendering.passes import Denoiser
from rptcam_cl.rendering.plan.plan import Plan
from rptcam_cl.rendering.progressive import FilmRun, rendering_of
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.load import SceneSource
from rptcam_cl.scene.scene import Scene

# What a render session hands out: frames, and what a change came to.

QUEUE_SECONDS = 0.006  # of work that is enqueued before the device is waited for
_FIRST_SLOTS = 1 << 14  # of the first wave, whose time is not known
_MOST_DENOISED = 1 << 21  # pixels, as denoising takes 150 bytes of memory for each
FEW_SAMPLES = 8  # of a frame, up to which a network of half the time does: 0.954 beside 0.959 of SSIM at 3


@dataclass(frozen=True)
class Change:
    """The effect of a change of a session's scene.

    Attributes
    ----------
    kind : str
        The most expensive that it took. ``none``: nothing has changed. ``picture``: the film stays, it is developed in
        another way. ``camera``: records of the camera. ``scene``: other records too, or another film. ``program``:
        kernels.
    keys : tuple of str
        The parts of the scene that are others now.
    ready : bool
        False while kernels are compiled in the background and the session still shows the scene before.
    """

    kind: compiling.ChangeKind
    keys: tuple[str, ...]
    ready: bool = True


@dataclass(frozen=True, eq=False)
class Frame:
    """A picture of a session.

    Attributes
    ----------
    pixels : (height, width, 3) float32 array
        Linear film; each pixel is the mean of its samples.
    spp : int
        Samples that every pixel has.
    complete : bool
        False where `RenderSession.cancel` left it within a sample.
    seconds : float
        What it took [s].
    noise : float or None
        Relative standard error of the whole picture, estimated when the samples last doubled and scaled to their
        number; None for less than two, and for glances.
    scale : float
        Share of the film's resolution.
    generation : int
        Counts the changes that are shown.
    lights : callable
        Returns the light of each group of lamps, (height, width, 3) by the name of its layer, where the scene has the
        layer ``lights``.
    """

    pixels: NDArray[np.float32]
    spp: int
    complete: bool
    seconds: float
    noise: float | None
    scale: float
    generation: int
    lights: Callable[[], dict[str, NDArray[np.float32]]] = dict


class QueueLimit:
    """Keeps the queue of a device so short that work is given up at once where nobody wants it any more."""

    def __init__(self) -> None:
        self._rate: float | None = None  # slots per second
        self._pending, self._since = 0, 0.0

    @property
    def slots(self) -> int:
        """Most of a wave."""
        return _FIRST_SLOTS if self._rate is None else max(int(self._rate * QUEUE_SECONDS), 1)

    def count_waves(self, finish: Callable[[], None], should_stop: Callable[[], bool]) -> Callable[[int], bool]:
        """A counter of waves of so many slots, which says whether to stop; ``finish`` waits for the device."""
        self._pending, self._since = 0, time.perf_counter()

        def count(slots: int) -> bool:
            self._pending += slots
            if self._pending >= self.slots:
                finish()
                now = time.perf_counter()
                self._rate = self._pending / max(now - self._since, 1e-6)
                self._pending, self._since = 0, now
            return should_stop()

        return count


def _lights_of(run: FilmRun) -> Callable[[], dict[str, NDArray[np.float32]]]:
    """Read the light of the groups of lamps of a film, where there are any; return what makes pictures of it, once."""
    wavefront = run.wavefront
    names, layout = wavefront.light_groups, wavefront.layout
    if not names:
        return dict
    planes, tiles = wavefront.planes(), run.samples_of_tiles()
    return cache(lambda: group_pictures(layout, planes, tiles, names))


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
        scene: SceneSource,
        *,
        device: str | Session | None = None,
        size: tuple[int, int] | None = None,
        seed: int | None = None,
        wait: bool = True,
    ) -> None:
        self._begun = time.perf_counter()
        self._options = RenderOptions(size=size, seed=seed)
        given = scene_of(scene, self._options)
        sessions, _ = open_sessions(device)
        if len(sessions) > 1:
            raise InputError("device: a session renders on one device (name one of them)")
        self._device = sessions[0]
        self._compiler = compiling.SceneCompiler(self._device, waits=wait)
        self._cancelled = threading.Event()
        self._queue, self._queue_of_guides = QueueLimit(), QueueLimit()
        self._generation = 0
        self._run: FilmRun | None = None
        self._of_film: tuple[Plan, SceneBuffers] | None = None
        self._ghosting: Ghosting | None = None  # of the film
        self._noise: float | None = None  # of the film
        self._noise_spp = 1  # at which it was estimated
        self._waiting: compiling.SceneState | None = None
        self._seconds, self._added_s, self._complete = 0.0, 0.0, True  # spent on the film; by the last samples
        # Of the picture that was denoised last, after what that is
        self._guides: tuple[Any, FilmRun, tuple[float, float]] | None = None
        self._sketch: tuple[Any, NDArray[np.float32]] | None = None  # of ghosts, after what it is of
        self._denoiser: tuple[tuple[int, int], Denoiser] | None = None  # of the size that was denoised last
        self._shown = self._compiler.first(given)
        self._reading = self._shown.resolved.metered_cd_m2  # of the exposure meter, for glances
        self._compiler.compile_fast(self._shown)
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
        return self._newest.resolved.scene

    @property
    def metadata(self) -> dict[str, Any]:
        """How focus, camera model and exposure were found, and what the picture's metadata say of the spectrum."""
        return self._newest.plan.spectrum.metadata | self._newest.resolved.metadata

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
    def light_groups(self) -> tuple[str, ...]:
        """The groups of lamps whose light frames keep apart, where the scene has the layer ``lights``."""
        return self._shown.plan.light_groups.names

    @property
    def spp(self) -> int:
        """Samples that every pixel of the film has."""
        return 0 if self._run is None else self._run.done

    @property
    def samples_per_wave(self) -> int:
        """Samples per pixel that the device takes of the film at once; fewer cost more each."""
        return 1 if self._run is None else self._run.wavefront.samples_per_wave

    @property
    def is_whole(self) -> bool:
        """Whether all pixels of the film have the same samples: it was not left within one."""
        return self._run is None or self._run.is_whole

    @property
    def is_waiting(self) -> bool:
        """Whether frames still show the scene before the last change, whose kernels are not compiled yet."""
        return self._waiting is not None

    @property
    def ready(self) -> bool:
        """Whether nothing is compiled in the background."""
        return self._compiler.is_idle

    def is_film_ready(self) -> bool:
        """Whether samples can be taken at once; otherwise what they need is compiled in the background.

        So are the full kernels of glances, after those of the film. A session that waits is always ready.
        """
        self._arrive()
        return self._compiler.is_film_ready(self._shown, self._film_plan)

    def change(self, changes: Mapping[str, Any], *, wait: bool = True) -> Change:
        """Set keys of the scene, as `rptcam_cl.scene.changes` does; the film is empty then, unless it stays the same.

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
        scene = self._scene_with(changes)
        return self._take_over(scene, focus_anew=compiling.focuses_anew(changes, scene), wait=wait)

    def replace(self, scene: SceneSource, *, wait: bool = True) -> Change:
        """Take another scene, as `change` does; its focus and exposure are found anew.

        Raises
        ------
        InputError
            When it is not valid; the session is as it was.
        """
        self._check_open()
        given = scene_of(scene, self._options)
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
        state = self._compiler.for_glances(
            self._newest, compiling.keep_focus(self._newest, self._scene_with(changes)), self._reading
        )
        self._compiler.begin(state)

    def is_carried_out(self, kind: Hashable, order: Callable[[], bytes]) -> bool:
        """Whether another process has carried out an order about this scene; see `SceneCompiler`."""
        state = self._newest
        return self._compiler.is_carried_out(
            (kind, compiling.key_of(state.plan, state.buffers, state.scene.render)), order
        )

    def take(self, samples: int = 1) -> Frame:
        """Add samples to the film and return it; a sample that was left is the first of them.

        Raises
        ------
        InputError
            When less than one is requested.
        """
        self.add(samples)
        return self.frame()

    def add(self, samples: int = 1, should_stop: Callable[[], bool] = lambda: False) -> bool:
        """Add samples to the film as `take` does, but read nothing of it; return whether all of them are there.

        ``should_stop`` is asked again and again whether to return with what there is.
        """
        if samples < 1:
            raise out_of_range("samples", samples, "at least 1")
        begun = time.perf_counter()
        self._complete = self._add(self._film(), samples, should_stop)
        self._added_s = time.perf_counter() - begun
        self._seconds += self._added_s
        return self._complete

    def frame(self) -> Frame:
        """Return the film as it is after `add`."""
        begun, run = time.perf_counter(), self._film()
        sums = run.wavefront.sums()
        pixels = run.wavefront.layout.picture(sums, run.samples_of_tiles())
        noise, lights = self._noise_of(run, sums), _lights_of(run)
        seconds = self._added_s + time.perf_counter() - begun
        return Frame(pixels, run.done, self._complete, seconds, noise, 1.0, self._generation, lights)

    def glance(self, scale: float = 0.25) -> Frame:
        """Return one sample per pixel of the same view at a share of its resolution; the film stays as it is.

        Raises
        ------
        InputError
            When the scale is not above 0 and at most 1.
        """
        if not 0 < scale <= 1:
            raise out_of_range("scale", scale, "above 0, at most 1")
        begun = time.perf_counter()
        self._arrive()
        state = self._shown
        plan, film = compiling.plan_smaller_film(state, scale, self._reading)
        buffers = self._compiler.pool.upload(plan)
        pool = self._compiler.pool_of_glances(state)
        run = FilmRun(pool.wavefront(plan, buffers, FilmLayout.of(film), compiling.of_glance(state.scene), "glance"))
        complete = self._add(run, 1)
        pixels = run.pixels()
        if complete and state.resolved.metered_cd_m2 is not None:
            self._reading = compiling.reading_of(pixels, plan, state, film) or self._reading
        lights = _lights_of(run)
        return Frame(pixels, run.done, complete, time.perf_counter() - begun, None, scale, self._generation, lights)

    def sketch_of_ghosts(self, frame: Frame) -> NDArray[np.float32] | None:
        """Return about what ghosts give a frame of what is shown, by paraxial rays; None where the camera has none."""
        self._check_open()
        state, key = self._shown, (self._generation, frame.pixels.shape)
        if state.resolved.ghosts is None or frame.generation != self._generation:
            return None
        if self._sketch is None or self._sketch[0] != key:
            plan = compiling.plan_smaller_film(state, frame.scale, self._reading)[0]
            buffers, (height, width) = self._compiler.pool.upload(plan), frame.pixels.shape[:2]
            self._sketch = key, sketch_of_ghosts(state.resolved.ghosts, plan, buffers, self._device, (height, width))
        return self._sketch[1]

    def denoised(self, frame: Frame) -> NDArray[np.float32] | None:
        """Return a frame of what is shown without its noise: biased, and less so with every sample.

        None where it has too many pixels, and while what it takes is compiled in the background.
        """
        self._check_open()
        (height, width), state = frame.pixels.shape[:2], self._shown
        if width * height > _MOST_DENOISED or frame.generation != self._generation:
            return None
        if not self._compiler.is_guided(state):
            return None
        run, blur = self._guides_of(state, frame.scale)
        self._add_guides(run, min(frame.spp, compiling.MOST_GUIDES))
        if self._denoiser is None or self._denoiser[0] != (width, height):
            self._denoiser = None  # its memory is free before
            self._denoiser = (width, height), Denoiser(self._device, width, height)
        assert isinstance(run.wavefront, Wavefront) and run.wavefront.layer_pass is not None, "it has `GUIDES`"
        return self._denoiser[1].clean(frame.pixels, run.wavefront.layer_pass, run.done, blur)

    def denoised_later(self, frame: Frame) -> Callable[[], NDArray[np.float32]]:
        """Read the layers of a frame of the film that `denoised` has made; return what has Open Image Denoise clean it.

        That may be called in any thread; it takes a second, and raises an InputError where the package is missing.
        """
        wavefront = self._guides_of(self._shown, 1.0)[0].wavefront
        assert isinstance(wavefront, Wavefront) and wavefront.layer_pass is not None, "it has `GUIDES`"
        layers = wavefront.layer_pass
        planes, quality = layers.planes(), "fast" if frame.spp < FEW_SAMPLES else "high"

        def clean() -> NDArray[np.float32]:
            arrays = layers.arrays(planes)
            return denoise(frame.pixels, arrays["albedo"], arrays["normal"], quality)[0]

        return clean

    def _add_guides(self, run: FilmRun, samples: int) -> None:
        """Add samples to layers until they have so many; where this can be cancelled, in short pieces."""

        def checked() -> bool:
            checkpoint()
            return False

        count = self._queue_of_guides.count_waves(run.wavefront.finish, checked) if is_cancellable() else None
        while (missing := samples - run.done) > 0:
            run.add(missing, count, slots=self._queue_of_guides.slots if count else None)

    def _guides_of(self, state: compiling.SceneState, scale: float) -> tuple[FilmRun, tuple[float, float]]:
        """The layers that guide the denoising of a frame, as far as they are there, and `Perspective.blur`."""
        key = self._generation, scale, state.is_final
        if self._guides is None or self._guides[0] != key:
            plan, film = state.plan, state.resolved.scene.film
            if scale != 1 or not state.is_final:
                plan, film = compiling.plan_smaller_film(state, scale, self._reading)
            buffers = self._compiler.pool.upload(plan)
            settings = compiling.of_guides(state.scene)
            wavefront = self._compiler.pool.wavefront(plan, buffers, FilmLayout.of(film), settings, "guides")
            seen = camera_of(state.resolved.scene).perspective()
            pixel_mm = film.size_m()[0] * 1e3 / film.resolution[0]
            blur = (0.0, 0.0) if seen is None else seen.blur(pixel_mm)
            self._guides = key, FilmRun(wavefront), blur
        return self._guides[1:]

    def object_later(self, x: float, y: float) -> Callable[[], int | None]:
        """Make a search for the object at a place of the picture, for any thread: its index, None where there is none.

        Parameters
        ----------
        x, y
            From the left and the top edge, 0 to 1; seen by the chief ray.
        """
        self._check_open()
        plan, scene, device = self._shown.plan, self._shown.resolved.scene, self._device.beside()
        return lambda: object_at(scene, plan, device, x, y)

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
        return self.image_later()()

    def image_later(self) -> Callable[[], Image]:
        """Read the film; return what makes its image as `image` does, in any thread: optics may take seconds.

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
        plan, state, wavefront = self._film_plan()[0], self._shown, run.wavefront
        job = RenderJob(
            self._options, state.scene, state.resolved, plan, wavefront, begun=self._begun, ghosting=self._ghosting
        )
        self._ghosting = job.ghosting
        samples = wavefront.camera_rays
        return job.later(rendering_of(run, start=0, seconds=self._seconds, new_samples=samples, interrupted=False))

    def close(self) -> None:
        """Let go of the device; the session is of no use then."""
        self._run, self._waiting, self._guides, self._denoiser = None, None, None, None
        self._compiler.close()
        self._closed = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    _closed = False

    @property
    def _newest(self) -> compiling.SceneState:
        return self._waiting or self._shown

    def _check_open(self) -> None:
        if self._closed:
            raise StateError("the session is closed (make another one)")

    def _scene_with(self, changes: Mapping[str, Any]) -> Scene:
        scene = set_keys(self.scene, changes)
        check_sensor(scene, *window(scene)[2:])
        return scene

    def _take_over(self, scene: Scene, *, focus_anew: bool, wait: bool, anyway: bool = False) -> Change:
        before = self._newest
        keys = compiling.changed_parts(before.scene, scene)
        if not keys and not anyway:
            return Change("none", (), self._waiting is None)
        if set(keys) <= compiling.OF_DEVELOPMENT and not anyway:
            self._replace_scene(scene)
            return Change("picture", keys, self._waiting is None)
        if focus_anew:
            state = self._compiler.first(scene)
        else:
            state = self._compiler.for_glances(before, compiling.keep_focus(before, scene), self._reading)
        self._hash = None
        compiled = self._compiler.is_ready(state)
        if not compiled and not wait and (served := self._compiler.served(state, self._shown)) is not None:
            state, compiled = served, True
        if not compiled and not wait:
            self._waiting = state
            self._compiler.begin(state)
            return Change("program", keys, ready=False)
        self._compiler.compile(state)
        self._show(state)
        return Change(compiling.kind_of(before.plan, state.plan, compiled, keys), keys)

    def _show(self, state: compiling.SceneState) -> None:
        self._shown, self._waiting, self._run, self._of_film, self._ghosting = state, None, None, None, None
        self._noise, self._noise_spp, self._seconds = None, 1, 0.0
        self._reading = self._reading or state.resolved.metered_cd_m2
        self._generation += 1

    def _replace_scene(self, scene: Scene) -> None:
        """Take a scene that gives the same film."""
        if self._waiting is not None:
            self._waiting = replace(self._waiting, scene=scene)
        else:
            relief = self._shown.relief
            relief = None if relief is None else replace(relief, scene=scene)
            self._shown = replace(self._shown, scene=scene, relief=relief)
            self._generation += 1

    def relieve(self) -> bool:
        """Begin the film anew with kernels of its own, once there are; return whether that was done now.

        Where a scene was changed without waiting, kernels of the scene before may stand in for its own, and find light
        in another way than `rptcam_cl.render` does.
        """
        self._check_open()
        relief = self._shown.relief
        if relief is None or self._waiting is not None or not self._compiler.is_idle:
            return False
        if not self._compiler.is_ready(relief):
            self._compiler.begin(relief)
            return False
        self._show(relief)
        return True

    def _arrive(self) -> None:
        """Show the scene that has been waited for, once it is compiled."""
        self._check_open()
        waiting = self._waiting
        if waiting is not None and self._compiler.is_idle:
            self._compiler.compile(waiting)
            self._show(waiting)

    def _film(self) -> FilmRun:
        """Return the film of the scene that is shown, metered."""
        self._arrive()
        if self._run is None:
            plan, buffers = self._film_plan()
            scene = self._shown.scene
            wavefront = self._compiler.pool.wavefront(plan, buffers, FilmLayout.of(scene.film), scene.render, "film")
            self._run = FilmRun(wavefront, scene.render.noise)
        return self._run

    def _film_plan(self) -> tuple[Plan, SceneBuffers]:
        """Return the plan of the film of what is shown, and its arrays."""
        if self._of_film is None:
            if not self._shown.is_final:
                self._shown = self._compiler.final(self._shown)
                self._reading = self._shown.resolved.metered_cd_m2
            self._of_film = self._compiler.of_film(self._shown)
        return self._of_film

    def _noise_of(self, run: FilmRun, sums: NDArray[np.float32]) -> float | None:
        """The relative standard error of the film with these sums; None for less than two samples.

        It is estimated whenever the samples have doubled, as that takes long, and scaled between.
        """
        if run.is_whole and run.done >= 2 * self._noise_spp:
            achieved = run.watch.achieved(run.done, sums)
            self._noise = None if achieved is None else achieved["picture"]
            self._noise_spp = 1 if achieved is None else run.done
        return None if self._noise is None else float(self._noise * np.sqrt(self._noise_spp / run.done))

    def _add(self, run: FilmRun, samples: int, should_stop: Callable[[], bool] = lambda: False) -> bool:
        """Add samples to a film unless that is cancelled; return whether all are there."""
        self._cancelled.clear()

        def stops() -> bool:
            return self._cancelled.is_set() or should_stop()

        end = run.done + samples
        count, most = self._queue.count_waves(run.wavefront.finish, stops), run.wavefront.samples_per_wave
        complete = True
        while complete and run.done < end and not run.watch.satisfied:
            complete = run.add(min(end - run.done, most), count, slots=self._queue.slots)
            complete = complete and not (stops() and run.done < end)
        run.wavefront.finish()
        return complete
