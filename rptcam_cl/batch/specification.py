"""The specification of a dataset: a scene, what stays set in it, and the keys that are drawn for each frame."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import field
from numbers import Real
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np

from rptcam_cl.core import __version__
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, RptcamError, out_of_range
from rptcam_cl.core.strict_yaml import Document, KeyPath, dotted, read_yaml
from rptcam_cl.exchange.camera_models import COEFFICIENTS
from rptcam_cl.exchange.camera_view import view
from rptcam_cl.imaging.writers import MOST_INSTANCES
from rptcam_cl.scene.load import load_scene, set_keys
from rptcam_cl.scene.scene import Scene

# Errors of a frame begin with its number.


@contextmanager
def number_errors(index: int) -> Iterator[None]:
    """Within the block errors that are reported in one line begin with ``frame 517:``."""
    try:
        yield
    except RptcamError as problem:
        problem.args = (f"frame {index}: {problem}",)
        raise


#
# What a key is in each frame: distributions, drawn by seed, key and frame alone.
#
# A frame is therefore the same however many are made and in whatever order, and a key that is added leaves what the
# others draw as it was. Random bits are those of Philox (Salmon et al., "Parallel random numbers: as easy as 1, 2,
# 3", SC 2011), keyed by all three.

KINDS = {
    "uniform": "[least, most], numbers or lists of equally many numbers",
    "log_uniform": "[least, most], above 0",
    "integer": "[least, most], whole numbers, both included",
    "normal": "{mean, sd} and perhaps {min, max}, numbers or lists of equally many",
    "choice": "a list of values, and perhaps weights beside it",
    "grid": "a list of values, all combinations of which come in turn",
}

Numbers = tuple[float, ...]


class DistributionError(ValueError):
    """A distribution that cannot be drawn from: what is wrong, what would be right, and the keys that lead there."""

    def __init__(self, text: str, allowed: str, *path: str | int) -> None:
        super().__init__(f"{text} (allowed: {allowed})")
        self.path = path


@dataclass(frozen=True)
class Distribution:
    """A distribution of values of one key.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    values : tuple
        Of a choice or a grid; else the two ends, each a tuple of numbers.
    weights : tuple of float
        Of the values of a choice: shares that rise to 1.
    mean, sd : tuple of float
        Of a normal distribution.
    is_list : bool
        Whether what is drawn is a list of numbers.
    """

    kind: str
    values: tuple[Any, ...]
    weights: Numbers = ()
    mean: Numbers = ()
    sd: Numbers = ()
    is_list: bool = False

    @property
    def ends(self) -> Iterator[Any]:
        """The values that a scene has to take, for all others to be likely to be taken too."""
        if self.kind in ("choice", "grid"):
            yield from self.values
        elif self.kind == "normal":
            middle = [min(max(m, a), b) for m, a, b in zip(self.mean, *self.values, strict=True)]
            yield self._as_value(middle)
            finite = [end for end in self.values if all(map(math.isfinite, end))]
            yield from (self._as_value(end) for end in finite)
        else:
            yield from (self._as_value(end) for end in self.values)

    def draw(self, chances: np.random.Generator) -> Any:
        """Return a value; a grid's is chosen by `_grid_values`."""
        if self.kind == "choice":
            share = float(chances.random())
            return self.values[next((n for n, sum_ in enumerate(self.weights) if share < sum_), len(self.values) - 1)]
        low, high = self.values
        shares = [float(chances.random()) for _ in low]
        return self._as_value([self._between(*each) for each in zip(range(len(low)), shares, low, high, strict=True)])

    def _between(self, number: int, share: float, low: float, high: float) -> float:
        match self.kind:
            case "uniform":
                return low + share * (high - low)
            case "log_uniform":
                return low * math.exp(share * math.log(high / low))
            case "integer":
                return float(low + min(math.floor(share * (high - low + 1)), high - low))
        normal = NormalDist(self.mean[number], self.sd[number])
        below, above = (0.0 if math.isinf(low) else normal.cdf(low)), (1.0 if math.isinf(high) else normal.cdf(high))
        chance = min(max(below + share * (above - below), 1e-15), 1 - 1e-15)
        return min(max(normal.inv_cdf(chance), low), high)

    def _as_value(self, numbers: Sequence[float]) -> Any:
        values: list[float] = [int(number) if self.kind == "integer" else float(number) for number in numbers]
        return values if self.is_list else values[0]


