"""From a scene file to a validated scene, from keys to picture settings; and the JSON schema of scene files."""

from __future__ import annotations

import copy
import json
import shlex
from collections.abc import Iterable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError
from pydantic_core import PydanticCustomError

from rptcam_cl.core.errors import InputError, MissingFileError
from rptcam_cl.core.references import Folders
from rptcam_cl.core.strict_yaml import Document, KeyPath, dotted, read_yaml
from rptcam_cl.scene.change import apply_overrides
from rptcam_cl.scene.checks import check_extent
from rptcam_cl.scene.file_reference import file_references
from rptcam_cl.scene.mesh import MeshObject
from rptcam_cl.scene.picture import PictureSettings
from rptcam_cl.scene.problems import Where, input_error, refusal_text, shown
from rptcam_cl.scene.real_lens import GRADES
from rptcam_cl.scene.scene import Scene
from rptcam_cl.scene.shape import Object

Missing = Literal["error", "grey"]

# What becomes a scene first, and how.
_MODELS = (".glb", ".gltf", ".obj", ".ply", ".stl")
NO_SCENES = {".pbrt": "rptcam convert {} scene.yaml makes one of it"}
NO_SCENES |= dict.fromkeys(_MODELS, "rptcam new scene.yaml --model {} makes one round it")


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
        if (hint := NO_SCENES.get(Path(source).suffix.lower())) is not None:
            raise InputError(f"{source}: is no scene file; {hint.format(shlex.quote(str(source)))}")
        document = read_yaml(Path(source))
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


def _as_scene_mapping(data: Any, document: Document | None) -> dict[Any, Any]:
    place = f"{document.name}:1:1: " if document else ""
    if data is None or data == {}:
        raise InputError(f"{place}the scene is empty (allowed: a mapping with at least the key camera)")
    if not isinstance(data, dict):
        raise InputError(f"{place}a scene must be a mapping (got {shown(data)}; allowed: keys such as camera, objects)")
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


def with_files(scene: Scene, where: Where, missing: Missing) -> Scene:
    """Return a scene whose files are where they may be; refuse one with others, naming all that are missing."""
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
    kept, without = _checked_meshes(scene, where, pictures)
    fatal: list[str] = []
    for path, reference in file_references(scene):
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
    if fatal or (missing == "error" and (without or pictures)):
        raise MissingFileError("\n".join(dict.fromkeys((*without, *pictures, *fatal))))
    stand_ins = (
        *(f"{text}; the object is left out" for text in without),
        *(f"{text}; grey stands for it" for text in dict.fromkeys(pictures)),
    )
    return scene.with_stand_ins(kept, stand_ins) if stand_ins else scene


def _checked_meshes(scene: Scene, where: Where, pictures: list[str]) -> tuple[tuple[Object, ...], list[str]]:
    """Return the objects without those whose mesh is missing, and what there is to say of these."""
    absent: list[str] = []
    scene.report_missing_pictures(absent)
    kept: list[Object] = []
    without: list[str] = []
    for index, item in enumerate(scene.objects):
        try:
            if isinstance(item, MeshObject):
                _check_mesh(scene, item, index, where)
            kept.append(item)
        except MissingFileError as problem:
            without.append(str(problem))
        if absent:
            key: KeyPath = ("objects", index, "mesh" if isinstance(item, MeshObject) and item.mesh else "file")
            pictures += [f"{where(key, False)}{dotted(key)}: {text}" for text in absent]
        absent.clear()
    return tuple(kept), without


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
        raise InputError(f"{where((*path, key), False)}{dotted(path)}: {refusal_text(problem)}") from None


def load_picture(settings: Mapping[str, Any], overrides: Iterable[str] = ()) -> PictureSettings:
    """Return picture settings of a mapping, changed by overrides such as ``picture.tone=agx``.

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
        return PictureSettings.model_validate(data["picture"])
    except ValidationError as problem:
        raise input_error(problem, data["picture"], where) from None


def scene_json_schema() -> dict[str, Any]:
    """Return the JSON schema of a scene file (draft 2020-12)."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | Scene.model_json_schema()


def scene_json_schema_text() -> str:
    """Return the JSON schema as the text of `docs/scene.schema.json`."""
    return json.dumps(scene_json_schema(), indent=1, ensure_ascii=False) + "\n"
