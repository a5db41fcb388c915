"""From a scene file, with changes such as `--set`, to a validated scene and back; errors with place and key path."""

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

import yaml
from pydantic import ValidationError
from pydantic_core import PydanticCustomError

from rptcam_cl.core.errors import InputError, MissingFileError, near_name
from rptcam_cl.core.files import Folders, plain
from rptcam_cl.core.strict_yaml import Document, KeyPath, dotted, parse_scalar, read_yaml
from rptcam_cl.scene import camera, materials, meshes, placement, quantities, shapes, textures
from rptcam_cl.scene.base import REFUSED, FileReference, SceneModel, file_references, listed
from rptcam_cl.scene.film import Film, PictureSettings, WhiteBalance
from rptcam_cl.scene.lens_settings import DESIGN, GRADES, IN_WORDS, LAYERED, REAL, Focus, with_design
from rptcam_cl.scene.scene import Scene, check_extent

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


def plain_data(scene: Scene) -> dict[str, Any]:
    """Return the data of a scene, as a file has them."""
    return {
        name: value.model_dump(mode="json", exclude_unset=True) if hasattr(value, "model_dump") else plain(value)
        for name, value in scene.made_of.items()
    }


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
FORMS = (textures.CONSTANT, quantities.SPECTRUM, materials.MEASURED, DESIGN, REAL, IN_WORDS, LAYERED)

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
            if not passed_tag and key in (value.get("kind"), value.get("shape"), materials.WRITTEN_OUT):
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
    got = f"got {_value_text(context.get('got', value))}"
    if kind == REFUSED:
        problem = context["problem"]
        return _Finding(problem, got, context["allowed"], at_key=problem.startswith("unknown key"))
    if kind in _COMPARISONS:
        name, words = _COMPARISONS[kind]
        return _Finding("is out of range", got, f"{words} {_value_text(context[name])}")
    if kind in ("missing", "union_tag_not_found"):
        return _Finding("is required but missing", at_key=True)
    if kind in ("literal_error", "union_tag_invalid"):
        expected = str(context.get("expected", context.get("expected_tags")))
        names = _QUOTED.findall(expected) or re.findall(r"\d+", expected)
        choices = [name for name in names if name != textures.CONSTANT]
        if value in choices and value not in _QUOTED.findall(expected):
            return _Finding("is text, not a number (write it without quotes)", got, listed(choices))
        return _Finding(f"is not a known choice{near_name(value, choices)}", got, listed(choices))
    if kind in _TOO_LONG:
        return _Finding("is too long", got, f"at most {context['max_length']} {_TOO_LONG[kind]}")
    if kind in _WRONG_TYPE:
        return _Finding(f"must be {_WRONG_TYPE[kind]}", got)
    return _Finding(message[:1].lower() + message[1:], got)


def _elsewhere(key: str) -> str:
    """Return ``; did you mean section.key?`` for a key that a section of the scene has, or nothing."""
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
    return f"{context['problem']} (got {_value_text(context['got'])}; allowed: {context['allowed']})"


def _value_text(value: Any) -> str:
    """Return a value as it would stand in YAML, cut short."""
    if isinstance(value, Mapping):
        return f"a mapping with {listed([str(key) for key in value], most=6)}" if value else "an empty mapping"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_value_text(item) for item in value[:6]) + (", …]" if len(value) > 6 else "]")
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.6g}" if math.isfinite(value) else f".{value!r}".replace(".-", "-.")
    text = str(value) if not isinstance(value, int) or abs(value) < 10**40 else "an integer of more than 40 digits"
    text = repr(text) if isinstance(value, str) else text
    return text if len(text) <= 60 else text[:57] + "…"


# Changes to the data of a scene before it is checked (``camera.f_number=4``).

# Where keys that exclude each other live, and the models that say which they are.
_EXCLUSIVE: dict[KeyPath, tuple[type[SceneModel], ...]] = {
    ("film",): (Film,),
    ("camera",): camera.CAMERA_KINDS,
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
            problem = f"is {_value_text(value)} and has no keys{_hint(path, value)}"
            raise InputError(f"{text}: {dotted(path[:length])}: {problem}")
    return value


def given_keys(part: SceneModel) -> dict[str, Any]:
    """Return the keys that were given to a part of a scene."""
    return {name: getattr(part, name) for name in part.model_fields_set}


def _copy_to_change(value: Any) -> Any:
    """Return a copy of a mapping, a list or a part of a scene, to be changed; other values as they are."""
    if isinstance(value, SceneModel):
        return given_keys(value)
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
    return with_files(scene, where, missing)


SceneSource = Scene | str | Path | Mapping[str, Any]


def read_scene(source: SceneSource) -> Scene:
    """Return the scene itself, or that of anything that `load_scene` takes."""
    return source if isinstance(source, Scene) else load_scene(source)


def _as_scene_mapping(data: Any, document: Document | None) -> dict[Any, Any]:
    place = f"{document.name}:1:1: " if document else ""
    if data is None or data == {}:
        raise InputError(f"{place}the scene is empty (allowed: a mapping with at least the key camera)")
    if not isinstance(data, dict):
        raise InputError(
            f"{place}a scene must be a mapping (got {_value_text(data)}; allowed: keys such as camera, objects)"
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
        return "" if document is None else f"{document.where(path, at_key)}: "

    return where


def with_files(scene: Scene, where: Where, missing: Missing, before: Scene | None = None) -> Scene:
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
        if isinstance(reference, placement.Instances):
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
        check_extent(
            item, item if not isinstance(item, meshes.MeshObject) else scene.load_mesh(item), path, scene.folders
        )
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


def _check_meshes(scene: Scene, where: Where, pictures: list[str]) -> tuple[tuple[shapes.Object, ...], list[str]]:
    """Return the objects without those whose mesh is missing, and what there is to say of these."""
    absent: list[str] = []
    if not scene.new_objects() and not scene.holds_old_meshes():
        return scene.objects, []
    scene.report_missing_pictures(absent)
    gone: set[int] = set()
    without: list[str] = []
    for index, item in scene.new_objects():
        if not isinstance(item, meshes.MeshObject):
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


def _check_mesh(scene: Scene, item: meshes.MeshObject, index: int, where: Where) -> None:
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
