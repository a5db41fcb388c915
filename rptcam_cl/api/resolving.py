"""A scene whose focus, camera model and exposure are found once, so that every later render of it agrees on them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rptcam_cl.api.stages import Resolved, resolve
from rptcam_cl.core.atomic import check_writable, replacing
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.device import Wanted, open_sessions
from rptcam_cl.scene import Scene, load_scene, plain, scene_text, set_keys


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
