"""The Python interface: load a scene, choose a device, render."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rptcam_cl import optics
from rptcam_cl.core.errors import InputError, NumericError
from rptcam_cl.device import Session, Split, Wanted, choose_device, list_devices, means_all, open_sessions, problem_of
from rptcam_cl.focusing import FocusReport, autofocus, focused_scene, in_focus
from rptcam_cl.imaging import GUIDES, Image, check_denoiser, check_sensor, develop, developed_as, sensor_of
from rptcam_cl.lenstools import TraceableLens, traceable
from rptcam_cl.plan import Plan, make_plan
from rptcam_cl.rendering import (
    GEOMETRY,
    AnyWavefront,
    FilmLayout,
    Part,
    Progress,
    SavedState,
    Saver,
    SharedWavefront,
    Wavefront,
    anomalies,
    described,
    joined,
    lens_margin,
    render_plan,
    resolve_exposure,
    split_of,
    split_text,
    statistics,
    window,
)
from rptcam_cl.scene import ADAPTIVE_SPP, Scene, change_scene, load_scene
from rptcam_cl.tradeoff import choose_camera, measure_tradeoff

__all__ = [
    "FocusReport",
    "Image",
    "Progress",
    "Scene",
    "autofocus",
    "choose_device",
    "develop",
    "devices",
    "focused_scene",
    "load_lens",
    "load_scene",
    "measure_tradeoff",
    "render",
]


def devices() -> list[dict[str, Any]]:
    """Return every OpenCL device as a mapping of id, name, platform, type, compute_units, memory_bytes, fp64,
    problem and default.

    ``problem`` is why it cannot be used, None where it can; ``default`` marks the one that ``auto`` chooses.
    """
    found = list_devices()
    problems = {device.id: problem_of(device) for device in found}
    chosen = None if all(problems.values()) else choose_device("auto").id
    names = ("id", "name", "platform", "type", "compute_units", "memory_bytes", "fp64")
    return [
        {name: getattr(device, name) for name in names}
        | {"problem": problems[device.id], "default": device.id == chosen}
        for device in found
    ]


def load_lens(source: str | Path | Mapping[str, Any]) -> TraceableLens:
    """Return the lens of a name in the library, a file, or a mapping of the same form; it can be traced on devices."""
    return traceable(optics.load_lens(source))


def render(
    scene: Scene | str | Path | Mapping[str, Any],
    *,
    spp: int | None = None,
    seconds: float | None = None,
    seed: int | None = None,
    size: tuple[int, int] | None = None,
    crop: tuple[float, float, float, float] | None = None,
    layers: Sequence[str] | None = None,
    denoise: bool = False,
    noise: float | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool = False,
    device: Wanted = None,
    split: Split | None = None,
    wave_size: int | None = None,
    numerics: bool = False,
    strict: bool = False,
    on_progress: Callable[[Progress], Any] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> Image:
    """Return the picture that the camera of a scene takes.

    Parameters
    ----------
    scene
        A scene, or anything that `load_scene` takes.
    spp
        Samples per pixel; by default the scene's, or as many as fit when ``seconds`` is given.
    seconds
        Time to render [s]; the picture ends after whole samples, at least one.
    seed, size, crop
        Replace the scene's seed, resolution [pixels] and crop [fractions x0, x1, y0, y1].
    layers
        Auxiliary layers to record, in place of the scene's: ``["depth", "normal"]``; see docs/layers.md.
    denoise
        Whether to remove the noise that is left, which makes the picture biased; needs the extra ``denoise``.
    noise
        Relative standard error at which a tile of 8 x 8 pixels is done, in place of the scene's; without ``spp``, up to
        16384 samples per pixel. See docs/scene.md.
    checkpoint
        File to keep the state of the render in: every minute, and when ``should_stop`` ends it.
    resume
        Whether to go on from the checkpoint, if it is there, and to leave it at the end, so that a later call can add
        samples. Otherwise a render that comes to its end removes it.
    device
        As ``--device`` on the command line, or a session to reuse; see `choose_device`. Several of them, or ``"all"``,
        share the render.
    split
        Share of each device, as ``{"0:0": 0.7, "1:0": 0.3}`` or ``"0:0=0.7,1:0=0.3"``; by default in proportion to
        their speeds, which are measured.
    wave_size
        Paths in flight; changes speed and memory, never the picture.
    numerics
        Whether to measure too what float32 costs in the lens, by the kernel that traces given rays.
    strict
        Whether numbers that cannot be trusted and autofocus that failed are an error; measures as ``numerics`` does.
        See docs/numerics.md.
    on_progress
        Called with a `Progress` several times a second.
    should_stop
        Asked after each sample per pixel; True ends the render with what there is.

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
    begun = time.perf_counter()
    if seconds is not None and not 0 < seconds < math.inf:
        raise InputError(f"seconds: is out of range (got {seconds!r}; allowed: a number above 0)")
    scene = _adjusted(scene if isinstance(scene, Scene) else load_scene(scene), spp, seed, size, crop, layers, noise)
    check_sensor(scene, *window(scene)[2:])
    wanted = scene.render.layers
    if denoise:
        check_denoiser()
        scene = change_scene(scene, render={"layers": tuple(dict.fromkeys((*wanted, *GUIDES)))})
    sessions, shares = open_sessions(device, split)
    session = sessions[0]
    saver = None if checkpoint is None else Saver(checkpoint, scene, [session.info.name for session in sessions])
    saved = saver.load() if saver is not None and resume else None
    taken, told = _taken(scene, session, saver)
    plan = make_plan(taken)
    started = time.perf_counter()
    if on_progress is not None:
        on_progress(Progress("compile", 0, scene.render.spp, 0.0, 0.0, None))
    if shares is None and saver is not None:
        shares = _shares_of(saver.parts, sessions)
    wavefront = _wavefront(scene, plan, sessions, shares, wave_size, lenient=means_all(device))
    if saver is not None:
        saver.parts_since = lambda done: _parts(wavefront, saved, done)
    compiled = time.perf_counter()
    rendering = render_plan(
        wavefront,
        spp=_limit(scene, spp, seconds, noise),
        seconds=seconds,
        has_lens=plan.camera.has_lens,
        noise=scene.render.noise,
        saved=saved,
        save=None if saver is None else saver.save_now_and_then,
        on_progress=on_progress,
        should_stop=should_stop,
    )
    times = {
        "start": started - begun,
        "compile": compiled - started,
        "render": rendering.seconds,
        "total": time.perf_counter() - begun,
    }
    margin = lens_margin(taken, wavefront.session) if numerics or strict else None
    work = joined([] if saver is None else saver.parts, _parts(wavefront, saved, rendering.done))
    stats = statistics(plan, wavefront, rendering, times, margin) | {"work": work}
    metadata = described(scene, plan, rendering, stats, told)
    if (sensor := sensor_of(taken, metadata)) is not None:
        metadata["sensor"] = sensor.described()
    if saver is not None:
        stats["checkpoint"] = saver.end(rendering.state, keep=resume or rendering.interrupted)
        metadata["device"] = saver.devices
    stats["camera"] = {key: metadata[key] for key in GEOMETRY if key in metadata}
    stats |= {key: metadata[key] for key in ("accuracy", "autofocus") if key in metadata}
    image = developed_as(Image(rendering.pixels, metadata, stats, layers=rendering.layers), scene.picture)
    if denoise:
        image = replace(image.denoised(), layers={name: image[name] for name in wanted})
    if strict and (met := anomalies(stats["numerics"]) + _failed_focus(metadata)):
        raise NumericError(f"strict: {'; '.join(met)}", image)
    return image