def distribution(data: Any) -> Distribution:
    """Return the distribution that a mapping such as ``{uniform: [1, 2]}`` describes.

    Raises
    ------
    DistributionError
        When it is none, or an empty one.
    """
    if not isinstance(data, Mapping):
        raise DistributionError(f"is no distribution (got {data!r})", "as {uniform: [1, 2]} or {choice: [a, b]}")
    kinds = [key for key in data if key in KINDS]
    if len(kinds) != 1:
        raise DistributionError("needs exactly one kind of distribution", ", ".join(KINDS))
    [kind] = kinds
    known = {kind, "weights"} if kind == "choice" else {kind}
    for key in data:
        if key not in known:
            raise DistributionError(f"unknown key {key}", ", ".join(sorted(known)), str(key))
    given = data[kind]
    if kind in ("choice", "grid"):
        return _choice(kind, given, data.get("weights"))
    if kind == "normal":
        return _normal(given)
    if not (isinstance(given, list | tuple) and len(given) == 2):
        raise DistributionError(f"has no two ends (got {given!r})", KINDS[kind], kind)
    low, high = (_numbers(end, KINDS[kind], kind, place) for place, end in enumerate(given))
    is_list, ends_in_list = (isinstance(end, list | tuple) for end in given)
    if len(low) != len(high) or is_list != ends_in_list:
        raise DistributionError(f"has ends of different lengths (got {given!r})", KINDS[kind], kind)
    if any(a > b for a, b in zip(low, high, strict=True)):
        raise DistributionError(f"has its ends the wrong way round (got {given!r})", "the least before the most", kind)
    if kind == "log_uniform" and min(low) <= 0:
        raise DistributionError(f"reaches 0 (got {given!r})", KINDS[kind], kind)
    if kind == "integer" and any(number != int(number) for number in low + high):
        raise DistributionError(f"has an end that is no whole number (got {given!r})", KINDS[kind], kind)
    return Distribution(kind, (low, high), is_list=is_list)


def _choice(kind: str, given: Any, weights: Any) -> Distribution:
    if not isinstance(given, list | tuple) or not given:
        raise DistributionError(f"has no list of values (got {given!r})", KINDS[kind], kind)
    if weights is None:
        weights = [1.0] * len(given)
    shares = _numbers(weights, "a number for each value", "weights")
    if len(shares) != len(given) or min(shares) < 0 or sum(shares) <= 0:
        raise DistributionError(f"do not weigh its {len(given)} values", "as many numbers, 0 or more", "weights")
    return Distribution(kind, tuple(given), tuple(np.cumsum(np.array(shares) / sum(shares)).tolist()))


def _normal(given: Any) -> Distribution:
    right = KINDS["normal"]
    if not isinstance(given, Mapping) or not {"mean", "sd"} <= set(given) <= {"mean", "sd", "min", "max"}:
        raise DistributionError(f"is no normal distribution (got {given!r})", right, "normal")
    mean = _numbers(given["mean"], right, "normal", "mean")
    sd, low, high = (
        _as_many(given.get(key, default), len(mean), right, key)
        for key, default in (("sd", 0.0), ("min", -math.inf), ("max", math.inf))
    )
    if min(sd) <= 0:
        raise DistributionError("must be above 0", "a number above 0", "normal", "sd")
    for number, (a, b) in enumerate(zip(low, high, strict=True)):
        normal = NormalDist(mean[number], sd[number])
        if not a < b or normal.cdf(b) - normal.cdf(a) < 1e-9:
            raise DistributionError("leaves nothing between min and max", "a range that the values reach", "normal")
    return Distribution("normal", (low, high), mean=mean, sd=sd, is_list=isinstance(given["mean"], list | tuple))


