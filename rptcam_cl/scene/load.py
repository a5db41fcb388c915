"""From a scene file to a validated scene and back; changes of a scene; errors with place and key path."""

from __future__ import annotations

import copy
import json
import math
import re
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import yaml
from pydantic import ValidationError
from pydantic_core import PydanticCustomError

from rptcam_cl.core.errors import InputError, MissingFileError
from rptcam_cl.core.files import Folders, plain
from rptcam_cl.core.strict_yaml import Document, KeyPath, dotted, parse_scalar, read_yaml
from rptcam_cl.scene.base import REFUSED, FileReference, SceneModel, file_references, listed, near_name
from rptcam_cl.scene.camera import CAMERA_KINDS, Pose
from rptcam_cl.scene.exposure import value_at
from rptcam_cl.scene.film import Film, PictureSettings, WhiteBalance
from rptcam_cl.scene.lens_settings import DESIGN, GRADES, IN_WORDS, LAYERED, REAL, Focus, with_design
from rptcam_cl.scene.materials import MEASURED, WRITTEN_OUT
from rptcam_cl.scene.meshes import WRITTEN_LISTS, MeshObject
from rptcam_cl.scene.placement import Instances, Vector, moments
from rptcam_cl.scene.quantities import SPECTRUM
from rptcam_cl.scene.scene import Scene, check_extent
from rptcam_cl.scene.shapes import Object
from rptcam_cl.scene.textures import CONSTANT

# A scene's data as YAML text: sections in their usual order, one object a line.

_LISTS, _NAMED = ("objects", "lights"), ("materials", "meshes")
_LibDumper: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


class _Dumper(_LibDumper):  # type: ignore[misc]
    """Writes text in quotes where YAML 1.2 would read it as something else; PyYAML alone goes by YAML 1.1."""


def _text(dumper: Any, value: str) -> Any:
    try:
        is_text = isinstance(parse_scalar(value), str)
    except ValueError:
        is_text = False
    return dumper.represent_scalar("tag:yaml.org,2002:str", value, style=None if is_text else '"')


_Dumper.add_representer(str, _text)


def scene_text(scene: Mapping[str, Any], comments: tuple[str, ...] = ()) -> str:
    """Return the YAML text of a scene's data; comments stand above it."""
    lines = [f"# {line}" for comment in comments for line in comment.splitlines()]
    for name in Scene.model_fields:
        if name in scene:
            lines += _section(name, plain(scene[name]))
    return "\n".join([*lines, ""])


def _section(name: str, value: Any) -> Iterator[str]:
    if name in _LISTS and value:
        yield f"{name}:"
        yield from (f"  - {_flow(item)}" for item in value)
    elif name in _NAMED and value:
        yield f"{name}:"
        yield from (f"  {_flow(key)}: {_flow(item)}" for key, item in value.items())
    else:
        yield f"{name}: {_flow(value)}"


def _flow(value: Any) -> str:
    """Return a value on one line."""
    text: str = yaml.dump(
        value, Dumper=_Dumper, default_flow_style=True, sort_keys=False, width=1 << 30, allow_unicode=True
    )
    return text.removesuffix("...\n").rstrip("\n")


# Turns what the scene model refuses into one line each: place, key path, problem, what was given, what is allowed.

_MAX_REPORTED = 5
_SECTIONS = ("camera", "film", "exposure", "shutter", "sequence", "sensor", "spectrum", "render", "picture")

# Names of forms that a value without a kind may have; no keys.
FORMS = (CONSTANT, SPECTRUM, MEASURED, DESIGN, REAL, IN_WORDS, LAYERED)

Where = Callable[[KeyPath, bool], str]

