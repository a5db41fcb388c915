"""The stages of a render: prepare (focus, camera model, exposure, plan, kernels), run, report."""

from __future__ import annotations

import json
import math
import os
import re
import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, NumericError
from rptcam_cl.device.session import NotKeptError, Session, Split, Wanted, means_all, open_sessions
from rptcam_cl.imaging.development import GUIDES, check_denoiser
from rptcam_cl.imaging.image import Image, with_picture_settings
from rptcam_cl.imaging.sensor import check_sensor, sensor_of
from rptcam_cl.imaging.truth_files import NAMES, ranked
from rptcam_cl.rendering.account import (
    GEOMETRY,
    anomalies,
    described,
    described_before,
    lens_margin,
    of_makers,
    statistics,
    window,
)
from rptcam_cl.rendering.checkpoint import Saver
from rptcam_cl.rendering.diffraction import Diffraction, diffracted, diffraction_of
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.ghosts import Ghosting, ghosting_of, has_ghosts
from rptcam_cl.rendering.ground_truth import GroundTruth, ground_truth_of
from rptcam_cl.rendering.highlights import aimed_plan
from rptcam_cl.rendering.metering import resolve_exposure
from rptcam_cl.rendering.passes import signature
from rptcam_cl.rendering.plan.plan import Plan, make_plan
from rptcam_cl.rendering.plan.primitives import PlanParts
from rptcam_cl.rendering.progressive import Progress, Rendering, SavedState, render_plan, rendering_of
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from rptcam_cl.rendering.several import (
    WHOLE,
    AnyWavefront,
    FilmPart,
    Part,
    SharedWavefront,
    joined,
    split_of,
    split_text,
)
from rptcam_cl.rendering.tracer import SMALL, Compiler, Wavefront, WavefrontPool, order
from rptcam_cl.scene.camera import RealisticCamera
from rptcam_cl.scene.film import ADAPTIVE_SPP, MAX_SPP, LayerName, RenderSettings
from rptcam_cl.scene.load import at_rest, change_scene, exposure_steps, load_scene
from rptcam_cl.scene.scene import Scene

# What a render takes beside its scene.


@dataclass(frozen=True)
class RenderOptions:
    """The keyword arguments of `render`, which explains each.

    Raises
    ------
    InputError
        ``seconds`` is no time.
    """

    spp: int | None = None
    seconds: float | None = None
    seed: int | None = None
    size: tuple[int, int] | None = None
    crop: tuple[float, float, float, float] | None = None
    layers: Sequence[str] | None = None
    denoise: bool = False
    noise: float | None = None
    checkpoint: str | os.PathLike[str] | None = None
    resume: bool = False
    allow_mixed: bool = False
    device: Wanted = None
    split: Split | None = None
    wave_size: int | None = None
    numerics: bool = False
    strict: bool = False
    part: str | None = None
    samples: tuple[int, int] | None = None
    neighbours: tuple[Scene | None, Scene | None] | None = None
    on_progress: Callable[[Progress], Any] | None = None
    should_stop: Callable[[], bool] | None = None

    def __post_init__(self) -> None:
        if self.seconds is not None and not 0 < self.seconds < math.inf:
            raise InputError(f"seconds: is out of range (got {self.seconds!r}; allowed: a finite number above 0)")
        if self.film_part == WHOLE:
            return
        given = {"seconds": self.seconds, "noise": self.noise, "denoise": self.denoise or None}
        for name, value in given.items():
            if value is not None:
                raise InputError(f"{name}: needs the whole film (allowed: without part and samples)")
        if self.samples is not None and self.spp is not None:
            raise InputError("spp: does not go with samples, which say where they end (allowed: one of the two)")

    @property
    def film_part(self) -> FilmPart:
        """The tiles and samples that are rendered.

        Raises
        ------
        InputError
            ``part`` or ``samples`` is none.
        """
        number, count = (1, 1) if self.part is None else _numbers(self.part)
        first, end = self.samples or (0, None)
        if end is not None and not 0 <= first < end < MAX_SPP:
            raise InputError(f"samples: are out of range (got {first}:{end}; allowed: as 0:64)")
        return FilmPart(number, count, first, end)

    @property
    def keeps_state(self) -> bool:
        """Whether the state of the render is kept at its end: to go on from it, or to be merged."""
        return self.resume or self.part is not None or self.samples is not None

    def applied_to(self, scene: Scene) -> Scene:
        """Return the scene with the keys that the settings replace."""
        render = {"spp": self.spp, "seed": self.seed, "layers": self.layers, "noise": self.noise}
        film = {"resolution": self.size, "crop": self.crop}
        keys: dict[str, dict[str, Any]] = {"render": render, "film": film}
        given = {part: {key: value for key, value in of.items() if value is not None} for part, of in keys.items()}
        return change_scene(scene, **given) if any(given.values()) else scene

    def most_spp(self, scene: Scene) -> int | None:
        """Return the sample to end before: of ``samples`` or ``spp``, else none for ``seconds``, else the scene's."""
        if self.samples is not None:
            return self.samples[1]
        if self.spp is not None:
            return self.spp
        if self.noise is not None:
            return ADAPTIVE_SPP
        return None if self.seconds is not None else scene.render.most_spp

    def soonest(self, scene: Scene, sessions: list[Session]) -> list[Session]:
        """Return the devices, with programs that compile soonest where few samples are all that is to be taken."""
        spp, takes_more = self.most_spp(scene), scene.requested_autofocus is not None or has_ghosts(scene)
        if spp is None or scene.render.noise is not None or takes_more or len(sessions) > 1:
            return sessions
        return [sessions[0].for_samples(spp * FilmLayout.of(scene.film).pixels)]