def _as_many(given: Any, count: int, right: str, key: str) -> Numbers:
    if isinstance(given, float) and math.isinf(given):
        return (given,) * count
    numbers = _numbers(given, right, "normal", key)
    if len(numbers) == 1:
        return numbers * count
    if len(numbers) != count:
        raise DistributionError(f"has {len(numbers)} numbers, its mean {count}", right, "normal", key)
    return numbers


def _numbers(given: Any, right: str, *path: str | int) -> Numbers:
    listed = list(given) if isinstance(given, list | tuple) else [given]
    for number in listed:
        if isinstance(number, bool) or not isinstance(number, Real) or not math.isfinite(number):
            raise DistributionError(f"is no finite number (got {number!r})", right, *path)
    if not listed:
        raise DistributionError("is empty", right, *path)
    return tuple(float(number) for number in listed)


def values_of_frame(vary: Mapping[str, Distribution], seed: int, frame: int) -> dict[str, Any]:
    """Return the value of each key in a frame, which counts from 0."""
    return {
        key: _grid_values(vary, frame)[key] if law.kind == "grid" else law.draw(_chances(seed, frame, key))
        for key, law in vary.items()
    }


def _grid_values(vary: Mapping[str, Distribution], frame: int) -> dict[str, Any]:
    """Return the values of the keys with grids: all combinations in turn, the last key's changing first."""
    grids = {key: law.values for key, law in vary.items() if law.kind == "grid"}
    place = frame % math.prod(map(len, grids.values()))
    return dict(zip(grids, next(itertools.islice(itertools.product(*grids.values()), place, None)), strict=True))


def seed_of_frame(seed: int, frame: int) -> int:
    """Return the seed of the random numbers of a frame's picture."""
    return int(_chances(seed, frame, "render.seed").integers(0, 2**53))


def _chances(seed: int, frame: int, key: str) -> np.random.Generator:
    words = np.frombuffer(hashlib.sha256(key.encode()).digest()[:8], "<u4").tolist()
    return np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, frame, *words])))


KEYS = ("scene", "frames", "seed", "set", "vary", "files", "truth", "camera_model")
FORMATS = ("png", "jpg", "tif", "exr", "npz", "npy")
MODELS = ("auto", "none", *COEFFICIENTS)
MOST_FRAMES = 100_000_000
MOST_SEED = 2**63 - 1
Where = Callable[[KeyPath], str]