_QUOTED = re.compile(r"'([^']*)'")
_COMPARISONS = {
    "greater_than": ("gt", "more than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}
_WRONG_TYPE = {
    "bool_type": "true or false",
    "string_type": "text",
    "tuple_type": "a list",
    "mapping_type": "a mapping",
    "dict_type": "a mapping",
    "model_attributes_type": "a mapping",
}
_TOO_LONG = {"too_long": "entries", "string_too_long": "letters"}


class _Finding(NamedTuple):
    """What an error says: the problem, what was given, what is allowed, and whether to point at the key itself."""

    problem: str
    got: str = ""
    allowed: str = ""
    at_key: bool = False


def input_error(error: ValidationError, data: Any, where: Where) -> InputError:
    """Return the error to show to the user.

    Parameters
    ----------
    error : ValidationError
        What the model found.
    data : mapping
        The data that the model was given.
    where : callable
        Returns the place of a key path, ``FILE:LINE:COL: `` or the like; the flag: that of the key, not of its value.
    """
    lines = [_line(item, data, where) for item in error.errors(include_url=False)[:_MAX_REPORTED]]
    if error.error_count() > _MAX_REPORTED:
        lines.append(f"and {error.error_count() - _MAX_REPORTED} more problems")
    return InputError("\n".join(dict.fromkeys(lines)))  # a number that stands for three channels is wrong once


def _line(item: Any, data: Any, where: Where) -> str:
    context = item.get("ctx", {})
    location = item["loc"]
    path, value = _follow(location, data)
    if location[-1:] == ("[key]",):
        path, value = path[:-2], location[-2]
    for key in context.get("path", ()):
        path, value = (*path, key), _child(value, key)
    if item["type"] in ("union_tag_invalid", "union_tag_not_found"):
        key = "shape" if "shape" in context["discriminator"] else "kind"  # textures are distinguished by a function
        path, value = (*path, key), context.get("tag")
    finding = _explain(item["type"], item["msg"], context, value)
    if finding.problem == "unknown key" and isinstance(data, Mapping) and "camera" in data:  # of a scene
        finding = finding._replace(problem=finding.problem + _elsewhere(str(path[-1])))
    details = "; ".join(part for part in (finding.got, finding.allowed and f"allowed: {finding.allowed}") if part)
    subject = f"{dotted(path)}: " if path else ""
    return f"{where(path, finding.at_key)}{subject}{finding.problem}" + (f" ({details})" if details else "")


def _follow(location: tuple[Any, ...], data: Any) -> tuple[KeyPath, Any]:
    """Return the key path and value of a pydantic location, without the names of union members in it.

    No field is called like the kind or shape of its model, so a part of that name is always a union member.
    """
    path: KeyPath = ()
    value = data
    passed_tag = False
    for key in location:
        if isinstance(value, Mapping):
            if not passed_tag and key in (value.get("kind"), value.get("shape"), WRITTEN_OUT):
                passed_tag = True
                continue
            if key not in value and (isinstance(key, int) or key in FORMS):
                continue
        elif not (isinstance(value, (list, tuple)) and isinstance(key, int)):
            continue
        path, value, passed_tag = (*path, key), _child(value, key), False
    return path, value


def _child(value: Any, key: str | int) -> Any:
    """Look up a key or an index; None when nothing is there."""
    if isinstance(value, Mapping):
        return value.get(key)
    if isinstance(value, (list, tuple)) and isinstance(key, int) and key < len(value):
        return value[key]
    return None


def _explain(kind: str, message: str, context: dict[str, Any], value: Any) -> _Finding:
    """Word an error of pydantic's."""
    got = f"got {_shown(context.get('got', value))}"
    if kind == REFUSED:
        problem = context["problem"]
        return _Finding(problem, got, context["allowed"], at_key=problem.startswith("unknown key"))
    if kind in _COMPARISONS:
        name, words = _COMPARISONS[kind]
        return _Finding("is out of range", got, f"{words} {_shown(context[name])}")
    if kind in ("missing", "union_tag_not_found"):
        return _Finding("is required but missing", at_key=True)
    if kind in ("literal_error", "union_tag_invalid"):
        expected = str(context.get("expected", context.get("expected_tags")))
        names = _QUOTED.findall(expected) or re.findall(r"\d+", expected)
        choices = [name for name in names if name != CONSTANT]
        return _Finding(f"is not a known choice{near_name(value, choices)}", got, listed(choices))
    if kind in _TOO_LONG:
        return _Finding("is too long", got, f"at most {context['max_length']} {_TOO_LONG[kind]}")
    if kind in _WRONG_TYPE:
        return _Finding(f"must be {_WRONG_TYPE[kind]}", got)
    return _Finding(message[:1].lower() + message[1:], got)


def _elsewhere(key: str) -> str:
    """Return ``; did you mean section.key?`` for a key that a section of the scene has, or nothing."""
    from rptcam_cl.scene.scene import Scene

    for name in _SECTIONS:
        if any(key in model.model_fields for model in _models(Scene.model_fields[name].annotation)):
            return f"; did you mean {name}.{key}?"
    return ""


def _models(annotation: Any) -> Iterator[type[SceneModel]]:
    """Yield the models that a type is made of."""
    if isinstance(annotation, type) and issubclass(annotation, SceneModel):
        yield annotation
    for part in get_args(annotation):
        yield from _models(part)


def _refusal_text(refusal: PydanticCustomError) -> str:
    """The text of a refusal outside the model's own validation."""
    context = dict(refusal.context or {})
    return f"{context['problem']} (got {_shown(context['got'])}; allowed: {context['allowed']})"


def _shown(value: Any) -> str:
    """Return a value as it would stand in YAML, cut short."""
    if isinstance(value, Mapping):
        return f"a mapping with {listed([str(key) for key in value], most=6)}" if value else "an empty mapping"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_shown(item) for item in value[:6]) + (", …]" if len(value) > 6 else "]")
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.6g}" if math.isfinite(value) else f".{value!r}".replace(".-", "-.")
    text = str(value) if not isinstance(value, int) or abs(value) < 10**40 else "an integer of more than 40 digits"
    text = repr(text) if isinstance(value, str) else text
    return text if len(text) <= 60 else text[:57] + "…"


