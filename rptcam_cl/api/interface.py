"""The interface: devices, lenses and pictures, each by one call; scenes with all found once; parts and their whole."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl.api.job import (
    RenderJob,
    RenderOptions,
    Resolved,
    SceneSource,
    name_layers,
    plain_data,
    read_scene,
    resolve,
    with_ghosts,
)
from rptcam_cl.core.dataclass import dataclass, takes_options
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.files import check_writable, replacing
from rptcam_cl.device.devices import choose_device, list_devices, problem_of
from rptcam_cl.device.session import Wanted, open_sessions
from rptcam_cl.imaging.image import Image, develop, folders_of_film
from rptcam_cl.optics.library import load_lens as read_lens
from rptcam_cl.rendering.checkpoint import layout_of, merge_states, picture_of, write_checkpoint
from rptcam_cl.rendering.diffraction import spread_of
from rptcam_cl.rendering.ghosts import saved_ghosts
from rptcam_cl.rendering.layers import saved_truth
from rptcam_cl.scene.load import load_scene, scene_text, set_keys
from rptcam_cl.scene.scene import Scene

if TYPE_CHECKING:
    from rptcam_cl.rendering.traceable_lens import TraceableLens


# Devices, lenses and pictures, each by one call.


def devices() -> list[dict[str, Any]]:
    """Return every OpenCL device as a mapping of id, name, platform, type, compute_units, memory_bytes, fp64,
    problem and default.

    ``problem`` is why it cannot be used, None where it can; ``default`` marks the one that ``auto`` chooses.
    """
    listed = list_devices()
    problems = {device.id: problem_of(device) for device in listed}
    chosen = None if all(problems.values()) else choose_device("auto").id
    names = ("id", "name", "platform", "type", "compute_units", "memory_bytes", "fp64")
    return [
        {name: getattr(device, name) for name in names}
        | {"problem": problems[device.id], "default": device.id == chosen}
        for device in listed
    ]


def load_lens(source: str | Path | Mapping[str, Any]) -> TraceableLens:
    """Return the lens of a name in the library, a file, or a mapping of the same form; it can be traced on devices."""
    from rptcam_cl.rendering.traceable_lens import traceable

    return traceable(read_lens(source))


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


# A scene whose focus, camera model and exposure are found once, so that every later render of it agrees on them.


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
    notes = _notes(resolved)
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
        changes |= {f"camera.{key}": value for key, value in resolved.focus["camera"].items()}
    if "accuracy" in resolved.metadata:
        chosen, spectrum = resolved.scene.camera, resolved.scene.spectrum
        if chosen.kind != scene.camera.kind:
            changes = {"camera": chosen.model_dump(mode="json", exclude_unset=True) | {"kind": chosen.kind}}
        else:
            changes["camera.accuracy"] = None
            if getattr(chosen, "rays", "") == "fitted":
                changes["camera.rays"] = "fitted"
        if spectrum.lens is not None and spectrum != scene.spectrum:
            changes["spectrum.lens"] = spectrum.lens
    if scene.exposure.mode == "auto":
        changes["exposure.lock_cd_m2"] = resolved.metered_cd_m2
    return changes


def _notes(resolved: Resolved) -> tuple[str, ...]:
    notes = []
    if resolved.focus is not None:
        distance = resolved.metadata.get("focus_distance_m")
        notes.append("focus: " + ("found" if distance is None else f"at {distance:.4g} m"))
        notes += [f"autofocus: {line}" for line in resolved.metadata.get("autofocus", {}).get("warnings", ())]
    if "accuracy" in resolved.metadata:
        notes.append(f"camera model: {resolved.scene.camera.kind}")
    if resolved.metered_cd_m2 is not None:
        notes.append(f"exposure: {resolved.metered_cd_m2:.6g} cd/m²")
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
    layers = name_layers(state.facts["layers"], recorded, ({}, of_sharp_layers), metadata)
    image = Image(pixels, metadata, stats, layers=layers)
    if ghosts is not None:
        image = with_ghosts(image, *ghosts)
    if spread is not None:
        image = replace(image, pixels=spread.over(image.pixels, layout))
    try:
        return develop(image, folders=folders_of_film(parts[0]))
    except InputError as problem:  # of keys that every render has checked: it is damaged, or their files are not here
        where = "in the scene's folder, where tables and configs of colour lie"
        raise StateError(
            f"{parts[0]}: its settings of the picture are of no use: {problem} (merge it {where})"
        ) from None