@dataclass(frozen=True, eq=False)
class DatasetSpecification:
    """The specification of a dataset: its scene, what is drawn for each frame, and its files.

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
        """A hash of all that decides the bytes of the frames, but for their number."""
        render = self.scene.render
        facts = [__version__, self.scene.picture_hash(), render.most_spp, render.layers, self.content]
        if render.layers:
            facts.append(render.layers_spp)
        if render.layers or self.truth:  # names and labels are in files of theirs alone
            facts.append([self.classes, [(item.name, item.label) for item in self.scene.objects]])
        return hashlib.sha256(json.dumps(facts, sort_keys=True, default=str).encode()).hexdigest()[:16]

    def frame(self, index: int) -> tuple[dict[str, Any], Scene]:
        """The values that are drawn for a frame, which counts from 0, and its scene.

        Raises
        ------
        InputError
            When the scene does not take what was drawn.
        """
        values = values_of_frame(self.vary, self.seed, index)
        changes = values if "render.seed" in values else values | {"render.seed": seed_of_frame(self.seed, index)}
        with number_errors(index):
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
    camera = scene.camera.traced_camera
    if camera is None or camera.pupil != "auto" or camera.rays != "traced":
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


def _error(where: Where, key: str, problem: str) -> InputError:
    """The error of a key of the specification, with its place."""
    return InputError(f"{where((key,))}{key}: {problem}")


def _places(document: Document) -> Where:
    def where(path: KeyPath) -> str:
        line, column = document.mark(path)
        return f"{document.name}:{line}:{column}: "

    return where


def whole(number: Any, name: str, least: int, most: int, place: str = "") -> int:
    """Return a whole number from ``least`` to ``most``.

    Raises
    ------
    InputError
        When it is something else; ``place`` and name lead.
    """
    if isinstance(number, bool) or not isinstance(number, int):
        raise InputError(f"{place}{name}: must be a whole number (got {number!r}; allowed: {least} to {most})")
    if not least <= number <= most:
        raise out_of_range(f"{place}{name}", number, f"{least} to {most}")
    return number


def _scene(data: Mapping[str, Any], base: Path, where: Where, overrides: Sequence[str]) -> Scene:
    given = data.get("scene")
    if isinstance(given, str):
        path = (base / given).resolve()
        if not path.is_relative_to(base.resolve()):
            raise _error(where, "scene", f"lies outside the folder of the dataset (got {given})")
        scene = load_scene(path)
    elif isinstance(given, Mapping):
        scene = load_scene(given, base_dir=base)
    else:
        raise _error(where, "scene", f"must be a scene file or its content (got {given!r})")
    fixed = data.get("set") or {}
    if not isinstance(fixed, Mapping):
        raise _error(where, "set", "must be a mapping of key paths (allowed: as render.spp: 16)")
    if fixed:
        try:
            scene = set_keys(scene, {str(key): value for key, value in fixed.items()})
        except RptcamError as problem:
            raise _error(where, "set", str(problem)) from None
    for text in overrides:
        key, equals, value = text.partition("=")
        if not equals:
            raise InputError(f"--set {text}: is not of the form key.path=value (for instance render.spp=16)")
        scene = set_keys(scene, {key: read_yaml(value, name=f"--set {text}").data})
    return scene


def _vary(data: Mapping[str, Any], scene: Scene, where: Where) -> tuple[dict[str, Distribution], tuple[str, ...]]:
    """The distributions by key, and all classes that objects may have: none first, then the scene's in its order."""
    given = data.get("vary")
    if not isinstance(given, Mapping) or not given:
        raise _error(where, "vary", "names no key (allowed: as camera.f_number: {choice: [2, 4]})")
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
                if not changed.camera.sees_all_around and changed.requested_autofocus is None:
                    view(changed)  # whether the lens opens and focuses so far
                labels |= dict.fromkeys(item.label or "" for item in changed.objects)
            except RptcamError as problem:
                raise InputError(f"{where(path)}vary: {problem}") from None
    return vary, tuple(labels)


def _files(data: Mapping[str, Any], where: Where) -> tuple[str, ...]:
    files = data.get("files", ["png"])
    if not isinstance(files, list | tuple) or not files or len(set(map(str, files))) < len(files):
        raise _error(where, "files", f"must be a list of suffixes (got {files!r}; allowed: as [png, exr])")
    for suffix in files:
        if suffix not in FORMATS:
            raise _error(where, "files", f"unknown suffix (got {suffix!r}; allowed: {', '.join(FORMATS)})")
    return tuple(files)


def _truth(data: Mapping[str, Any], scene: Scene, where: Where) -> bool:
    truth = data.get("truth", False)
    if not isinstance(truth, bool):
        raise _error(where, "truth", f"must be true or false (got {truth!r})")
    if truth and len(scene.objects) >= MOST_INSTANCES:
        raise _error(
            where, "truth", f"masks of 16 bits hold fewer than {MOST_INSTANCES} objects (got {len(scene.objects)})"
        )
    return truth


def _model(data: Mapping[str, Any], where: Where) -> str:
    model = data.get("camera_model", "auto")
    if model not in MODELS:
        raise _error(where, "camera_model", f"unknown model (got {model!r}; allowed: {', '.join(MODELS)})")
    return str(model)
