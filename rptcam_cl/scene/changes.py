"""Changes of a loaded scene: keys set to other values, and the scene as it stands at moments of its exposure."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from pydantic import ValidationError

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.strict_yaml import KeyPath
from rptcam_cl.scene import base, exposure, meshes, placement, shapes
from rptcam_cl.scene.camera import Pose
from rptcam_cl.scene.load import assign, given_keys, input_error, key_path, with_files
from rptcam_cl.scene.scene import Scene

# Keys of a scene set to other values: what they do not concern stays the same instances.

# Parts that are made anew with another: objects have materials and meshes.
_DEPENDENT = {"materials": ("objects",), "meshes": ("objects",)}
_UP = ("environment", "lights", "medium")  # parts whose defaults come from the camera's up
_WITHOUT_FILES = {"film", "exposure", "shutter", "render", "picture", "spectrum"}


def set_keys(scene: Scene, changes: Mapping[str, Any]) -> Scene:
    """Return a scene with some keys set, checked anew.

    Parameters
    ----------
    changes
        Values as a scene file has them, by key path: ``{"camera.f_number": 4, "objects.2.radius": 0.5}``. None removes
        a key; one that excludes others replaces them.

    Raises
    ------
    InputError
        When a key path leads nowhere, or the changed scene is not valid.
    """
    before = scene.made_of
    data, paths = dict(before), []
    for text, value in changes.items():
        path = _path(text)
        assign(data, path, copy.deepcopy(value), text)
        paths.append(path)
    touched = {str(path[0]) for path in paths}
    renewed = touched | {name for part in touched for name in _DEPENDENT.get(part, ())}
    if any(path[0] == "camera" and (len(path) == 1 or path[1] == "up") for path in paths):
        renewed |= set(_UP)
    given = {name: value if name in renewed else getattr(scene, name) for name, value in data.items()}
    named = None if "meshes" in touched else _touched_materials(paths, data)
    if named is not None and "materials" in touched:
        given["materials"] = _materials(scene, data["materials"], named)
    if "objects" in renewed:
        given["objects"] = _objects(scene, before, data, named)
    try:
        changed = Scene.model_validate(given, context=_context(scene, touched) | {"made_of": data})
    except ValidationError as problem:
        raise input_error(problem, data, _nowhere) from None
    if touched <= _WITHOUT_FILES:
        return changed
    earlier = None if "meshes" in touched else scene
    return with_files(changed, _nowhere, "grey" if scene.stand_ins else "error", earlier)


def _path(text: str) -> KeyPath:
    path = key_path(text)
    if not path:
        raise InputError(f"{text or 'changes'}: is no key path (allowed: keys with dots between, as camera.f_number)")
    return path


def _context(scene: Scene, touched: set[str]) -> dict[str, Any]:
    """Make the context in which a changed scene is validated.

    It has the ``folders``, and the ``scene``, whose objects need no check again and whose meshes are loaded already,
    unless other ones have their names. The validator of objects adds what is ``new`` of them, and which materials
    are ``replaced``, for the validators after it.
    """
    return {"folders": scene.folders} | ({} if "meshes" in touched else {"scene": scene})


def _touched_materials(paths: Iterable[KeyPath], data: Mapping[str, Any]) -> set[str] | None:
    """Return the names of the materials that some keys are of, and of those mixed of them; None where it may be all."""
    of_materials = [path for path in paths if path[0] == "materials"]
    materials = data.get("materials") or {}
    if not isinstance(materials, Mapping) or any(len(path) == 1 for path in of_materials):
        return None
    named = {str(path[1]) for path in of_materials}
    return named | {name for name, plain in materials.items() if named & set(_names_mixed(plain))}


def _names_mixed(material: Any) -> list[str]:
    """Return the names of materials of which a material is mixed."""
    parts = material.get("materials") if isinstance(material, Mapping) and _is_mix(material) else ()
    return [part for part in parts if isinstance(part, str)] if isinstance(parts, (list, tuple)) else []


def _materials(scene: Scene, data: Mapping[str, Any], touched: set[str]) -> dict[str, Any]:
    """Return the data of materials; those that stay as they were, as they are."""
    given = {name: plain if name in touched else scene.materials.get(name, plain) for name, plain in data.items()}
    for name in touched & data.keys():
        if _names_mixed(data[name]):  # parts of its own, as when it is read from a file
            parts = [data.get(part, part) if isinstance(part, str) else part for part in data[name]["materials"]]
            given[name] = dict(data[name]) | {"materials": parts}
    return given


def _is_mix(material: Any) -> bool:
    """Return whether a material is mixed of others."""
    return (material.get("kind") if isinstance(material, Mapping) else getattr(material, "kind", None)) == "mix"


def _objects(scene: Scene, before: Mapping[str, Any], data: Mapping[str, Any], touched: set[str] | None) -> list[Any]:
    """Return the data of objects; those that stay as they were, as they are, but for the materials of names.

    Parameters
    ----------
    touched
        Names of the materials that do not stay; None where nothing does.
    """
    listed = before.get("objects") or ()
    wanted = data.get("objects") or ()
    if not isinstance(wanted, (list, tuple)):
        return wanted  # type: ignore[no-any-return]
    names = {id(material): name for name, material in scene.materials.items()}
    if touched is None:
        return [_with_material_name(plain, names) for plain in wanted]
    known = dict(zip(map(id, listed), scene.objects, strict=False))
    objects = [known.get(id(plain), plain) for plain in wanted]
    if touched and any(map(_is_mix, scene.shown_materials())):
        for index, item in enumerate(objects):
            if item is not wanted[index] and _mixes_its_own(item, names):
                objects[index] = _with_material_name(wanted[index], names)
    for index in [index for index, item in enumerate(objects[: len(listed)]) if item is wanted[index]]:
        objects[index] = _with_known_lists(wanted[index], listed[index], scene.objects[index])
    return objects


def _material_of(item: Any) -> Any:
    return getattr(item, "material", None)


def _mixes_its_own(item: Any, names: Mapping[int, str]) -> bool:
    """Return whether a material is mixed in an object, of which others may have changed."""
    return id(_material_of(item)) not in names and _is_mix(_material_of(item))


def _with_known_lists(plain: Any, before: Any, item: shapes.Object) -> Any:
    """Return the mapping of a changed object with the lists of numbers that it had before as they were read then."""
    if not (isinstance(plain, Mapping) and isinstance(before, Mapping)):
        return plain
    same = [key for key in meshes.WRITTEN_LISTS if plain.get(key) is not None and plain[key] is before.get(key)]
    return dict(plain) | {key: getattr(item, key) for key in same}


def _with_material_name(item: Any, names: Mapping[int, str]) -> Any:
    """Return the keys of an object whose material is one of the scene's, with its name; else the item."""
    name = names.get(id(_material_of(item)))
    if not isinstance(item, base.SceneModel) or name is None:
        return item
    return given_keys(item) | {"material": name}


