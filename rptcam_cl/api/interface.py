"""Devices, lenses and pictures, each by one call; scenes with all found once; parts and their whole."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.api.stages import (
    RenderOptions,
    Resolved,
    arrays_beside,
    check_divisible,
    devices_of,
    named_layers,
    of_picture,
    prepare,
    report,
    resolve,
    run,
    truth_of,
    with_ghosts,
)
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.files import check_writable, replacing
from rptcam_cl.device.devices import choose_device, list_devices, problem_of
from rptcam_cl.device.session import Split, Wanted, open_session, open_sessions
from rptcam_cl.imaging.image import Image, develop
from rptcam_cl.imaging.sensor import check_sensor
from rptcam_cl.optics.library import load_lens as read_lens
from rptcam_cl.rendering.account import forecast, window
from rptcam_cl.rendering.checkpoint import (
    SUFFIX,
    Checkpoint,
    SavedPicture,
    Saver,
    layout_of,
    merged_state,
    picture_of,
    write_checkpoint,
)
from rptcam_cl.rendering.diffraction import FilmSpread, spread_of
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.ghosts import ghosting_of, saved_ghosts
from rptcam_cl.rendering.ground_truth import saved_truth
from rptcam_cl.rendering.highlights import aimed_plan
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.progressive import Progress, render_state
from rptcam_cl.rendering.several import FilmPart
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.load import load_scene, plain, scene_text, set_keys
from rptcam_cl.scene.scene import Scene

if TYPE_CHECKING:
    from rptcam_cl.rendering.traceable_lens import TraceableLens


# Devices, lenses and pictures, each by one call.

SceneSource = Scene | str | Path | Mapping[str, Any]


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
    from rptcam_cl.rendering.traceable_lens import traceable

    return traceable(read_lens(source))


def render(
    scene: SceneSource,
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
    allow_mixed: bool = False,
    device: Wanted = None,
    split: Split | None = None,
    wave_size: int | None = None,
    numerics: bool = False,
    strict: bool = False,
    part: str | None = None,
    samples: tuple[int, int] | None = None,
    neighbours: tuple[SceneSource | None, SceneSource | None] | None = None,
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
    allow_mixed
        Whether to go on from a checkpoint that other code, another numpy or another driver has saved; the metadata then
        name all under ``mixed``.
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
    part
        ``"3/8"``: render the third of eight parts of the tiles, and keep its checkpoint for `merge`; see docs/parts.md.
    samples
        ``(64, 128)``: render these samples of each pixel alone, those from 64 on and before 128, likewise.
    neighbours
        Scenes of the frames before and after, or what `load_scene` takes, None where there is none, that the layers
        ``flow_backward`` and ``flow_forward`` lead to; without them they lead to the opening and the closing of the
        shutter.
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
    settings = RenderOptions(
        spp=spp,
        seconds=seconds,
        seed=seed,
        size=size,
        crop=crop,
        layers=layers,
        denoise=denoise,
        noise=noise,
        checkpoint=checkpoint,
        resume=resume,
        allow_mixed=allow_mixed,
        device=device,
        split=split,
        wave_size=wave_size,
        numerics=numerics,
        strict=strict,
        part=part,
        samples=samples,
        neighbours=_frames_beside(neighbours),
        on_progress=on_progress,
        should_stop=should_stop,
    )
    prepared = prepare(scene, settings)
    return report(prepared, run(prepared))


def _frames_beside(
    neighbours: tuple[SceneSource | None, SceneSource | None] | None,
) -> tuple[Scene | None, Scene | None] | None:
    """Return the scenes of the frames before and after."""
    if neighbours is None:
        return None
    if not isinstance(neighbours, tuple | list) or len(neighbours) != 2:
        got = f"{len(neighbours)} of them" if isinstance(neighbours, tuple | list) else type(neighbours).__name__
        raise InputError(f"neighbours: must be the frames before and after (got {got}; allowed: two, None for none)")
    before, after = (frame if frame is None or isinstance(frame, Scene) else load_scene(frame) for frame in neighbours)
    return before, after


# A scene whose focus, camera model and exposure are found once, so that every later render of it agrees on them.


@dataclass(frozen=True)
class Settlement:
    """What `rptcam_cl.settle` found.

    Attributes
    ----------
    scene : dict
        The data of the scene, as `load_scene` takes them.
    found : tuple of str
        What was found, a sentence each; none where the scene left nothing open.
    """

    scene: dict[str, Any]
    found: tuple[str, ...]


def settle(
    scene: Scene | str | Path | Mapping[str, Any], path: str | Path | None = None, *, device: Wanted = None
) -> Settlement:
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
    given = scene if isinstance(scene, Scene) else load_scene(scene)
    if path is not None:
        check_writable(path, [scene] if isinstance(scene, str | Path) else [])
        _check_folder(given, Path(path))
    sessions, _ = open_sessions(device)
    found = resolve(given, sessions[0])
    fixed = set_keys(given, _keys(given, found))
    data = {name: _data(value) for name, value in fixed.made_of.items()}
    notes = _notes(found)
    if path is not None:
        with replacing(path) as temporary:
            temporary.write_text(scene_text(data, ("Resolved by rptcam settle.", *notes)), encoding="utf-8")
    return Settlement(data, notes)


def _check_folder(scene: Scene, path: Path) -> None:
    """Refuse a file whose folder lacks the files that the scene names."""
    folder = path.absolute().parent
    if folder.resolve() == scene.base_dir.resolve():
        return
    data = {name: _data(value) for name, value in scene.made_of.items()}
    try:
        same = load_scene(data, base_dir=folder).content_hash() == scene.content_hash()
    except InputError:
        same = False
    if not same:
        raise InputError(f"{path}: the scene names files in its own folder (allowed: a name in {scene.base_dir})")


def _keys(scene: Scene, found: Resolved) -> dict[str, Any]:
    """Return the keys that say what was found, by key path."""
    changes: dict[str, Any] = {}
    if found.focus is not None:
        changes |= {f"camera.{key}": value for key, value in found.focus["camera"].items()}
    if "accuracy" in found.metadata:
        chosen, spectrum = found.scene.camera, found.scene.spectrum
        if chosen.kind != scene.camera.kind:
            changes = {"camera": chosen.model_dump(mode="json", exclude_unset=True) | {"kind": chosen.kind}}
        else:
            changes["camera.accuracy"] = None
            if getattr(chosen, "rays", "") == "fitted":
                changes["camera.rays"] = "fitted"
        if spectrum.lens is not None and spectrum != scene.spectrum:
            changes["spectrum.lens"] = spectrum.lens
    if scene.exposure.mode == "auto":
        changes["exposure.lock_cd_m2"] = found.metered_cd_m2
    return changes


def _data(value: Any) -> Any:
    """Return a part of a scene as the data that a file has."""
    if hasattr(value, "model_dump"):
        return value.model_dump(mode="json", exclude_unset=True)
    return plain(value)


def _notes(found: Resolved) -> tuple[str, ...]:
    notes = []
    if found.focus is not None:
        distance = found.metadata.get("focus_distance_m")
        notes.append("focus: " + ("found" if distance is None else f"at {distance:.4g} m"))
        notes += [f"autofocus: {line}" for line in found.metadata.get("autofocus", {}).get("warnings", ())]
    if "accuracy" in found.metadata:
        notes.append(f"camera model: {found.scene.camera.kind}")
    if found.metered_cd_m2 is not None:
        notes.append(f"exposure: {found.metered_cd_m2:.6g} cd/m²")
    return tuple(notes)


# Parts of a render, made anywhere, become its picture.


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
    state = merged_state(parts, allow_mixed=allow_mixed)
    layout = layout_of(state.facts)
    found, spread, ghosts, said = _beside(state, layout)
    if checkpoint is not None:
        write_checkpoint(checkpoint, state.facts, state.arrays)
    metadata = dict(found.metadata)
    layers = named_layers(state.facts["layers"], found.layers, ({}, said), metadata)
    image = Image(found.pixels, metadata, found.stats, layers=layers)
    if ghosts is not None:
        image = with_ghosts(image, *ghosts)
    if spread is not None:
        image = replace(image, pixels=spread.over(image.pixels, layout))
    try:
        return develop(image)
    except InputError as problem:  # of keys that every render has checked
        raise StateError(f"{parts[0]}: this saved render is damaged: {problem}") from None


def _beside(
    state: Checkpoint, layout: FilmLayout
) -> tuple[SavedPicture, FilmSpread | None, tuple[NDArray[np.float32], dict[str, Any]] | None, dict[str, Any]]:
    """Return the picture of a saved render, what diffraction does to it, its ghosts, and what its sharp layers say."""
    try:
        spread = spread_of(state.arrays, tuple(state.facts["resolution"]))
        return picture_of(state, layout), spread, saved_ghosts(state.arrays), saved_truth(state.arrays, layout)[1]
    except (ValueError, KeyError, TypeError) as problem:
        raise StateError(f"this saved render is damaged: {problem} (render it again)") from None


# Many parts of one film, each as the content of a file, by kernels that are compiled once.

SHORT_MEASURE_S = 0.2  # by which parts are made: parts of half or twice the time are no worse


@dataclass(frozen=True)
class Found:
    """What is found once for all parts of a film.

    Attributes
    ----------
    focus : dict or None
        What autofocus found.
    metered_cd_m2 : float or None
        The luminance that the exposure follows from.
    """

    focus: dict[str, Any] | None = None
    metered_cd_m2: float | None = None

    def is_same(self, other: Found) -> bool:
        """Return whether another worker, or the same earlier, has found the same; what it could not measure is nan."""
        return self.text() == other.text()

    def text(self) -> str:
        """Return all of it, as a file has it."""
        return json.dumps(asdict(self), sort_keys=True, default=str)


class PartRenderer:
    """Renders parts of one film by tiles; `rptcam_cl.merge` puts them together.

    Parameters
    ----------
    scene
        The scene.
    settings
        What replaces its keys.
    device
        As for `rptcam_cl.choose_device`.
    found
        Focus and exposure, where they were found before; else they are found here.

    Attributes
    ----------
    found : Found
    device : str
        Name of the device.
    made_by : dict
        What the parts say of this program.

    Raises
    ------
    InputError, DeviceError
        As `rptcam_cl.render` does.
    """

    def __init__(self, scene: Scene, settings: RenderOptions, device: str | None, found: Found | None = None) -> None:
        scene = settings.applied_to(scene)
        check_sensor(scene, *window(scene)[2:])
        check_divisible(scene)
        end = settings.most_spp(scene)
        assert end is not None, "parts end by samples"
        self._end = end
        session = open_session(device)
        known = found or Found()
        resolved = resolve(scene, session, known.focus, known.metered_cd_m2)
        self.found = found or Found(resolved.focus, resolved.metered_cd_m2)
        self.device = session.info.name
        layout, layers = FilmLayout.of(scene.film), scene.render.layers
        plan, buffers = aimed_plan(make_plan(resolved.scene), session, layers)
        self._wavefront = Wavefront(session, plan, layout, scene.render, buffers=buffers)
        self._wavefront.warm_up()
        ghosting = ghosting_of(resolved.ghosts, plan, session)
        self._saver = Saver(f"part{SUFFIX}", scene, [self.device], [session.info.driver])
        self.made_by = self._saver.makers[0]
        self._saver.focus, self._saver.metered_cd_m2 = self.found.focus, self.found.metered_cd_m2
        self._saver.of_picture = of_picture(scene, resolved, plan, settings)
        truth = truth_of(resolved.scene, plan, self._wavefront, layers, settings)
        self._saver.beside = partial(arrays_beside, resolved.diffraction, ghosting, truth)

    def seconds(self) -> float:
        """Return how long the whole film takes here [s], by a short measurement."""
        return forecast(self._wavefront, 0, self._end, measure_s=SHORT_MEASURE_S).seconds

    def render(self, part: FilmPart) -> tuple[bytes, float]:
        """Render a part; return the content of its file, which `rptcam_cl.merge` reads, and how long it took [s]."""
        begun, wavefront = time.perf_counter(), self._wavefront
        wavefront.clear()
        wavefront.choose_tiles(part.tiles(wavefront.layout.tiles))
        state = render_state(wavefront, self._end, part)
        self._saver.parts_since = lambda done: devices_of(wavefront, part.first, done)
        return self._saver.content(state, part), time.perf_counter() - begun
