"""The specification of a dataset: a scene, what stays set in it, and the keys that are drawn for each frame."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import Any

from rptcam_cl._version import __version__
from rptcam_cl.calibration import COEFFICIENTS, view
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, RptcamError
from rptcam_cl.core.strict_yaml import Document, KeyPath, dotted, read_yaml
from rptcam_cl.datasets.draws import Distribution, DistributionError, distribution, seed_of_frame, values_of_frame
from rptcam_cl.datasets.numbered import numbered
from rptcam_cl.imaging import MOST_INSTANCES
from rptcam_cl.scene import RealisticCamera, Scene, load_scene, set_keys

KEYS = ("scene", "frames", "seed", "set", "vary", "files", "truth", "camera_model")
FORMATS = ("png", "jpg", "tif", "exr", "npz", "npy")
MODELS = ("auto", "none", *COEFFICIENTS)
MOST_FRAMES = 100_000_000
MOST_SEED = 2**63 - 1
Where = Callable[[KeyPath], str]


@dataclass(frozen=True, eq=False)
class DatasetSpecification:
    """What the frames of a dataset are.

    Attributes
    ----------
    scene : Scene
        With all that is set and nothing that is drawn.
    vary : dict of str to Distribution
        What is drawn for each frame, by key path.
    frames : int
        How many there are.
    seed : int
        Of what is drawn, and of the pictures' random numbers.
    files : tuple of str
        Suffixes of the files of each frame.
    truth : bool
        Whether each frame also has masks and annotations.
    camera_model : str
        The model in the manifest: ``none``, ``auto`` (the simplest that fits) or one of `COEFFICIENTS`.
    classes : tuple of str
        Names of the classes that objects of any frame may have, by their number; 0 is none.
    """

    scene: Scene
    vary: Mapping[str, Distribution]
    frames: int
    seed: int
    files: tuple[str, ...]
    truth: bool
    camera_model: str
    content: Mapping[str, Any] = field(repr=False)
    classes: tuple[str, ...] = ("",)

    @property
    def key(self) -> str:
        """What decides the bytes of the frames, as a hash; the number of frames is none of it."""
        render = self.scene.render
        facts = [__version__, self.scene.picture_hash(), render.most_spp, render.layers, self.content]
        if render.layers:
            facts.append(render.layers_spp)
        if render.layers or self.truth:  # names and labels are in files of theirs alone
            facts.append([self.classes, [(item.name, item.label) for item in self.scene.objects]])
        return hashlib.sha256(json.dumps(facts, sort_keys=True, default=str).encode()).hexdigest()[:16]

    def frame(self, index: int) -> tuple[dict[str, Any], Scene]:
        """Return what is drawn for a frame, which counts from 0, and its scene.

        Raises
        ------
        InputError
            When the scene does not take what was drawn.
        """
        values = values_of_frame(self.vary, self.seed, index)
        changes = values if "render.seed" in values else values | {"render.seed": seed_of_frame(self.seed, index)}
        with numbered(index):
            return values, set_keys(self.scene, changes)


def read_specification(
    source: str | Path | Mapping[str, Any], overrides: Sequence[str] = (), *, frames: int | None = None
) -> DatasetSpecification:
    """Return the specification of a file or a mapping, checked as far as that goes without rendering.

    Every key is tried at the ends of its distribution.

    Parameters
    ----------
    source
        A YAML file, or its content; the scene that it names lies in its folder or below.
    overrides
        Changes of the scene such as ``render.spp=64``, beside those of the specification.
    frames
        How many frames, in place of what the specification says.

    Raises
    ------
    InputError
        ``FILE:LINE:COL: key.path: problem (got …; allowed …)``.
    StateError
        When a file cannot be read.
    """
    where: Where = lambda path: ""  # noqa: E731
    base = Path.cwd()
    if isinstance(source, Mapping):
        data: Any = dict(source)
    else:
        if not isinstance(source, str | os.PathLike):
            raise InputError(f"a dataset must be a file or a mapping (got {source!r}; allowed: as balls.yaml)")
        document = read_yaml(Path(source))
        data, where, base = document.data, _places(document), Path(source).absolute().parent
    if not isinstance(data, dict):
        raise InputError(f"{where(())}a dataset must be a mapping (allowed: keys {', '.join(KEYS)})")
    for key in data:
        if key not in KEYS:
            raise InputError(f"{where((key,))}{key}: unknown key (allowed: {', '.join(KEYS)})")
    if frames is not None:
        count = whole(frames, "frames", 1, MOST_FRAMES)
    elif "frames" in data:
        count = whole(data["frames"], "frames", 1, MOST_FRAMES, where(("frames",)))
    else:
        raise InputError(f"{where(())}frames: is missing (allowed: a whole number, here or by -n)")
    seed = whole(data["seed"], "seed", 0, MOST_SEED, where(("seed",))) if "seed" in data else 0
    scene = _scene(data, base, where, overrides)
    vary, classes = _vary(data, scene, where)
    scene = _sharing(scene, vary)
    truth = _truth(data, scene, where)
    content = {key: data.get(key) for key in ("vary", "seed", "files", "camera_model")} | (
        {"truth": True} if truth else {}
    )
    return DatasetSpecification(
        scene, vary, count, seed, _files(data, where), truth, _model(data, where), content, classes
    )


def _sharing(scene: Scene, vary: Mapping[str, Distribution]) -> Scene:
    """Return the scene, with pupils that states of its lens share where hardly any state comes twice."""
    camera = scene.camera
    if not isinstance(camera, RealisticCamera) or camera.pupil != "auto" or camera.rays != "traced":
        return scene
    if {"camera", "camera.kind", "camera.pupil", "camera.rays"} & set(vary):
        return scene
    states: tuple[str, ...] = (
        "camera.f_number",
        "camera.stop_diameter_mm",
        "camera.focal_length_mm",
        "camera.focus",
        "camera.movements.rise_mm",
        "camera.movements.shift_mm",
        "film.",
    )
    if camera.focus.point is not None or camera.focus.object is not None:
        states += ("camera.eye", "camera.target", "objects")
    drawn = [key for key, law in vary.items() if law.kind not in ("choice", "grid")]
    return set_keys(scene, {"camera.pupil": "shared"}) if any(key.startswith(states) for key in drawn) else scene


def _places(document: Document) -> Where:
    def where(path: KeyPath) -> str:
        line, column = document.mark(path)
        return f"{document.name}:{line}:{column}: "

    return where


def whole(found: Any, name: str, least: int, most: int, place: str = "") -> int:
    """Return a whole number from ``least`` to ``most``.

    Raises
    ------
    InputError
        When it is something else; ``place`` and name lead.
    """
    if isinstance(found, bool) or not isinstance(found, int):
        raise InputError(f"{place}{name}: must be a whole number (got {found!r}; allowed: {least} to {most})")
    if not least <= found <= most:
        raise InputError(f"{place}{name}: is out of range (got {found}; allowed: {least} to {most})")
    return found


def _scene(data: Mapping[str, Any], base: Path, where: Where, overrides: Sequence[str]) -> Scene:
    given = data.get("scene")
    if isinstance(given, str):
        path = (base / given).resolve()
        if not path.is_relative_to(base.resolve()):
            raise InputError(f"{where(('scene',))}scene: lies outside the folder of the dataset (got {given})")
        scene = load_scene(path)
    elif isinstance(given, Mapping):
        scene = load_scene(given, base_dir=base)
    else:
        raise InputError(f"{where(('scene',))}scene: must be a scene file or its content (got {given!r})")
    fixed = data.get("set") or {}
    if not isinstance(fixed, Mapping):
        raise InputError(f"{where(('set',))}set: must be a mapping of key paths (allowed: as render.spp: 16)")
    if fixed:
        try:
            scene = set_keys(scene, {str(key): value for key, value in fixed.items()})
        except RptcamError as problem:
            raise InputError(f"{where(('set',))}set: {problem}") from None
    for text in overrides:
        key, equals, value = text.partition("=")
        if not equals:
            raise InputError(f"--set {text}: is not of the form key.path=value (for instance render.spp=16)")
        scene = set_keys(scene, {key: read_yaml(value, name=f"--set {text}").data})
    return scene


def _vary(data: Mapping[str, Any], scene: Scene, where: Where) -> tuple[dict[str, Distribution], tuple[str, ...]]:
    """Return what is drawn, and the classes of all objects that may be: none first, then the scene's in its order."""
    given = data.get("vary")
    if not isinstance(given, Mapping) or not given:
        raise InputError(f"{where(('vary',))}vary: names no key (allowed: as camera.f_number: {{choice: [2, 4]}})")
    vary: dict[str, Distribution] = {}
    labels = dict.fromkeys(["", *(item.label or "" for item in scene.objects)])
    for key, described in given.items():
        path: KeyPath = ("vary", str(key))
        try:
            vary[str(key)] = distribution(described)
        except DistributionError as problem:
            place = (*path, *problem.path)
            raise InputError(f"{where(place)}{dotted(place)}: {problem}") from None
        for value in vary[str(key)].ends:
            try:
                changed = set_keys(scene, {str(key): value})
                if changed.camera.kind != "environment" and changed.requested_autofocus is None:
                    view(changed)  # whether the lens opens and focuses so far
                labels |= dict.fromkeys(item.label or "" for item in changed.objects)
            except RptcamError as problem:
                raise InputError(f"{where(path)}vary: {problem}") from None
    return vary, tuple(labels)


