"""The stages of a render: prepare (focus, camera model, exposure, plan, kernels), run, report."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.api.image_layers import named_layers, truth_of
from rptcam_cl.api.settings import RenderSettings
from rptcam_cl.api.wavefronts import Kept, devices_of, saved_shares, wavefront_of
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, NumericError
from rptcam_cl.device import Session, open_sessions
from rptcam_cl.imaging import (
    GUIDES,
    Image,
    check_denoiser,
    check_sensor,
    sensor_of,
    with_picture_settings,
)
from rptcam_cl.plan import Plan, make_plan
from rptcam_cl.rendering import (
    GEOMETRY,
    WHOLE,
    AnyWavefront,
    Diffraction,
    FilmLayout,
    Ghosting,
    GroundTruth,
    Progress,
    Rendering,
    SavedState,
    Saver,
    aimed_plan,
    anomalies,
    described,
    described_before,
    diffracted,
    diffraction_of,
    ghosting_of,
    has_ghosts,
    joined,
    lens_margin,
    of_makers,
    render_plan,
    rendering_of,
    resolve_exposure,
    statistics,
    window,
)
from rptcam_cl.scene import RealisticCamera, Scene, at_rest, change_scene, exposure_steps, load_scene


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
        from rptcam_cl.focusing import in_focus  # few scenes have it, and its room takes long to import

        focus = in_focus(still, session, focus)[1]
        sharp = in_focus(scene, session, focus)[0]
    diffraction, in_focus_with_lens = diffraction_of(sharp), sharp
    described_choice: dict[str, Any] = {}
    if isinstance(sharp.camera, RealisticCamera) and sharp.camera.accuracy is not None:
        from rptcam_cl.tradeoff import choose_camera  # few scenes have a choice, and its room takes long to import

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

    settings: RenderSettings
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
    scene: Scene | str | Path | Mapping[str, Any], settings: RenderSettings, kept: Kept | None = None
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


def _check_part(scene: Scene, settings: RenderSettings) -> None:
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


def of_picture(scene: Scene, found: Resolved, plan: Plan, settings: RenderSettings) -> dict[str, Any]:
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