def _numbers(part: str) -> tuple[int, int]:
    """Return number and count of a part such as ``3/8``."""
    match = re.fullmatch(r"(\d{1,9})/(\d{1,9})", part, re.ASCII)
    number, count = (int(match[1]), int(match[2])) if match else (0, 0)
    if not 1 <= number <= count:
        raise InputError(f"part: is none (got {part}; allowed: as 3/8, from 1/8 to 8/8)")
    return number, count


# Kernels compiled ahead of the picture that needs them, on the spot or in the background.


class Ahead:
    """Compiles what plans need, and knows what is compiled.

    In the background, a process apart compiles first where the driver would stop the device for it.

    Parameters
    ----------
    device
        The device.
    """

    def __init__(self, device: Session) -> None:
        self._device = device
        self._done: set[tuple[Any, ...]] = set()
        self._failed: set[tuple[Any, ...]] = set()  # in the background
        self._missing: set[tuple[Any, ...]] = set()  # of what the driver has kept
        self._under_way: dict[tuple[Any, ...], Future[None]] = {}
        self._threads = ThreadPoolExecutor(1, "rptcam-compile")
        self._compiler = Compiler()
        self._orders: dict[Hashable, Future[bool]] = {}

    @property
    def ready(self) -> bool:
        """Whether nothing is being compiled."""
        self._collect()
        return not self._under_way

    def knows(self, plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> bool:
        """Return whether a plan can be rendered at once."""
        self._collect()
        return key_of(plan, scene, settings) in self._done

    def compile(self, plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> None:
        """Compile what a plan needs, unless that is done."""
        key = key_of(plan, scene, settings)
        if key in self._under_way:
            self._under_way[key].result()
        self._collect()
        if key not in self._done:
            compile_here(self._device, plan, scene, settings)
            self._done.add(key)

    def takes_kept(self, plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> bool:
        """Return whether a plan can be rendered without the compiler: its kernels are there, or loaded now.

        So it is, too, where compiling them has failed, which is to be reported.
        """
        key = key_of(plan, scene, settings)
        self._collect()
        if key in self._done or key in self._failed:
            return True
        if key in self._missing:
            return False
        try:
            compile_here(self._device.kept_only(), plan, scene, settings)
        except NotKeptError:
            self._missing.add(key)
            return False
        self._done.add(key)
        return True

    def begin(self, plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> None:
        """Compile it in the background; what fails there fails again when it is needed."""
        key = key_of(plan, scene, settings)
        if not self.knows(plan, scene, settings) and key not in self._under_way:
            for waiting in self._under_way.values():
                waiting.cancel()
            self._under_way[key] = self._threads.submit(self._compile_beside, plan, scene, settings)

    def is_carried_out(self, name: Hashable, order: Callable[[], bytes]) -> bool:
        """Return whether another process has carried out an order, successfully or not; it begins where it has not yet.

        Where the driver does not stop the device to compile, there is nothing to be gained by it.

        Parameters
        ----------
        name
            Of what the order compiles.
        order
            Returns what `Compiler.compile` takes.
        """
        if not self._device.generates_late:
            return True
        if name not in self._orders:
            self._orders[name] = self._threads.submit(self._compiler.compile, order())
        return self._orders[name].done()

    def close(self) -> None:
        """Begin nothing more; what a process apart compiles is given up."""
        self._compiler.close()
        self._threads.shutdown(wait=True, cancel_futures=True)

    def _compile_beside(self, plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> None:
        device = self._device.beside()
        if device.generates_late:
            wanted = order(device, plan, scene, settings)
            if wanted is not None:
                self._compiler.compile(wanted)
        if not self._compiler.is_closed:
            compile_here(device, plan, scene, settings)

    def _collect(self) -> None:
        for key, future in list(self._under_way.items()):
            if future.done():
                del self._under_way[key]
                if not future.cancelled():
                    (self._done if future.exception() is None else self._failed).add(key)


def key_of(plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> tuple[Any, ...]:
    """Return what the kernels of a plan follow from."""
    return signature(plan, scene, SMALL, settings)


def compile_here(device: Session, plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> None:
    """Compile what a plan needs in this process."""
    Wavefront(device, plan, SMALL, settings, buffers=scene, scouts=False).warm_up()


# What renders a scene on its devices, made anew or taken over from the picture before.


class Kept:
    """What stays from one picture to the next on a device: wavefronts with their buffers, and parts of the plan."""

    def __init__(self, device: Session) -> None:
        self._pool, self.parts = WavefrontPool(device), PlanParts()

    def pool(self, plan: Plan, sessions: list[Session], settings: RenderOptions) -> WavefrontPool | None:
        """Return the wavefronts of which one may render a plan; None where it has to be another."""
        return None if len(sessions) > 1 or settings.checkpoint or settings.wave_size or plan.steps else self._pool


def wavefront_of(
    scene: Scene,
    plan: Plan,
    sessions: list[Session],
    shares: list[float] | None,
    settings: RenderOptions,
    buffers: SceneBuffers | None,
    pool: WavefrontPool | None,
) -> AnyWavefront:
    """Return what renders the scene, compiled and ready: on one device, or on several that share it.

    Parameters
    ----------
    buffers
        The scene on the first device, where it is there already.
    pool
        Where it is taken from, if it can be; the scene is there then.
    """
    layout = FilmLayout.of(scene.film)
    if pool is not None and buffers is not None:
        return pool.wavefront(plan, buffers, layout, scene.render, "film")
    if len(sessions) > 1:
        return SharedWavefront(
            sessions, plan, layout, scene.render, settings.wave_size, shares=shares, lenient=means_all(settings.device)
        )
    wavefront = Wavefront(sessions[0], plan, layout, scene.render, settings.wave_size, buffers=buffers)
    wavefront.warm_up()
    return wavefront


def saved_shares(parts: list[Part], sessions: list[Session]) -> list[float] | None:
    """Return the shares that the same devices had when the render was saved; None where they were others."""
    last = split_of(parts[-1]["split"]) if parts else {}
    ids = [session.info.id for session in sessions]
    return [last[identity] for identity in ids] if last.keys() == set(ids) else None


def devices_of(wavefront: AnyWavefront, first: int, done: int) -> list[Part]:
    """Return which device has taken which samples since a render began or went on after ``first``."""
    if isinstance(wavefront, SharedWavefront):
        return wavefront.parts(done)
    return [{"samples": [first, done], "split": split_text({wavefront.session.info.id: 1.0})}] if done > first else []


# The layers of an image: what its samples have recorded, under the names that files give it, and the sharp ones.


def truth_of(
    scene: Scene, plan: Plan, wavefront: AnyWavefront, layers: tuple[LayerName, ...], settings: RenderOptions
) -> GroundTruth | None:
    """Return the sharp layers of a resolved scene; None where it is to have none."""
    session = wavefront.session

    def buffers() -> SceneBuffers:
        return wavefront.scene_buffers if isinstance(wavefront, Wavefront) else SceneBuffers(session, plan)

    def as_rendered(frame: Scene | None) -> Scene | None:
        if frame is None:
            return None
        applied = settings.applied_to(frame)
        if applied.requested_autofocus is None:
            return applied
        from rptcam_cl.studies.focus.controller import in_focus  # few scenes have it, and its room takes long to import

        return in_focus(applied, session, None)[0]

    flows = settings.neighbours if {"flow_forward", "flow_backward"} & set(layers) else None
    neighbours = None if flows is None else (as_rendered(flows[0]), as_rendered(flows[1]))
    return ground_truth_of(scene, plan, session, buffers, layers, neighbours)


def named_layers(
    names: Sequence[LayerName],
    recorded: Mapping[str, NDArray[Any]],
    sharp: tuple[Mapping[str, NDArray[Any]], Mapping[str, Any]] | None,
    metadata: dict[str, Any],
) -> dict[str, NDArray[Any]]:
    """Return the layers of an image in their order; what the sharp ones have to say goes to the metadata.

    Parameters
    ----------
    names
        Those that it is to have.
    recorded
        Layers of the samples.
    sharp
        The sharp ones, and what they have to say.
    metadata
        Of the image, with the names of what identifiers stand for.
    """
    found = dict(recorded)
    for name, key in NAMES.items():
        if name in found:
            found[name] = ranked(found[name], metadata[key])
    if sharp is not None:
        found |= sharp[0]
        metadata |= sharp[1]
    return {name: found[name] for name in names}


@dataclass(frozen=True)
class Resolved:
    """A scene with all that it leaves to be found.

    Attributes
    ----------
    scene : Scene
        In focus, with its camera model and its exposure.
    metadata : dict
        How these were found.
    focus : dict or None
        What autofocus found, as `in_focus` takes it.
    metered_cd_m2 : float or None
        The luminance that the exposure follows from.
    diffraction : Diffraction or None
        What it does to the film; None where it is off.
    ghosts : Scene or None
        In focus, with the camera as requested; None where there are none.
    """

    scene: Scene
    metadata: dict[str, Any]
    focus: dict[str, Any] | None
    metered_cd_m2: float | None
    diffraction: Diffraction | None = None
    ghosts: Scene | None = None


def resolve(
    scene: Scene, session: Session, focus: dict[str, Any] | None = None, metered_cd_m2: float | None = None
) -> Resolved:
    """Return a scene in focus, with the camera model and the exposure that it leaves to be found.

    Parameters
    ----------
    focus, metered_cd_m2
        What was found before, to be kept.
    """
    sharp, still = scene, at_rest(scene)
    if still.requested_autofocus is not None:
        from rptcam_cl.studies.focus.controller import in_focus  # few scenes have it, and its room takes long to import

        focus = in_focus(still, session, focus)[1]
        sharp = in_focus(scene, session, focus)[0]
    diffraction, in_focus_with_lens = diffraction_of(sharp), sharp
    described_choice: dict[str, Any] = {}
    if isinstance(sharp.camera, RealisticCamera) and sharp.camera.accuracy is not None:
        from rptcam_cl.studies.tiers import choose_camera  # few scenes have a choice, and its room takes long to import

        choice = choose_camera(sharp)
        sharp, described_choice = choice.scene, choice.metadata
    exposed = resolve_exposure(sharp, session, metered_cd_m2)
    metadata = exposed.metadata | described_choice | ({} if focus is None else focus["metadata"])
    metadata |= {} if diffraction is None else {"diffraction": diffraction.metadata}
    ghosts = in_focus_with_lens if has_ghosts(in_focus_with_lens) else None
    metadata |= {} if ghosts is None else {"ghosts": {"on": True}}
    return Resolved(exposed.scene, metadata, focus, exposed.metered_cd_m2, diffraction, ghosts)


@dataclass(frozen=True)
class Prepared:
    """A scene that is ready to be rendered.

    Attributes
    ----------
    settings : RenderSettings
    scene : Scene
        As requested: with the settings applied, and with the layers that a denoiser needs.
    layers : tuple of str
        Those that the image is to have.
    resolved : Scene
        In focus, with its camera model and its exposure.
    metadata : dict
        How focus, camera model and exposure were found.
    plan : Plan
    wavefront : AnyWavefront
        Compiled for the devices.
    saver, saved
        The checkpoint and the state in it, where there are any.
    begun : float
        When preparing began, by `time.perf_counter` [s].
    seconds : dict
        What preparing took: ``start`` and ``compile`` [s].
    diffraction : Diffraction or None
        What is done to the film after its samples.
    ghosting : Ghosting or None
        What is added to it before.
    truth : GroundTruth or None
        The sharp layers.
    """

    settings: RenderOptions
    scene: Scene
    layers: tuple[str, ...]
    resolved: Scene
    metadata: dict[str, Any]
    plan: Plan
    wavefront: AnyWavefront
    saver: Saver | None
    saved: SavedState | None
    begun: float
    seconds: dict[str, float]
    diffraction: Diffraction | None = None
    ghosting: Ghosting | None = None
    truth: GroundTruth | None = None


def prepare(
    scene: Scene | str | Path | Mapping[str, Any], settings: RenderOptions, kept: Kept | None = None
) -> Prepared:
    """Return a scene, or anything that `load_scene` takes, ready to be rendered.

    Parameters
    ----------
    kept
        Of the pictures before: what is prepared is good until it is given to the next.

    Raises
    ------
    InputError, DeviceError, StateError
        As `render` does.
    """
    begun = time.perf_counter()
    # Check what can be checked before any device is opened
    scene = settings.applied_to(scene if isinstance(scene, Scene) else load_scene(scene))
    check_sensor(scene, *window(scene)[2:])
    _check_part(scene, settings)
    exposure_steps(scene)
    layers = scene.render.layers
    if settings.denoise:
        check_denoiser()
        scene = change_scene(scene, render={"layers": tuple(dict.fromkeys((*layers, *GUIDES)))})

    # Open the devices, and the state of an earlier render
    sessions, shares = open_sessions(settings.device, settings.split)
    saver = None
    if settings.checkpoint is not None:
        names = [session.info.name for session in sessions]
        drivers = [session.info.driver for session in sessions]
        saver = Saver(settings.checkpoint, scene, names, drivers, settings.film_part, allow_mixed=settings.allow_mixed)
    saved = saver.load() if saver is not None and settings.resume else None

    # Resolve what the scene leaves open, plan, compile
    sessions = settings.soonest(scene, sessions) if kept is None else sessions  # of a series that is to take many
    found = resolve(scene, sessions[0]) if saver is None else _resolved_as_saved(scene, sessions[0], saver)
    plan = make_plan(found.scene, parts=None if kept is None else kept.parts)
    pool = None if kept is None else kept.pool(plan, sessions, settings)
    there = None if pool is None else pool.upload(plan)
    plan, buffers = aimed_plan(plan, sessions[0], scene.render.layers, there)
    if saver is not None:
        saver.of_picture = of_picture(scene, found, plan, settings)
    started = time.perf_counter()
    if settings.on_progress is not None:
        settings.on_progress(Progress("compile", 0, scene.render.spp, 0.0, 0.0, None))
    if shares is None and saver is not None:
        shares = saved_shares(saver.parts, sessions)
    wavefront = wavefront_of(scene, plan, sessions, shares, settings, buffers or there, pool)
    if saver is not None:
        first = settings.film_part.first if saved is None else saved.done
        saver.parts_since = lambda done: devices_of(wavefront, first, done)
    ghosting = ghosting_of(found.ghosts, plan, wavefront.session)
    truth = truth_of(found.scene, plan, wavefront, layers, settings)
    if saver is not None:
        of_part = (None, None) if settings.film_part == WHOLE else (ghosting, truth)
        saver.beside = partial(arrays_beside, found.diffraction, *of_part)
    seconds = {"start": started - begun, "compile": time.perf_counter() - started}
    return Prepared(
        settings, scene, layers, found.scene, found.metadata, plan, wavefront, saver, saved, begun, seconds,
        found.diffraction, ghosting, truth,
    )  # fmt: skip


def arrays_beside(*makers: Diffraction | Ghosting | GroundTruth | None) -> dict[str, Any]:
    """Return what `merge` needs beside the samples of a part."""
    return {name: array for each in makers if each is not None for name, array in each.arrays().items()}


def run(prepared: Prepared) -> Rendering:
    """Return the film of a prepared scene, rendered to its end or until it is stopped."""
    settings, saver = prepared.settings, prepared.saver
    return render_plan(
        prepared.wavefront,
        spp=settings.most_spp(prepared.scene),
        seconds=settings.seconds,
        has_lens=prepared.plan.camera.has_lens,
        noise=prepared.scene.render.noise,
        part=settings.film_part,
        saved=prepared.saved,
        save=None if saver is None else saver.save_now_and_then,
        on_progress=None if settings.on_progress is None else _with_image(prepared, settings.on_progress),
        should_stop=settings.should_stop,
    )


def _with_image(prepared: Prepared, on_progress: Callable[[Progress], Any]) -> Callable[[Progress], None]:
    """Return a listener that passes on progress with the image so far."""

    def listener(progress: Progress) -> None:
        on_progress(replace(progress, image=lambda: picture_so_far(prepared, progress)))

    return listener


def picture_so_far(prepared: Prepared, progress: Progress) -> Image:
    """Return the image of a render under way from its latest `Progress`, not denoised: each pixel by its samples."""
    assert progress.film is not None, "the render has begun"
    film = progress.film
    film.wavefront.finish()
    rendering = rendering_of(
        film, start=progress.samples_at_start, seconds=progress.seconds, new_samples=film.wavefront.camera_rays,
        interrupted=False,
    )  # fmt: skip
    plain = replace(prepared.settings, denoise=False, strict=False, numerics=False)
    return report(replace(prepared, settings=plain, saver=None), rendering)


def report(prepared: Prepared, rendering: Rendering) -> Image:
    """Return the image of a rendering with its metadata and statistics.

    Raises
    ------
    NumericError
        With ``strict``; its ``image`` is the picture.
    """
    settings, saver = prepared.settings, prepared.saver
    total = time.perf_counter() - prepared.begun
    times = prepared.seconds | {"render": rendering.seconds, "total": total}
    measured = settings.numerics or settings.strict
    margin = lens_margin(prepared.resolved, prepared.wavefront.session) if measured else None
    first = settings.film_part.first if prepared.saved is None else prepared.saved.done
    parts = devices_of(prepared.wavefront, first, rendering.done)
    work = joined([] if saver is None else saver.parts, parts)
    stats = statistics(prepared.plan, prepared.wavefront, rendering, times, margin) | {"work": work}
    metadata = described(prepared.scene, prepared.plan, rendering.spp, stats, prepared.metadata)
    if (sensor := sensor_of(prepared.resolved, metadata)) is not None:
        metadata["sensor"] = sensor.described()
    if rendering.interrupted:
        metadata["interrupted"] = True
    if saver is not None:
        metadata |= {"device": saver.devices} | of_makers(saver.makers)
    stats["camera"] = {key: metadata[key] for key in GEOMETRY if key in metadata}
    stats |= {key: metadata[key] for key in ("accuracy", "autofocus") if key in metadata}
    sharp = None if prepared.truth is None else prepared.truth.found
    layers = named_layers(prepared.scene.render.layers, rendering.layers, sharp, metadata)
    image = with_picture_settings(Image(rendering.pixels, metadata, stats, layers=layers), prepared.scene.picture)
    if settings.denoise:
        image = replace(image.denoised(), layers={name: image[name] for name in prepared.layers})
    if prepared.ghosting is not None:
        image = with_ghosts(image, *prepared.ghosting.found)
    image = replace(image, pixels=diffracted(prepared.diffraction, image.pixels))
    if saver is not None:  # once the picture is whole: until then the saved state is all that there is
        image.stats["checkpoint"] = saver.end(rendering.state, keep=settings.keeps_state or rendering.interrupted)
    if settings.strict and (faults := anomalies(stats["numerics"]) + _failed_focus(metadata)):
        raise NumericError(f"strict: {'; '.join(faults)}", image)
    return image


def with_ghosts(image: Image, light: NDArray[Any], said: dict[str, Any]) -> Image:
    """Return the image with the light of ghosts, and what is known of them."""
    light = light.astype(np.float32)
    if "barrel_share" in said:
        light = light + np.float32(said["barrel_share"] * image.pixels.mean(axis=(0, 1), dtype=np.float64))
    layers = dict(image.layers) | ({"ghosts": light} if "ghosts" in image.layers else {})
    metadata = dict(image.metadata) | {"ghosts": said}
    return replace(image, pixels=np.add(image.pixels, light, dtype=np.float32), layers=layers, metadata=metadata)


def _check_part(scene: Scene, settings: RenderOptions) -> None:
    """Refuse a part of a film that cannot be rendered alone."""
    part = settings.film_part
    part.check(FilmLayout.of(scene.film).tiles)
    if part != WHOLE:
        check_divisible(scene)


def check_divisible(scene: Scene) -> None:
    """Refuse a scene that cannot be rendered in parts."""
    if scene.render.noise is not None:
        raise InputError("part: a noise target needs the whole film (allowed: without render.noise)")
    if "variance" in scene.render.layers:
        raise InputError("part: the layer variance needs the whole film (allowed: the other layers)")


def of_picture(scene: Scene, found: Resolved, plan: Plan, settings: RenderOptions) -> dict[str, Any]:
    """Return what the picture of a saved render can be made with, without its scene."""
    metadata = described_before(scene, plan, found.metadata)
    if (sensor := sensor_of(found.scene, metadata)) is not None:
        metadata["sensor"] = sensor.described()
    if picture := scene.picture.model_dump(mode="json", exclude_defaults=True):
        metadata["picture"] = picture
    return {
        "metadata": json.loads(json.dumps(metadata, default=str)),
        "eye_m": plan.eye_m.tolist(),
        "has_lens": plan.camera.has_lens,
        "clamp": scene.render.clamp,
        "spp": settings.most_spp(scene),
    }


def _resolved_as_saved(scene: Scene, session: Session, saver: Saver) -> Resolved:
    """Return a resolved scene; what was found for an earlier part of the render is kept."""
    found = resolve(scene, session, saver.focus, saver.metered_cd_m2)
    saver.metered_cd_m2, saver.focus = found.metered_cd_m2, found.focus
    return found


def _failed_focus(metadata: Mapping[str, Any]) -> list[str]:
    """Return why autofocus failed; nothing where it did not."""
    failure = metadata.get("autofocus", {}).get("failure")
    return [] if failure is None else [f"autofocus: {failure}"]