def _wavefront(
    scene: Scene,
    plan: Plan,
    sessions: list[Session],
    shares: list[float] | None,
    wave_size: int | None,
    *,
    lenient: bool,
) -> AnyWavefront:
    """Return what renders the scene, compiled and ready: on one device, or on several that share it."""
    layout = FilmLayout.of(scene.film)
    if len(sessions) > 1:
        return SharedWavefront(sessions, plan, layout, scene.render, wave_size, shares=shares, lenient=lenient)
    wavefront = Wavefront(sessions[0], plan, layout, scene.render, wave_size)
    wavefront.warm_up()
    return wavefront


def _shares_of(parts: list[Part], sessions: list[Session]) -> list[float] | None:
    """Return the shares that the same devices had when the render was saved; None where they were others."""
    last = split_of(parts[-1]["split"]) if parts else {}
    ids = [session.info.id for session in sessions]
    return [last[identity] for identity in ids] if last.keys() == set(ids) else None


def _parts(wavefront: AnyWavefront, saved: SavedState | None, done: int) -> list[Part]:
    """Return which device has taken which samples since a render began or went on."""
    if isinstance(wavefront, SharedWavefront):
        return wavefront.parts(done)
    first = 0 if saved is None else saved.done
    return [{"samples": [first, done], "split": split_text({wavefront.session.info.id: 1.0})}] if done > first else []


def _taken(scene: Scene, session: Session, saver: Saver | None) -> tuple[Scene, dict[str, Any]]:
    """Return the scene in focus, with the camera model and the exposure that it leaves to be found, and what to tell.

    What was found for an earlier part of the render is kept.
    """
    sharp, focus = in_focus(scene, session, None if saver is None else saver.focus)
    chosen = choose_camera(sharp)
    shot = resolve_exposure(chosen.scene, session, None if saver is None else saver.metered_cd_m2)
    if saver is not None:
        saver.metered_cd_m2, saver.focus = shot.metered_cd_m2, focus
    return shot.scene, shot.metadata | chosen.metadata | ({} if focus is None else focus["metadata"])


def _failed_focus(metadata: Mapping[str, Any]) -> list[str]:
    """Return why autofocus failed; nothing where it did not."""
    failure = metadata.get("autofocus", {}).get("failure")
    return [] if failure is None else [f"autofocus: {failure}"]


def _limit(scene: Scene, spp: int | None, seconds: float | None, noise: float | None) -> int | None:
    """Return the most samples of a pixel: those given beside a time or a noise target given here, or the scene's."""
    if spp is not None:
        return spp
    if noise is not None:
        return ADAPTIVE_SPP
    return None if seconds is not None else scene.render.most_spp


def _adjusted(
    scene: Scene,
    spp: int | None,
    seed: int | None,
    size: tuple[int, int] | None,
    crop: tuple[float, float, float, float] | None,
    layers: Sequence[str] | None,
    noise: float | None,
) -> Scene:
    settings = {"spp": spp, "seed": seed, "layers": layers, "noise": noise}
    film = {"resolution": size, "crop": crop}
    return change_scene(
        scene,
        render={key: value for key, value in settings.items() if value is not None},
        film={key: value for key, value in film.items() if value is not None},
    )