def _nowhere(path: KeyPath, at_key: bool) -> str:
    return ""


def change_scene(scene: Scene, **parts: Mapping[str, Any]) -> Scene:
    """Return a copy of a scene with some keys of its parts changed, checked anew.

    ``change_scene(scene, render={"spp": 16}, film={"resolution": (320, 180)})``. Objects and materials stay the
    same instances.

    Parameters
    ----------
    scene : Scene
        The scene, which stays as it is.
    **parts : mapping
        New values of keys, by the name of the part that has them: `film`, `render`, `picture` or `camera`.

    Raises
    ------
    InputError
        When the changed scene is not valid.
    """
    data = given_keys(scene)
    for name, changes in parts.items():
        data[name] = given_keys(getattr(scene, name)) | dict(changes)
    return _check_changed(scene, data, parts)


def focus_keys(scene: Scene, found: Mapping[str, Any]) -> dict[str, Any]:
    """Return the changes that set a focus by the keys of its camera, in place of what finds it in each frame."""
    goes_on = scene.sequence is not None and scene.sequence.continuous_focus is not None
    keys = {f"camera.{name}": value for name, value in found.items()}
    return keys | ({"sequence.continuous_focus": None} if goes_on else {})


def with_camera(scene: Scene, keys: Mapping[str, Any]) -> Scene:
    """Return a copy of a scene with another camera, given by its keys, checked as `change_scene` does.

    Raises
    ------
    InputError
        When the camera is not valid, or does not fit the scene.
    """
    return _check_changed(scene, given_keys(scene) | {"camera": dict(keys)}, ("camera",))


def _check_changed(scene: Scene, data: dict[str, Any], changed: Iterable[str]) -> Scene:
    made_of = scene.made_of | {name: data[name] for name in changed}
    try:
        return Scene.model_validate(data, context=_context(scene, set()) | {"made_of": made_of})
    except ValidationError as problem:
        raise input_error(problem, data, _nowhere) from None


# A scene as it stands at moments of its exposure: when the shutter opens, and in the steps of keys that move then.


