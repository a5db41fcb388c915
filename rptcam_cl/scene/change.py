"""Changes to a scene: to its data before it is checked (``camera.f_number=4``), or to a loaded scene."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import ValidationError

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.strict_yaml import KeyPath, dotted, read_yaml
from rptcam_cl.scene.base import SceneModel
from rptcam_cl.scene.camera import LensCamera, ThinLensCamera
from rptcam_cl.scene.film import Film
from rptcam_cl.scene.focus import Focus
from rptcam_cl.scene.picture import WhiteBalance
from rptcam_cl.scene.problems import input_error, shown
from rptcam_cl.scene.real_lens import with_design
from rptcam_cl.scene.scene import Scene

# Where keys that exclude each other live, and the models that say which they are.
_EXCLUSIVE: dict[KeyPath, tuple[type[SceneModel], ...]] = {
    ("film",): (Film,),
    ("camera",): (ThinLensCamera, LensCamera),
    ("camera", "focus"): (Focus,),
    ("picture", "white_balance"): (WhiteBalance,),
}

# Parts that a word stands for, and the key whose value that word is.
_WORDS: dict[KeyPath, str] = {("exposure",): "mode", ("spectrum",): "mode"}


def apply_overrides(data: dict[Any, Any], overrides: Iterable[str]) -> dict[KeyPath, str]:
    """Change a scene's data in place; return the text of each override by the key path that it set.

    Each override is ``key.path=value`` with a YAML value: ``camera.f_number=4``, ``objects.0.radius=2`` or
    ``film.resolution=[320, 180]``. Mappings on the way are made when missing. A key that excludes others replaces them:
    ``camera.f_number=4`` removes ``camera.stop_diameter_mm``. The value ``null`` removes the key.
    """
    labels: dict[KeyPath, str] = {}
    for text in overrides:
        path, value = _parse(text)
        parent = assign(data, path, value, f"--set {text}")
        # An entry taken out of a list moves the others away from their places in the file.
        moved = isinstance(parent, list) and value is None
        labels[path[:-1] if moved else path] = text
    return labels


def _parse(text: str) -> tuple[KeyPath, Any]:
    key, equals, value = text.partition("=")
    path = key_path(key)
    if not equals or not path:
        raise InputError(f"--set {text}: is not of the form key.path=value (for instance camera.f_number=4)")
    return path, (read_yaml(value, name=f"--set {text}").data if value.strip() else None)


def key_path(text: str) -> KeyPath:
    """Return the key path of ``objects.0.radius`` or ``objects[0].radius``; an empty one where it is none."""
    dots = re.sub(r"\[(\d+)\]", r".\1", text.strip()).split(".")
    return () if "" in dots else tuple(int(part) if re.fullmatch(r"\d{1,9}", part) else part for part in dots)


def assign(data: dict[Any, Any], path: KeyPath, value: Any, text: str) -> Any:
    """Set a key of a scene's data, whose mappings and lists on the way are replaced by copies.

    Parameters
    ----------
    value
        None removes the key.
    text
        What errors begin with.

    Returns
    -------
    mapping or list
        That has the key.
    """
    parent = _parent(data, path, text)
    _assign(parent, path, value, text)
    return parent


def _parent(data: dict[Any, Any], path: KeyPath, text: str) -> Any:
    """Return the mapping or list that holds the last key of a path, making mappings that are missing."""
    value: Any = data
    for length, key in enumerate(path[:-1], start=1):
        if isinstance(value, dict):
            if value.get(_key(value, key)) is None:
                value[_key(value, key)] = {}
            if path[:length] == ("camera", "lens"):
                value[key] = with_design(value[key], str(path[length]))
            if path[:length] in _WORDS and isinstance(value[key], str):
                value[key] = {_WORDS[path[:length]]: value[key]}
            place = _key(value, key)
        else:
            place = _index(value, key, path[: length - 1], text)
        value[place] = value = _opened(value[place])
        if not isinstance(value, (dict, list)):
            problem = f"is {shown(value)} and has no keys{_hint(path, value)}"
            raise InputError(f"{text}: {dotted(path[:length])}: {problem}")
    return value


def _opened(value: Any) -> Any:
    """Return a copy of a mapping, a list or a part of a scene, to be changed; other values as they are."""
    if isinstance(value, SceneModel):
        return _fields(value)
    if isinstance(value, Mapping):
        return dict(value)
    return list(value) if isinstance(value, (list, tuple)) else value


def _hint(path: KeyPath, value: Any) -> str:
    """Return where the keys of a material that is given by its name are found."""
    if "material" in path[:-1] and isinstance(value, str):
        return f"; set materials.{value}.{path[-1]} instead"
    return ""


def _key(mapping: dict[Any, Any], key: str | int) -> Any:
    """Return a path's key as it is written in a mapping, whose keys are words."""
    return str(key) if isinstance(key, int) and key not in mapping else key


def _index(items: list[Any], key: str | int, path: KeyPath, text: str) -> int:
    if not isinstance(key, int) or key >= len(items):
        span = f"0 to {len(items) - 1}" if items else "nothing, it is empty"
        raise InputError(f"{text}: {dotted(path)}: no such entry (got {key}; allowed: {span})")
    return key


def _assign(parent: Any, path: KeyPath, value: Any, text: str) -> None:
    if isinstance(parent, list):
        index = _index(parent, path[-1], path[:-1], text)
        if value is None:
            del parent[index]
        else:
            parent[index] = value
        return
    key = _key(parent, path[-1])
    if value is None:
        parent.pop(key, None)
        return
    for rival in _rivals(path):
        parent.pop(rival, None)
    parent[key] = value


def _rivals(path: KeyPath) -> set[str]:
    """Return the keys that the last key of a path excludes."""
    groups = [group for model in _EXCLUSIVE.get(path[:-1], ()) for group in model.alternatives]
    return {name for group in groups if path[-1] in group.keys for name in group.keys} - {str(path[-1])}


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
    data = _fields(scene)
    for name, changes in parts.items():
        data[name] = _fields(getattr(scene, name)) | dict(changes)
    return _checked(scene, data, parts)


def with_camera(scene: Scene, keys: Mapping[str, Any]) -> Scene:
    """Return a copy of a scene with another camera, given by its keys, checked as `change_scene` does.

    Raises
    ------
    InputError
        When the camera is not valid, or does not fit the scene.
    """
    return _checked(scene, _fields(scene) | {"camera": dict(keys)}, ("camera",))


def _checked(scene: Scene, data: dict[str, Any], changed: Iterable[str]) -> Scene:
    made_of = scene.made_of | {name: data[name] for name in changed}
    try:
        return Scene.model_validate(data, context={"scene": scene, "folders": scene.folders, "made_of": made_of})
    except ValidationError as problem:
        raise input_error(problem, data, lambda path, at_key: "") from None


def _fields(part: SceneModel) -> dict[str, Any]:
    """Return the keys that were given to a part of a scene."""
    return {name: getattr(part, name) for name in part.model_fields_set}
