"""Keys of a scene set to other values: what they do not concern stays the same instances."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.strict_yaml import KeyPath
from rptcam_cl.scene.base import SceneModel
from rptcam_cl.scene.change import assign, key_path
from rptcam_cl.scene.load import with_files
from rptcam_cl.scene.problems import input_error
from rptcam_cl.scene.scene import Scene

# Parts that are made anew with another: objects have materials and meshes, and defaults come from the camera's up.
DEPENDENT = {"materials": ("objects",), "meshes": ("objects",), "camera": ("environment", "lights")}
WITHOUT_FILES = {"film", "exposure", "shutter", "render", "picture", "spectrum"}


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
    data, touched = dict(before), set()
    for text, value in changes.items():
        path = _path(text)
        assign(data, path, copy.deepcopy(value), text)
        touched.add(str(path[0]))
    renewed = touched | {name for part in touched for name in DEPENDENT.get(part, ())}
    given = {name: value if name in renewed else getattr(scene, name) for name, value in data.items()}
    if "objects" in renewed:
        given["objects"] = _objects(scene, before, data, kept=not touched & {"materials", "meshes"})
    try:
        changed = Scene.model_validate(given, context=_context(scene, touched) | {"made_of": data})
    except ValidationError as problem:
        raise input_error(problem, data, _nowhere) from None
    if touched <= WITHOUT_FILES:
        return changed
    return with_files(changed, _nowhere, "grey" if scene.stand_ins else "error")


def _path(text: str) -> KeyPath:
    path = key_path(text)
    if not path:
        raise InputError(f"{text or 'changes'}: is no key path (allowed: keys with dots between, as camera.f_number)")
    return path


def _context(scene: Scene, touched: set[str]) -> dict[str, Any]:
    """Return how files are found: from the meshes that are loaded already, unless other ones have their names."""
    return {"folders": scene.folders} if "meshes" in touched else {"scene": scene}


def _objects(scene: Scene, before: Mapping[str, Any], data: Mapping[str, Any], *, kept: bool) -> list[Any]:
    """Return the data of objects; those that stay as they were, as they are; others with names for their materials."""
    listed = before.get("objects") or ()
    known = {id(plain): item for plain, item in zip(listed, scene.objects, strict=False)}
    names = {id(material): name for name, material in scene.materials.items()}
    wanted = data.get("objects") or ()
    if not isinstance(wanted, (list, tuple)):
        return wanted  # type: ignore[no-any-return]
    if kept:
        return [known.get(id(plain), plain) for plain in wanted]
    return [_named(plain, names) for plain in wanted]


def _named(item: Any, names: Mapping[int, str]) -> Any:
    """Return the keys of an object whose material is one of the scene's, with its name; else the item."""
    name = names.get(id(getattr(item, "material", None)))
    if not isinstance(item, SceneModel) or name is None:
        return item
    return {key: getattr(item, key) for key in item.model_fields_set} | {"material": name}


def _nowhere(path: KeyPath, at_key: bool) -> str:
    return ""