def at_opening(scene: Scene) -> Scene:
    """Return a scene whose camera stands and is focused as it is when the shutter opens, as are keys of the shutter.

    It is the scene itself where none of these moves or follows. The lens is set there and stays as it is.

    Raises
    ------
    InputError
        When the object that the focus follows is not in front of the camera.
    """
    scene = at_rest(scene)
    if scene.camera.motion:
        scene = scene.model_copy(update={"camera": _camera_at(scene.camera, scene.shutter.open_s)})
    return _following(scene)


def camera_changes(scene: Scene) -> bool:
    """Return whether the camera is not the same all the time that the shutter is open: by its motion, or by keys."""
    span = scene.shutter.span_s
    first, *poses = (scene.camera.pose_at(time_s) for time_s in placement.moments(scene.camera.motion, *span))
    if any(not np.array_equal(pose, first) for pose in poses):
        return True
    for name, frames in scene.shutter.keys.items():
        begin, *values = (exposure.value_at(frames, time_s) for time_s in placement.moments(frames, *span))
        if name.startswith("camera") and any(value != begin for value in values):
            return True
    return False


def at_rest(scene: Scene) -> Scene:
    """Return a scene whose keys of the shutter stay as they are when it opens; itself without such keys."""
    if not scene.shutter.keys:
        return scene
    return _at_keys(scene, scene.shutter.open_s, {"shutter.keys": None, "shutter.steps": None})


def exposure_steps(scene: Scene) -> list[Scene]:
    """Return the scene in the steps of its exposure, one after the other; none where no key moves.

    Each is exposed for its part of the time, with the light of the whole, so that the picture is their mean.

    Raises
    ------
    InputError
        When a key leads nowhere, or out of its range.
    """
    shutter, steps = scene.shutter, []
    if not shutter.keys:
        return []
    share_s = shutter.time_s / shutter.steps
    for step in range(shutter.steps):
        begin_s = shutter.open_s + step * share_s
        own = {"shutter.open_s": begin_s, "shutter.time_s": share_s, "shutter.keys": None, "shutter.steps": None}
        still = _at_keys(scene, begin_s + share_s / 2, own)
        if still.exposure.mode == "physical":
            gained = still.exposure.model_copy(update={"ev": still.exposure.ev + float(np.log2(shutter.steps))})
            still = still.model_copy(update={"exposure": gained})
        steps.append(still)
    return steps


def _at_keys(scene: Scene, time_s: float, own: dict[str, Any]) -> Scene:
    """Return a scene with its keys of the shutter as they are at a moment, and some keys of its own."""
    values = {name: exposure.value_at(frames, time_s) for name, frames in scene.shutter.keys.items()}
    try:
        return set_keys(scene, values | own)
    except InputError as problem:
        raise InputError(f"shutter.keys: at {time_s:g} s: {problem}") from None


def _following(scene: Scene) -> Scene:
    """Return a scene whose focus is at the plane of the object that it follows; itself where it follows none."""
    camera = scene.camera
    if camera.followed is None:
        return scene
    middle = _middle_of(scene, camera.followed)
    ahead = float(np.dot(np.subtract(camera.eye, middle), camera.world_from_camera()[:3, 2]))
    if not ahead > 0:
        raise InputError(
            f"camera.focus.object: {camera.followed} does not lie in front of the camera at"
            f" {scene.shutter.open_s:g} s (allowed: an object on the side that the camera looks to)"
        )
    point = (float(middle[0]), float(middle[1]), float(middle[2]))
    changes = camera.following(point, ahead * scene.metres_per_unit)
    return scene.model_copy(update={"camera": camera.model_copy(update=changes)})


def _middle_of(scene: Scene, name: str) -> placement.Vector:
    """Return the middle of the box round an object, the first of that name, when the shutter opens [scene units]."""
    index = [item.name for item in scene.objects].index(name)
    low, high = scene.solids()[index].bounds()
    places = scene.objects[index].places(scene.folders, scene.shutter.open_s)
    middles = places[:, :3, :3] @ ((low + high) / 2) + places[:, :3, 3]
    return np.asarray((middles.min(axis=0) + middles.max(axis=0)) / 2)


def _camera_at(camera: Pose, time_s: float) -> Pose:
    """Return a camera at the place that it has at a moment, on the same way."""
    given = {"eye": camera.eye, "target": camera.target, "up": camera.up}
    frames = tuple(
        frame.model_copy(update={key: value for key, value in given.items() if getattr(frame, key) is None})
        for frame in camera.motion
    )
    eye, target, up = (tuple(row.tolist()) for row in camera.pose_at(time_s))
    return camera.model_copy(update={"eye": eye, "target": target, "up": up, "motion": frames})
