"""Keys of a scene set to other values: what they do not concern stays the same instances."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import ValidationError

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.strict_yaml import KeyPath
from rptcam_cl.scene.base import SceneModel
from rptcam_cl.scene.change import assign, key_path
from rptcam_cl.scene.load import with_files
from rptcam_cl.scene.problems import input_error
from rptcam_cl.scene.scene import Scene

# Parts that are made anew with another: objects have materials and meshes.
DEPENDENT = {"materials": ("objects",), "meshes": ("objects",)}
UP = ("environment", "lights")  # parts whose defaults come from the camera's up
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
    data, paths = dict(before), []
    for text, value in changes.items():
        path = _path(text)
        assign(data, path, copy.deepcopy(value), text)
        paths.append(path)
    touched = {str(path[0]) for path in paths}
    renewed = touched | {name for part in touched for name in DEPENDENT.get(part, ())}
    if any(path[0] == "camera" and (len(path) == 1 or path[1] == "up") for path in paths):
        renewed |= set(UP)
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
    """Return the data of objects; those that stay as they were, as they are; others with names for their materials.

    Parameters
    ----------
    touched
        Names of the materials that do not stay; None where nothing does.
    """
    listed = before.get("objects") or ()
    known = {id(plain): item for plain, item in zip(listed, scene.objects, strict=False)}
    names = {id(material): name for name, material in scene.materials.items()}
    wanted = data.get("objects") or ()
    if not isinstance(wanted, (list, tuple)):
        return wanted  # type: ignore[no-any-return]
    if touched is None:
        return [_named(plain, names) for plain in wanted]
    if not touched:
        return [known.get(id(plain), plain) for plain in wanted]

    def stays(item: Any) -> bool:
        material = getattr(item, "material", None)
        return names.get(id(material)) not in touched and not _is_mix(material)

    found = ((plain, known.get(id(plain))) for plain in wanted)
    return [item if item is not None and stays(item) else _named(plain, names) for plain, item in found]


def _named(item: Any, names: Mapping[int, str]) -> Any:
    """Return the keys of an object whose material is one of the scene's, with its name; else the item."""
    name = names.get(id(getattr(item, "material", None)))
    if not isinstance(item, SceneModel) or name is None:
        return item
    return {key: getattr(item, key) for key in item.model_fields_set} | {"material": name}


def _nowhere(path: KeyPath, at_key: bool) -> str:
    return ""