def _files(data: Mapping[str, Any], where: Where) -> tuple[str, ...]:
    found = data.get("files", ["png"])
    if not isinstance(found, list | tuple) or not found or len(set(map(str, found))) < len(found):
        raise InputError(
            f"{where(('files',))}files: must be a list of suffixes (got {found!r}; allowed: as [png, exr])"
        )
    for suffix in found:
        if suffix not in FORMATS:
            raise InputError(
                f"{where(('files',))}files: unknown suffix (got {suffix!r}; allowed: {', '.join(FORMATS)})"
            )
    return tuple(found)


def _truth(data: Mapping[str, Any], scene: Scene, where: Where) -> bool:
    found = data.get("truth", False)
    if not isinstance(found, bool):
        raise InputError(f"{where(('truth',))}truth: must be true or false (got {found!r})")
    if found and len(scene.objects) >= MOST_INSTANCES:
        raise InputError(
            f"{where(('truth',))}truth: masks of 16 bits hold fewer than {MOST_INSTANCES} objects "
            f"(got {len(scene.objects)})"
        )
    return found


def _model(data: Mapping[str, Any], where: Where) -> str:
    found = data.get("camera_model", "auto")
    if found not in MODELS:
        raise InputError(
            f"{where(('camera_model',))}camera_model: unknown model (got {found!r}; allowed: {', '.join(MODELS)})"
        )
    return str(found)