# Changes to a scene: to its data before it is checked (``camera.f_number=4``), or to a loaded scene.

# Where keys that exclude each other live, and the models that say which they are.
_EXCLUSIVE: dict[KeyPath, tuple[type[SceneModel], ...]] = {
    ("film",): (Film,),
    ("camera",): CAMERA_KINDS,
    ("camera", "focus"): (Focus,),
    ("picture",): (PictureSettings,),
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
        value[place] = value = _copy_to_change(value[place])
        if not isinstance(value, (dict, list)):
            problem = f"is {_shown(value)} and has no keys{_hint(path, value)}"
            raise InputError(f"{text}: {dotted(path[:length])}: {problem}")
    return value


def _copy_to_change(value: Any) -> Any:
    """Return a copy of a mapping, a list or a part of a scene, to be changed; other values as they are."""
    if isinstance(value, SceneModel):
        return set_fields(value)
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
    data = set_fields(scene)
    for name, changes in parts.items():
        data[name] = set_fields(getattr(scene, name)) | dict(changes)
    return _checked(scene, data, parts)


def with_camera(scene: Scene, keys: Mapping[str, Any]) -> Scene:
    """Return a copy of a scene with another camera, given by its keys, checked as `change_scene` does.

    Raises
    ------
    InputError
        When the camera is not valid, or does not fit the scene.
    """
    return _checked(scene, set_fields(scene) | {"camera": dict(keys)}, ("camera",))


def _checked(scene: Scene, data: dict[str, Any], changed: Iterable[str]) -> Scene:
    made_of = scene.made_of | {name: data[name] for name in changed}
    try:
        return Scene.model_validate(data, context=_context(scene, set()) | {"made_of": made_of})
    except ValidationError as problem:
        raise input_error(problem, data, lambda path, at_key: "") from None


def set_fields(part: SceneModel) -> dict[str, Any]:
    """Return the keys that were given to a part of a scene."""
    return {name: getattr(part, name) for name in part.model_fields_set}


# From a scene file to a validated scene, from keys to picture settings; and the JSON schema of scene files.

Missing = Literal["error", "grey"]

LARGEST_FILE, MOST_VALUES = 1 << 28, 5_000_000  # of a scene: bytes, and values, some 500 bytes of memory each

# What becomes a scene first, and how.
_MODELS = (".glb", ".gltf", ".obj", ".ply", ".stl")
_NO_SCENES = {".pbrt": "rptcam convert {} scene.yaml makes one of it"}
_NO_SCENES |= dict.fromkeys(_MODELS, "rptcam new scene.yaml --model {} makes one round it")


def load_scene(
    source: str | PathLike[str] | Mapping[str, Any],
    overrides: Iterable[str] = (),
    *,
    base_dir: str | PathLike[str] | None = None,
    allow_folders: Iterable[str | PathLike[str]] = (),
    missing: Missing = "error",
) -> Scene:
    """Return the scene of a YAML or JSON file, or of a mapping of the same form.

    Parameters
    ----------
    source : path or mapping
        The scene file, or its content as Python data.
    overrides : iterable of str
        Changes such as ``camera.f_number=4``, made in their order before the scene is checked. A key that excludes
        others replaces them (``camera.f_number`` removes ``camera.stop_diameter_mm``); ``null`` removes a key.
    base_dir : path, optional
        Folder where relative paths start; the scene file's own by default, the working folder for a mapping.
    allow_folders : iterable of path
        Further folders from which the scene may read files.
    missing : "error" or "grey"
        What becomes of files that are not there: an error that names them all, or a scene with grey in place of
        pictures and without the objects whose meshes are missing, each of which is a warning.

    Raises
    ------
    InputError
        ``FILE:LINE:COL: key.path: problem (got …; allowed …)``, one line for each of the first problems.
    StateError
        When the file cannot be read.
    """
    document: Document | None = None
    if isinstance(source, Mapping):
        data: Any = copy.deepcopy(dict(source))
        folder = Path.cwd()
    else:
        if (hint := _NO_SCENES.get(Path(source).suffix.lower())) is not None:
            raise InputError(f"{source}: is no scene file; {hint.format(shlex.quote(str(source)))}")
        document = read_yaml(Path(source), most_bytes=LARGEST_FILE, most_values=MOST_VALUES)
        data, folder = document.data, Path(source).absolute().parent
    data = _as_scene_mapping(data, document)
    labels = apply_overrides(data, overrides)
    where = _locator(document, labels)
    folders = Folders(Path(base_dir) if base_dir is not None else folder, tuple(Path(item) for item in allow_folders))
    try:
        scene = Scene.model_validate(data, context={"folders": folders, "made_of": data})
    except ValidationError as problem:
        raise input_error(problem, data, where) from None
    return _with_files(scene, where, missing)


def _as_scene_mapping(data: Any, document: Document | None) -> dict[Any, Any]:
    place = f"{document.name}:1:1: " if document else ""
    if data is None or data == {}:
        raise InputError(f"{place}the scene is empty (allowed: a mapping with at least the key camera)")
    if not isinstance(data, dict):
        raise InputError(
            f"{place}a scene must be a mapping (got {_shown(data)}; allowed: keys such as camera, objects)"
        )
    return data


def _locator(document: Document | None, labels: dict[KeyPath, str]) -> Where:
    """Return the function that names the place of a key path: the override that set it, or file, line and column."""

    def where(path: KeyPath, at_key: bool) -> str:
        for length in range(len(path), 0, -1):
            if path[:length] in labels:
                return f"--set {labels[path[:length]]}: "
        made = [text for key, text in labels.items() if key[: len(path)] == path]
        if at_key and path and made:
            return f"--set {made[-1]}: "
        if document is None:
            return ""
        line, column = document.key_mark(path) if at_key else document.mark(path)
        return f"{document.name}:{line}:{column}: "

    return where


def _with_files(scene: Scene, where: Where, missing: Missing, before: Scene | None = None) -> Scene:
    """Return a scene whose files are where they may be; refuse one with others, naming all that are missing.

    What it has in common with the scene ``before`` is taken to be as it was.
    """
    try:
        scene.lens_source()
    except InputError as problem:
        raise InputError(f"{where(('camera', 'lens'), False)}camera.lens: {problem}") from None
    try:
        scene.tolerances_source()
    except InputError as problem:
        key: KeyPath = ("camera", "lens", "as_built", "spec")
        hint = f"; a grade is one of {', '.join(GRADES)}" if isinstance(problem, MissingFileError) else ""
        raise type(problem)(f"{where(key, False)}{dotted(key)}: {problem}{hint}") from None
    pictures: list[str] = []
    is_new = before is None or scene.objects is not before.objects
    kept, without = _check_meshes(scene, where, pictures) if is_new else (scene.objects, [])
    fatal: list[str] = []
    for path, reference in _new_references(scene, before):
        key = (*path, "file")
        reference.locate(f"{where(key, False)}{dotted(key)}: ")
        try:
            reference.source(scene.folders)
        except InputError as problem:
            message = f"{reference.place}{problem}"
            if not isinstance(problem, MissingFileError):
                raise InputError(message) from None
            (pictures if reference.stand_in is not None else fatal).append(message)
            if reference.stand_in is not None:
                reference.hold(reference.stand_in)
            continue
        if isinstance(reference, Instances):
            table = reference.matrices(scene.folders)
            _check_instances(scene, path[:2], where)
            del table  # read once for both checks
    if fatal or (missing == "error" and (without or pictures)):
        raise MissingFileError("\n".join(dict.fromkeys((*without, *pictures, *fatal))))
    stand_ins = (
        *(f"{text}; the object is left out" for text in without),
        *(f"{text}; grey stands for it" for text in dict.fromkeys(pictures)),
    )
    return scene.with_stand_ins(kept, stand_ins) if stand_ins else scene


def _new_references(scene: Scene, before: Scene | None) -> Iterator[tuple[KeyPath, FileReference]]:
    """Yield the parts of a scene that name a file and are not in the scene before, with the keys that lead to them."""
    if before is None:
        yield from file_references(scene)
        return
    for name in Scene.model_fields:
        section, earlier = getattr(scene, name), getattr(before, name)
        if section is earlier:
            continue
        if name == "objects":
            new: Iterable[tuple[KeyPath, Any]] = (((index,), item) for index, item in scene.new_objects())
        else:
            known = {id(part) for _, part in _items(earlier)}
            new = [each for each in _items(section) if id(each[1]) not in known]
        for path, part in new:
            yield from file_references(part, (name, *path))


def _check_instances(scene: Scene, path: KeyPath, where: Where) -> None:
    """Refuse an object that its table of places makes too large or too small."""
    item = scene.objects[int(path[1])]
    try:
        check_extent(item, item if not isinstance(item, MeshObject) else scene.load_mesh(item), path, scene.folders)
    except PydanticCustomError as problem:
        key = (*path, "instances")
        raise InputError(f"{where(key, False)}{dotted(key)}: {_refusal_text(problem)}") from None


def _items(section: Any) -> Iterable[tuple[KeyPath, Any]]:
    """Return the items of a section of a scene with their keys; the section itself where it has none."""
    if isinstance(section, Mapping):
        return (((key,), item) for key, item in section.items())
    if isinstance(section, tuple):
        return (((index,), item) for index, item in enumerate(section))
    return [((), section)]


def _material_of(item: Any) -> Any:
    return getattr(item, "material", None)


def _check_meshes(scene: Scene, where: Where, pictures: list[str]) -> tuple[tuple[Object, ...], list[str]]:
    """Return the objects without those whose mesh is missing, and what there is to say of these."""
    absent: list[str] = []
    if not scene.new_objects() and not scene.holds_old_meshes():
        return scene.objects, []
    scene.report_missing_pictures(absent)
    gone: set[int] = set()
    without: list[str] = []
    for index, item in scene.new_objects():
        if not isinstance(item, MeshObject):
            continue
        try:
            _check_mesh(scene, item, index, where)
        except MissingFileError as problem:
            without.append(str(problem))
            gone.add(index)
        if absent:
            key: KeyPath = ("objects", index, "mesh" if item.mesh else "file")
            pictures += [f"{where(key, False)}{dotted(key)}: {text}" for text in absent]
        absent.clear()
    kept = tuple(item for index, item in enumerate(scene.objects) if index not in gone) if gone else scene.objects
    return kept, without


def _check_mesh(scene: Scene, item: MeshObject, index: int, where: Where) -> None:
    """Refuse a mesh that cannot be loaded, or that its transform makes too large or too small."""
    path: KeyPath = ("objects", index)
    key = next(key for key in ("file", "mesh", "vertices") if getattr(item, key) is not None)
    try:
        mesh = scene.load_mesh(item)
        key = "transform" if item.transform else key
        check_extent(item, mesh, path)
    except InputError as problem:
        raise type(problem)(f"{where((*path, key), False)}{dotted((*path, key))}: {problem}") from None
    except PydanticCustomError as problem:
        raise InputError(f"{where((*path, key), False)}{dotted(path)}: {_refusal_text(problem)}") from None


def load_picture(
    settings: Mapping[str, Any],
    overrides: Iterable[str] = (),
    *,
    folders: Folders | None = None,
    before: PictureSettings | None = None,
) -> PictureSettings:
    """Return picture settings of a mapping, changed by overrides such as ``picture.tone=agx``.

    Parameters
    ----------
    folders
        Where the files that they name may lie; the working folder by default.
    before
        Settings whose files are known: those of the same names are not read again.

    Raises
    ------
    InputError
        A key or a value is wrong, or an override is not of `picture`.
    """
    data: dict[Any, Any] = {"picture": dict(settings)}
    labels = apply_overrides(data, overrides)
    for path, text in labels.items():
        if path[0] != "picture" or len(path) < 2:
            raise InputError(f"--set {text}: the film is there already (allowed: keys of picture, as picture.tone=agx)")

    def where(path: tuple[str | int, ...], at_key: bool) -> str:
        made = [text for key, text in labels.items() if key[1 : 1 + len(path)] == path[: len(key) - 1]]
        return f"--set {made[-1]}: picture." if made else "picture."

    try:
        return PictureSettings.model_validate(data["picture"], context={"folders": folders, "before": before})
    except ValidationError as problem:
        raise input_error(problem, data["picture"], where) from None


def scene_json_schema() -> dict[str, Any]:
    """Return the JSON schema of a scene file (draft 2020-12)."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | Scene.model_json_schema()


def scene_json_schema_text() -> str:
    """Return the JSON schema as the text of `docs/scene.schema.json`."""
    return json.dumps(scene_json_schema(), indent=1, ensure_ascii=False) + "\n"


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
    return _with_files(changed, _nowhere, "grey" if scene.stand_ins else "error", earlier)


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


def _mixes_its_own(item: Any, names: Mapping[int, str]) -> bool:
    """Return whether a material is mixed in an object, of which others may have changed."""
    return id(_material_of(item)) not in names and _is_mix(_material_of(item))


def _with_known_lists(plain: Any, before: Any, item: Object) -> Any:
    """Return the mapping of a changed object with the lists of numbers that it had before as they were read then."""
    if not (isinstance(plain, Mapping) and isinstance(before, Mapping)):
        return plain
    same = [key for key in WRITTEN_LISTS if plain.get(key) is not None and plain[key] is before.get(key)]
    return dict(plain) | {key: getattr(item, key) for key in same}


def _with_material_name(item: Any, names: Mapping[int, str]) -> Any:
    """Return the keys of an object whose material is one of the scene's, with its name; else the item."""
    name = names.get(id(_material_of(item)))
    if not isinstance(item, SceneModel) or name is None:
        return item
    return {key: getattr(item, key) for key in item.model_fields_set} | {"material": name}


def _nowhere(path: KeyPath, at_key: bool) -> str:
    return ""


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
    first, *poses = (scene.camera.pose_at(time_s) for time_s in moments(scene.camera.motion, *span))
    if any(not np.array_equal(pose, first) for pose in poses):
        return True
    for name, frames in scene.shutter.keys.items():
        begin, *values = (value_at(frames, time_s) for time_s in moments(frames, *span))
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
    values = {name: value_at(frames, time_s) for name, frames in scene.shutter.keys.items()}
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


def _middle_of(scene: Scene, name: str) -> Vector:
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
