"""A render from its scene to its picture: options, focus and exposure, plan, kernels, samples, layers and metadata.

`render` does it by one call, and `merge` makes one picture of parts that were rendered anywhere.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.api.options import RenderOptions
from rptcam_cl.core.dataclass import dataclass, takes_options
from rptcam_cl.core.errors import InputError, NumericError, StateError
from rptcam_cl.core.files import check_writable, replacing
from rptcam_cl.device.session import Session, Wanted, means_all, open_session, open_sessions
from rptcam_cl.imaging import development, writers
from rptcam_cl.imaging.development import check_sensor, sensor_of
from rptcam_cl.imaging.image import Image, develop, folders_of_film, with_picture_settings
from rptcam_cl.optics.as_built import scattered
from rptcam_cl.rendering import account, several
from rptcam_cl.rendering.account import resolve_exposure
from rptcam_cl.rendering.cameras.setting import on_film
from rptcam_cl.rendering.checkpoint import SUFFIX, Saver, layout_of, merge_states, picture_of, write_checkpoint
from rptcam_cl.rendering.diffraction import Diffraction, describe_film, diffraction_of, spread_of
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.ghosts import Ghosting, ghosting_of, has_ghosts, saved_ghosts
from rptcam_cl.rendering.lamps import aimed_plan
from rptcam_cl.rendering.layers import GroundTruth, saved_truth
from rptcam_cl.rendering.plan.plan import Plan, make_plan
from rptcam_cl.rendering.plan.primitives import PlanParts
from rptcam_cl.rendering.point_waves import Conjugates
from rptcam_cl.rendering.progressive import Progress, Rendering, SavedState, render_plan, render_state, rendering_of
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from rptcam_cl.rendering.tracer import Wavefront, WavefrontPool
from rptcam_cl.scene.camera import plain_keys
from rptcam_cl.scene.changes import at_opening, at_rest, change_scene, exposure_steps, focus_keys, set_keys
from rptcam_cl.scene.film import LIGHT_LAYER, SHARP_LAYERS, LayerName
from rptcam_cl.scene.load import SceneSource, load_scene, plain_data, read_scene, scene_text
from rptcam_cl.scene.scene import Scene

# What a scene leaves to be found, and what its image is put together of.


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

    @property
    def conjugates(self) -> Conjugates | None:
        """What rays of the film go towards, as diffraction brings the aberrations; None for those of the lens."""
        return None if self.diffraction is None else self.diffraction.conjugates


def resolve(
    scene: Scene,
    session: Session,
    focus: dict[str, Any] | None = None,
    metered_cd_m2: float | None = None,
    held: dict[str, int] | None = None,
    spp: int | None = None,
) -> Resolved:
    """Find the focus, the camera model and the exposure that a scene leaves open.

    Parameters
    ----------
    focus, metered_cd_m2
        Those of an earlier part of the render, to be kept.
    held
        Facts of kernels by which the exposure is metered where they do; see `PlanParts`.
    spp
        Samples per pixel by which the camera model is chosen; by default the scene's.
    """
    sharp, still = scene, at_rest(scene)
    if still.requested_autofocus is not None:
        from rptcam_cl.studies.focus.controller import in_focus  # few scenes have it, and its room takes long to import

        focus = in_focus(still, session, focus)[1]
        sharp = in_focus(scene, session, focus)[0]
    sharp = on_film(sharp)
    diffraction, in_focus_with_lens = diffraction_of(sharp), sharp
    sharp, described_choice = _choose_camera(sharp, spp)
    exposed, metered_cd_m2, metadata = resolve_exposure(sharp, session, metered_cd_m2, held)
    metadata |= described_choice | ({} if focus is None else focus["metadata"])
    metadata |= {} if diffraction is None else {"diffraction": diffraction.metadata}
    ghosts = in_focus_with_lens if has_ghosts(in_focus_with_lens) else None
    metadata |= {} if ghosts is None else {"ghosts": {"on": True}}
    return Resolved(exposed, metadata, focus, metered_cd_m2, diffraction, ghosts)


def _leaves_open(scene: Scene) -> bool:
    """Whether a scene leaves its focus, its camera model or its exposure to be found."""
    traced = scene.camera.traced_camera
    has_choice = traced is not None and traced.accuracy is not None
    return has_choice or scene.requested_autofocus is not None or scene.exposure.mode == "auto"


def _choose_camera(scene: Scene, spp: int | None = None) -> tuple[Scene, dict[str, Any]]:
    """Return a scene in focus with the camera model that its accuracy asks for, and what metadata say of the choice."""
    traced = scene.camera.traced_camera
    if traced is None or traced.accuracy is None:
        return scene, {}
    from rptcam_cl.studies.tiers import choose_camera  # few scenes have a choice, and its room takes long to import

    choice = choose_camera(change_scene(scene, render={"spp": spp or scene.render.spp}))
    return change_scene(choice.scene, render={"spp": scene.render.spp}), choice.metadata


def check_divisible(scene: Scene) -> None:
    """Raise `InputError` if a scene cannot be rendered in parts."""
    if scene.render.noise is not None:
        raise InputError("part: a noise target needs the whole film (allowed: without render.noise)")
    if "variance" in scene.render.layers:
        raise InputError("part: the layer variance needs the whole film (allowed: the other layers)")


def _name_layers(
    names: Sequence[LayerName],
    recorded: Mapping[str, NDArray[Any]],
    sharp: tuple[Mapping[str, NDArray[Any]], Mapping[str, Any]] | None,
    metadata: dict[str, Any],
) -> dict[str, NDArray[Any]]:
    """Put the layers of an image in their order; the metadata of the sharp ones go to those of the image.

    Parameters
    ----------
    names
        Those that it is to have.
    recorded
        Layers of the samples.
    sharp
        The sharp ones, and their metadata.
    metadata
        Of the image, with the names of what identifiers stand for.
    """
    named = dict(recorded)
    for name, key in writers.NAMES.items():
        if name in named:
            named[name] = writers.ranked(named[name], metadata[key])
    if sharp is not None:
        named |= sharp[0]
        metadata |= sharp[1]
    lights = {name: values for name, values in named.items() if name.startswith(LIGHT_LAYER)}
    return {name: named[name] for name in names if name != "lights"} | lights


def with_ghosts(image: Image, light: NDArray[Any], said: dict[str, Any]) -> Image:
    """Add the light of ghosts to an image, and their metadata."""
    light = light.astype(np.float32)
    if "barrel_share" in said:
        light = light + np.float32(said["barrel_share"] * image.pixels.mean(axis=(0, 1), dtype=np.float64))
    direct = image.pixels
    if scatter := said.get("scatter"):
        glow = scattered(direct, **scatter["front"]).astype(np.float32)
        if lost := scatter["share"] * float(direct.sum(dtype=np.float64)):
            said = said | {"scatter": scatter | {"on_film": float(glow.sum(dtype=np.float64)) / lost}}
        light, direct = light + glow, direct * np.float32(1.0 - scatter["share"])
    layers = dict(image.layers) | ({"ghosts": light} if "ghosts" in image.layers else {})
    metadata = dict(image.metadata) | {"ghosts": said}
    return replace(image, pixels=np.add(direct, light, dtype=np.float32), layers=layers, metadata=metadata)


# A render: it is prepared once, takes its samples at one go or part by part, and its picture is reported.


class RenderJob:
    """A scene in focus and exposed, planned and compiled, that samples can be taken of.

    Parameters
    ----------
    options
    scene
        As requested: with the options applied, and with the layers that a denoiser needs.
    resolved
        The scene in focus, with its camera model and its exposure.
    plan
    wavefront
        Compiled for the devices.
    begun
        When preparing began, by `time.perf_counter` [s].
    layers
        Those that the image is to have; by default the scene's.
    saver, saved
        The checkpoint and the state in it, where there are any.
    ghosting
        Of an earlier picture of the same plan.

    Attributes
    ----------
    ghosting : Ghosting or None
    seconds : dict
        What preparing took: ``start`` and ``compile`` [s].
    """

    def __init__(
        self,
        options: RenderOptions,
        scene: Scene,
        resolved: Resolved,
        plan: Plan,
        wavefront: several.AnyWavefront,
        *,
        begun: float,
        layers: tuple[LayerName, ...] | None = None,
        saver: Saver | None = None,
        saved: SavedState | None = None,
        ghosting: Ghosting | None = None,
    ) -> None:
        self.options, self.scene, self.resolved, self.plan, self.wavefront = options, scene, resolved, plan, wavefront
        self.layers = scene.render.layers if layers is None else layers
        self.saver, self.saved = saver, saved
        self._begun, self.seconds = begun, {"start": 0.0, "compile": 0.0}
        self.ghosting = ghosting
        if ghosting is None and resolved.ghosts is not None:
            self.ghosting = ghosting_of(resolved.ghosts, plan, wavefront.session.beside())
        found = resolved.diffraction
        beside = None if found is None else wavefront.session.beside()
        self._diffraction = None if found is None else replace(found, plan=plan, session=beside)
        self._truth = self._ground_truth()
        if saver is not None:
            saver.of_picture = self._of_picture()
            saver.parts_since = lambda done: devices_of(wavefront, self.first, done)
            saver.beside = partial(self._arrays_beside, whole=options.film_part == several.WHOLE)

    @classmethod
    def prepare(
        cls, source: SceneSource, options: RenderOptions | None = None, series: SeriesRenderer | None = None
    ) -> Self:
        """Make a render of a scene, or of anything that `load_scene` takes, ready for its samples.

        Parameters
        ----------
        series
            What was prepared of it before is good until this one is.

        Raises
        ------
        InputError, DeviceError, StateError
            As `render` does.
        """
        begun, options = time.perf_counter(), options or RenderOptions()
        # Check what can be checked before any device is opened
        scene = scene_of(source, options)
        _check_options(options, scene)
        layers = scene.render.layers
        if options.denoise:
            scene = change_scene(scene, render={"layers": tuple(dict.fromkeys((*layers, *development.GUIDES)))})

        # Make the camera, which `make_plan` finds: a thread may still be opening the device
        parts = PlanParts() if series is None else series.parts
        if series is None and not _leaves_open(scene):
            parts.camera(at_opening(on_film(scene)), coarse=False)

        # Open the devices, and the state of an earlier render
        sessions, shares = open_sessions(options.device, options.split)
        saver = None if options.checkpoint is None else _saver(options.checkpoint, scene, sessions, options)
        saved = saver.load() if saver is not None and options.resume else None

        # Resolve what the scene leaves open, plan, compile
        if series is None:  # one that is to take many samples has the full kernels
            sessions = _with_fast_compile(options, scene, sessions)
        resolved = _resolve_for(saver, scene, sessions[0])
        plan = make_plan(resolved.scene, parts=parts)
        pool = None if series is None or plan.steps else series.pool
        uploaded = None if pool is None else pool.upload(plan)
        plan, buffers = aimed_plan(plan, sessions[0], scene.render.layers, uploaded, resolved.conjugates)
        started = time.perf_counter()
        if options.on_progress is not None:
            options.on_progress(Progress("compile", 0, scene.render.spp, 0.0, 0.0, None))
        buffers = buffers or uploaded
        wavefront: several.AnyWavefront
        if pool is not None and buffers is not None:
            wavefront = pool.wavefront(plan, buffers, FilmLayout.of(scene.film), scene.render, "film")
        else:
            if shares is None and saver is not None and len(sessions) > 1:
                shares = _saved_shares(saver.parts, sessions)
            wavefront = _compile(sessions, shares, plan, scene, buffers, options)
        job = cls(options, scene, resolved, plan, wavefront, begun=begun, layers=layers, saver=saver, saved=saved)
        job.seconds = {"start": started - begun, "compile": time.perf_counter() - started}
        return job

    @classmethod
    def prepare_parts(
        cls, source: SceneSource, options: RenderOptions, measured: Mapping[str, Any] | None = None
    ) -> Self:
        """Make a render ready of which `part` takes one part after the other, on one device.

        Parameters
        ----------
        measured
            Focus and exposure as another render's `findings` has them; else they are found here.

        Raises
        ------
        InputError, DeviceError
            As `render` does.
        """
        begun = time.perf_counter()
        scene = scene_of(source, options)
        check_divisible(scene)
        assert options.device is None or isinstance(options.device, str), "a worker has one device"
        session = open_session(options.device)
        saver = _saver(f"part{SUFFIX}", scene, [session], RenderOptions())
        resolved = _resolve_for(saver, scene, session, measured)
        plan = make_plan(resolved.scene)
        plan, buffers = aimed_plan(plan, session, scene.render.layers, None, resolved.conjugates)
        wavefront = _compile([session], None, plan, scene, buffers, RenderOptions())
        job = cls(options, scene, resolved, plan, wavefront, begun=begun, saver=saver)
        saver.beside = partial(job._arrays_beside, whole=False)
        return job

    @property
    def first(self) -> int:
        """The first sample of each pixel that is taken here."""
        return self.options.film_part.first if self.saved is None else self.saved[0]

    @property
    def findings(self) -> dict[str, Any]:
        """The focus and the exposure that were found, for all parts of a film."""
        return {"focus": self.resolved.focus, "metered_cd_m2": self.resolved.metered_cd_m2}

    def forecast(self, measure_s: float = account.MEASURED_SECONDS) -> account.Forecast | None:
        """What the samples take, by a measurement that spoils the film; None where only time ends them."""
        end = self.options.most_spp(self.scene)
        if end is None:
            return None
        return account.forecast(self.wavefront, min(self.first, end), end, self.options.film_part, measure_s)

    def run(self) -> Rendering:
        """Add all samples, unless it is stopped before."""
        options, saver = self.options, self.saver
        return render_plan(
            self.wavefront,
            spp=options.most_spp(self.scene),
            seconds=options.seconds,
            has_lens=self.plan.camera.has_lens,
            noise=self.scene.render.noise,
            part=options.film_part,
            saved=self.saved,
            save=None if saver is None else saver.save_now_and_then,
            on_progress=None if options.on_progress is None else self._report_progress,
            should_stop=options.should_stop,
        )

    def part(self, part: several.FilmPart) -> tuple[bytes, float]:
        """Render a part of the film; the content of its file for `rptcam_cl.merge`, and how long it took [s]."""
        begun, wavefront, end = time.perf_counter(), self.wavefront, self.options.most_spp(self.scene)
        assert self.saver is not None and end is not None and isinstance(wavefront, Wavefront), "of `prepare_parts`"
        wavefront.clear()
        wavefront.choose_tiles(part.tiles(wavefront.layout.tiles))
        state = render_state(wavefront, end, part)
        self.saver.parts_since = lambda done: devices_of(wavefront, part.first, done)
        return self.saver.content(state, part), time.perf_counter() - begun

    def snapshot(self, progress: Progress) -> Image:
        """The image so far, by the latest `Progress`, not denoised: each pixel by its samples."""
        assert progress.film is not None, "the render has begun"
        film = progress.film
        film.wavefront.finish()
        rendering = rendering_of(
            film, start=progress.samples_at_start, seconds=progress.seconds, new_samples=film.wavefront.camera_rays,
            interrupted=False,
        )  # fmt: skip
        return self._image(rendering, replace(self.options, denoise=False, numerics=False, strict=False), None)

    def report(self, rendering: Rendering) -> Image:
        """The image of a rendering with its metadata and statistics; its checkpoint ends.

        Raises
        ------
        NumericError
            With ``strict``; its ``image`` is the picture.
        """
        options, saver = self.options, self.saver
        image = self._image(rendering, options, saver)
        if saver is not None:  # once the picture is whole: until then the saved state is all that there is
            image.stats["checkpoint"] = saver.end(rendering.state, keep=options.keeps_state or rendering.interrupted)
        if options.strict:
            failure = image.metadata.get("autofocus", {}).get("failure")
            faults = account.anomalies(image.stats["numerics"]) + ([] if failure is None else [f"autofocus: {failure}"])
            if faults:
                raise NumericError(f"strict: {'; '.join(faults)}", image)
        return image

    def later(self, rendering: Rendering) -> Callable[[], Image]:
        """Read the film now; return what adds ghosts and diffraction, which take long, in any thread."""
        image = self._film_image(rendering, self.options, None)
        return lambda: self._with_optics(image)

    def _image(self, rendering: Rendering, options: RenderOptions, saver: Saver | None) -> Image:
        return self._with_optics(self._film_image(rendering, options, saver))

    def _film_image(self, rendering: Rendering, options: RenderOptions, saver: Saver | None) -> Image:
        total = time.perf_counter() - self._begun
        times = self.seconds | {"render": rendering.seconds, "total": total}
        is_measured = options.numerics or options.strict
        margin = account.lens_margin(self.resolved.scene, self.wavefront.session) if is_measured else None
        parts = devices_of(self.wavefront, self.first, rendering.done)
        work = several.join_parts([] if saver is None else saver.parts, parts)
        stats = account.statistics(self.plan, self.wavefront, rendering, times, margin) | {"work": work}
        metadata = account.describe(self.scene, self.plan, rendering.spp, stats, self.resolved.metadata)
        self._describe_sensor(metadata)
        if rendering.interrupted:
            metadata["interrupted"] = True
        if saver is not None:
            metadata |= {"device": saver.devices} | account.of_makers(saver.makers)
        stats["camera"] = {key: metadata[key] for key in account.GEOMETRY if key in metadata}
        stats |= {key: metadata[key] for key in ("accuracy", "autofocus") if key in metadata}
        sharp = None if self._truth is None else self._truth.result
        layers = _name_layers(self.scene.render.layers, rendering.layers, sharp, metadata)
        image = with_picture_settings(Image(rendering.pixels, metadata, stats, layers=layers), self.scene.picture)
        if options.denoise:
            kept = image.layers if self.plan.light_groups.names else self.layers  # films lit anew are denoised anew
            image = replace(image.denoised(), layers={name: image[name] for name in image.layers if name in kept})
        return image

    def _with_optics(self, image: Image) -> Image:
        if self.ghosting is not None:
            image = with_ghosts(image, *self.ghosting.result)
        if self._diffraction is None:
            return image
        pixels, said = self._diffraction.over(image.pixels)
        return replace(image, pixels=pixels, metadata=describe_film(image.metadata, said))

    def _report_progress(self, progress: Progress) -> None:
        assert self.options.on_progress is not None
        self.options.on_progress(replace(progress, image=lambda: self.snapshot(progress)))

    def _describe_sensor(self, metadata: dict[str, Any]) -> None:
        if (sensor := sensor_of(self.resolved.scene, metadata)) is not None:
            metadata["sensor"] = sensor.described()

    def _of_picture(self) -> dict[str, Any]:
        """What the picture of a saved render can be made with, without its scene."""
        scene = self.scene
        metadata = account.describe_before(scene, self.plan, self.resolved.metadata)
        self._describe_sensor(metadata)
        if picture := scene.picture.model_dump(mode="json", exclude_defaults=True):
            metadata["picture"] = picture
        return {
            "metadata": json.loads(json.dumps(metadata, default=str)),
            "eye_m": self.plan.eye_m.tolist(),
            "has_lens": self.plan.camera.has_lens,
            "clamp": scene.render.clamp,
            "light_groups": list(self.plan.light_groups.names),
            "spp": self.options.most_spp(scene),
        }

    def _arrays_beside(self, *, whole: bool) -> dict[str, Any]:
        """What `merge` needs beside the samples; of a part also the ghosts and the sharp layers."""
        makers = (self._diffraction, *((None, None) if whole else (self.ghosting, self._truth)))
        return {name: array for each in makers if each is not None for name, array in each.arrays().items()}

    def _ground_truth(self) -> GroundTruth | None:
        """The sharp layers; None where the image is to have none."""
        names = tuple(name for name in self.layers if name in SHARP_LAYERS)
        if not names:
            return None
        wavefront, session = self.wavefront, self.wavefront.session

        def buffers() -> SceneBuffers:
            return wavefront.scene_buffers if isinstance(wavefront, Wavefront) else SceneBuffers(session, self.plan)

        def as_rendered(frame: SceneSource | None) -> Scene | None:
            if frame is None:
                return None
            applied = self.options.apply_to(read_scene(frame))
            if applied.requested_autofocus is not None:
                from rptcam_cl.studies.focus.controller import in_focus  # few scenes have it, and it imports much

                applied = in_focus(applied, session, None)[0]
            return _choose_camera(on_film(applied), None if self.saver is None else self.saver.spp)[0]

        flows = self.options.neighbours if {"flow_forward", "flow_backward"} & set(self.layers) else None
        neighbours = None if flows is None else (as_rendered(flows[0]), as_rendered(flows[1]))
        return GroundTruth(self.resolved.scene, names, self.plan, session, buffers, neighbours)


def scene_of(source: SceneSource, options: RenderOptions) -> Scene:
    """Read a scene and apply the options; its sensor is checked.

    Raises
    ------
    InputError, StateError
        The scene cannot be read, or does not take them.
    """
    scene = options.apply_to(read_scene(source))
    check_sensor(scene, *account.window(scene)[2:])
    return scene


def _with_fast_compile(options: RenderOptions, scene: Scene, sessions: list[Session]) -> list[Session]:
    """Return the devices, with programs that compile fast where few samples are all that is to be taken."""
    spp, takes_more = options.most_spp(scene), scene.requested_autofocus is not None or has_ghosts(scene)
    if spp is None or scene.render.noise is not None or takes_more or len(sessions) > 1:
        return sessions
    return [sessions[0].for_samples(spp * FilmLayout.of(scene.film).pixels)]


def _saver(path: str | os.PathLike[str], scene: Scene, sessions: Sequence[Session], options: RenderOptions) -> Saver:
    names, drivers = [session.info.name for session in sessions], [session.info.driver for session in sessions]
    return Saver(path, scene, names, drivers, options.film_part, allow_mixed=options.allow_mixed)


def _resolve_for(
    saver: Saver | None, scene: Scene, session: Session, measured: Mapping[str, Any] | None = None
) -> Resolved:
    """Resolve a scene; what was found for an earlier part of the render is kept."""
    if saver is None:
        resolved = resolve(scene, session)
    else:
        known = measured or {"focus": saver.focus, "metered_cd_m2": saver.metered_cd_m2}
        resolved = resolve(scene, session, **known, spp=saver.spp)
        saver.metered_cd_m2, saver.focus = resolved.metered_cd_m2, resolved.focus
    if "lights" in scene.render.layers:
        for what in ("diffraction", "ghosts"):
            if resolved.metadata.get(what, {}).get("on"):
                raise InputError(
                    f"render.layers: lights: {what} is light of all lamps together (allowed: camera.{what}: off)"
                )
    return resolved


def _check_options(options: RenderOptions, scene: Scene) -> None:
    """Raise an error for what can be known to fail before any device is opened."""
    options.film_part.check(FilmLayout.of(scene.film).tiles)
    if options.film_part != several.WHOLE:
        check_divisible(scene)
    exposure_steps(scene)
    if options.denoise:
        development.check_denoiser()


def _compile(
    sessions: list[Session],
    shares: list[float] | None,
    plan: Plan,
    scene: Scene,
    buffers: SceneBuffers | None,
    options: RenderOptions,
) -> several.AnyWavefront:
    """Compile the kernels of a plan for one device, or for several that share the render."""
    layout, size = FilmLayout.of(scene.film), options.wave_size
    if len(sessions) > 1:
        lenient = means_all(options.device)
        return several.SharedWavefront(sessions, plan, layout, scene.render, size, shares=shares, lenient=lenient)
    wavefront = Wavefront(sessions[0], plan, layout, scene.render, size, buffers=buffers)
    wavefront.warm_up()
    return wavefront


class SeriesRenderer:
    """Renders scenes on one device, each as `render` does; what they share stays there.

    Parameters
    ----------
    device
        The device.

    Attributes
    ----------
    plan : Plan or None
        That of the last picture.
    resolved : Scene or None
        That of the last picture, with its focus, camera model and exposure.
    pool, parts
        Wavefronts with their buffers, and parts of the plan, to be used again.
    """

    def __init__(self, device: Session) -> None:
        self.device = device
        self.plan: Plan | None = None
        self.resolved: Scene | None = None
        self.pool, self.parts = WavefrontPool(device), PlanParts()

    def render(self, scene: Scene) -> Image:
        """Take the picture of the camera of a scene."""
        job = RenderJob.prepare(scene, RenderOptions(device=self.device), self)
        self.plan, self.resolved = job.plan, job.resolved.scene
        return job.report(job.run())


def _saved_shares(parts: list[several.Part], sessions: list[Session]) -> list[float] | None:
    """The shares that the same devices had when the render was saved; None where they were others."""
    last = several.split_of(parts[-1]["split"]) if parts else {}
    ids = [session.info.id for session in sessions]
    return [last[identity] for identity in ids] if last.keys() == set(ids) else None


def devices_of(wavefront: several.AnyWavefront, first: int, done: int) -> list[several.Part]:
    """The samples that each device has taken since a render began or went on after ``first``."""
    if isinstance(wavefront, several.SharedWavefront):
        return wavefront.parts(done)
    split = several.split_text({wavefront.session.info.id: 1.0})
    return [{"samples": [first, done], "split": split}] if done > first else []


# A render by one call; a scene with all found once; and the picture of parts that were rendered anywhere.


@takes_options(RenderOptions)
def render(scene: SceneSource, **options: Any) -> Image:
    """Return the picture that the camera of a scene takes.

    Parameters
    ----------
    scene
        A scene, or anything that `load_scene` takes.
    **options
        Those of `RenderOptions`.

    Raises
    ------
    InputError
        Something in the scene or the arguments is wrong.
    DeviceError
        No device fits, or a kernel failed.
    StateError
        The checkpoint is damaged, of another render, or cannot be written.
    NumericError
        With ``strict``; its ``image`` is the picture.
    """
    given = RenderOptions(**options)
    job = RenderJob.prepare(scene, replace(given, neighbours=_frames_beside(given.neighbours)))
    return job.report(job.run())


def _frames_beside(
    neighbours: tuple[SceneSource | None, SceneSource | None] | None,
) -> tuple[Scene | None, Scene | None] | None:
    """Return the scenes of the frames before and after."""
    if neighbours is None:
        return None
    if not isinstance(neighbours, tuple | list) or len(neighbours) != 2:
        got = f"{len(neighbours)} of them" if isinstance(neighbours, tuple | list) else type(neighbours).__name__
        raise InputError(f"neighbours: must be the frames before and after (got {got}; allowed: two, None for none)")
    before, after = (None if frame is None else read_scene(frame) for frame in neighbours)
    return before, after


@dataclass(frozen=True)
class Settlement:
    """A scene with focus, camera model and exposure fixed, as `rptcam_cl.settle` returns it.

    Attributes
    ----------
    scene : dict
        The data of the scene, as `load_scene` takes them.
    found : tuple of str
        Focus, camera model and exposure, a sentence each; none where the scene left nothing open.
    """

    scene: dict[str, Any]
    found: tuple[str, ...]


def settle(scene: SceneSource, path: str | Path | None = None, *, device: Wanted = None) -> Settlement:
    """Return a scene with the focus, camera model and exposure that it leaves to be found, and write it to a file.

    Pictures of both scenes have the same bits.

    Parameters
    ----------
    scene
        A scene, or anything that `load_scene` takes.
    path
        Where to write it, as YAML; a scene that names files has to stay in its folder.
    device
        As for `render`; autofocus and metering run on it.

    Raises
    ------
    InputError, DeviceError, StateError
        As `render` does, and where the file cannot be written or its folder lacks the scene's files.
    """
    given = read_scene(scene)
    if path is not None:
        check_writable(path, [scene] if isinstance(scene, str | Path) else [])
        _check_folder(given, Path(path))
    sessions, _ = open_sessions(device)
    resolved = resolve(given, sessions[0])
    data = plain_data(set_keys(given, _keys(given, resolved)))
    notes = _notes(given, resolved)
    if path is not None:
        with replacing(path) as temporary:
            temporary.write_text(scene_text(data, ("Resolved by rptcam settle.", *notes)), encoding="utf-8")
    return Settlement(data, notes)


def _check_folder(scene: Scene, path: Path) -> None:
    """Raise `InputError` if the folder of a file lacks the files that the scene names."""
    folder = path.absolute().parent
    if folder.resolve() == scene.base_dir.resolve():
        return
    try:
        same = load_scene(plain_data(scene), base_dir=folder).content_hash() == scene.content_hash()
    except InputError:
        same = False
    if not same:
        raise InputError(f"{path}: the scene names files in its own folder (allowed: a name in {scene.base_dir})")


def _keys(scene: Scene, resolved: Resolved) -> dict[str, Any]:
    """The focus, camera model and exposure as keys of the scene, by key path."""
    changes: dict[str, Any] = {}
    if resolved.focus is not None:
        changes |= focus_keys(scene, resolved.focus["camera"])
    if "accuracy" in resolved.metadata and not _goes_by_lens(scene, resolved):
        chosen, spectrum = resolved.scene.camera, resolved.scene.spectrum
        if chosen.kind != scene.camera.kind:
            changes = {"camera": plain_keys(chosen)}
        else:
            changes["camera.accuracy"] = None
            if getattr(chosen, "rays", "") == "fitted":
                changes["camera.rays"] = "fitted"
        if spectrum.lens is not None and spectrum != scene.spectrum:
            changes["spectrum.lens"] = spectrum.lens
    if scene.exposure.mode == "auto":
        changes["exposure.lock_cd_m2"] = resolved.metered_cd_m2
    return changes


def _goes_by_lens(scene: Scene, resolved: Resolved) -> bool:
    """Whether ghosts or diffraction are those of a lens in whose place rays have another camera model."""
    effects = any(resolved.metadata.get(what, {}).get("on") for what in ("diffraction", "ghosts"))
    return effects and resolved.scene.camera.kind != scene.camera.kind


def _notes(scene: Scene, resolved: Resolved) -> tuple[str, ...]:
    notes = []
    if resolved.focus is not None:
        distance = resolved.metadata.get("focus_distance_m")
        notes.append("focus: " + ("found" if distance is None else f"at {distance:.4g} m"))
        notes += [f"autofocus: {line}" for line in resolved.metadata.get("autofocus", {}).get("warnings", ())]
    if "accuracy" in resolved.metadata:
        left = ", left to each render: ghosts and diffraction are the lens's" * _goes_by_lens(scene, resolved)
        notes.append(f"camera model: {resolved.scene.camera.kind}{left}")
    if resolved.metered_cd_m2 is not None:
        notes.append(f"exposure: {resolved.metered_cd_m2:.6g} cd/m²")
    return tuple(notes)


def merge(
    parts: Sequence[str | os.PathLike[str]],
    *,
    checkpoint: str | os.PathLike[str] | None = None,
    allow_mixed: bool = False,
) -> Image:
    """Return the picture of a render that was made in parts; needs neither its scene nor a device.

    Parts by tiles give the bits of one render on equal devices. Ranges of samples of the same tiles are added in
    float64, and differ from one render by the rounding of float32.

    Parameters
    ----------
    parts
        Files that `render` kept with ``part`` or ``samples``, or a checkpoint of the whole film.
    checkpoint
        File for the state of the whole, to go on from: ``render(..., checkpoint=that, resume=True)`` adds samples.
    allow_mixed
        Whether parts are taken that other code, another numpy or another driver has made; the metadata name all under
        ``mixed``.

    Raises
    ------
    InputError
        There are no parts, or the checkpoint is one of them.
    StateError
        A file cannot be read or is damaged; parts are of another scene, lens, seed or version, overlap, or leave gaps,
        which are named.
    """
    if not parts:
        raise InputError("parts: there are none (allowed: at least one file)")
    if checkpoint is not None:
        check_writable(checkpoint, parts)
    state = merge_states(parts, allow_mixed=allow_mixed)
    layout = layout_of(state.facts)
    try:
        spread = spread_of(state.arrays, tuple(state.facts["resolution"]), (layout.width, layout.height))
        pixels, metadata, stats, recorded = picture_of(state, layout)
        ghosts = saved_ghosts(state.arrays)
        of_sharp_layers = saved_truth(state.arrays, layout)[1]
    except (ValueError, KeyError, TypeError) as problem:
        raise StateError(f"this saved render is damaged: {problem} (render it again)") from None
    if checkpoint is not None:
        write_checkpoint(checkpoint, state.facts, state.arrays)
    layers = _name_layers(state.facts["layers"], recorded, ({}, of_sharp_layers), metadata)
    image = Image(pixels, metadata, stats, layers=layers)
    if ghosts is not None:
        image = with_ghosts(image, *ghosts)
    if spread is not None:
        spread_film, said = spread.over(image.pixels, layout)
        image = replace(image, pixels=spread_film, metadata=describe_film(image.metadata, said))
    try:
        return develop(image, folders=folders_of_film(parts[0]))
    except InputError as problem:  # of keys that every render has checked: it is damaged, or their files are not here
        where = "in the scene's folder, where tables and configs of colour lie"
        raise StateError(
            f"{parts[0]}: its settings of the picture are of no use: {problem} (merge it {where})"
        ) from None
