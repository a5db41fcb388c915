"""Datasets: many pictures whose keys are drawn from distributions, each with its exact camera and truth."""

from __future__ import annotations

import contextlib
import hashlib
import io
import itertools
import json
import math
import os
import re
import tarfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from numbers import Integral, Real
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np

from rptcam_cl.api.job import SeriesRenderer
from rptcam_cl.core import __version__
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, RptcamError, StateError, out_of_range
from rptcam_cl.core.files import make_folder, name_errors, replacing, resolve_links
from rptcam_cl.core.remember import UNKNOWN, Memory, OneMaker, made_by
from rptcam_cl.core.strict_yaml import KeyPath, dotted, read_yaml
from rptcam_cl.device.session import Wanted, open_sessions
from rptcam_cl.exchange.camera_models import COEFFICIENTS, CameraView, calibrate, calibrate_best, view
from rptcam_cl.imaging.image import Image
from rptcam_cl.imaging.writers import LABELS, MOST_INSTANCES, TRUTH_FILES, categories_of, with_classes
from rptcam_cl.scene.camera import KEY_GROUPS
from rptcam_cl.scene.changes import change_scene, set_keys
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

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
            yield from (self._as_value(end) for end in self.values if all(map(math.isfinite, end)))
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
_MOST_SEED = 2**63 - 1
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
        with name_errors(f"frame {index}"):
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
        data, base = document.data, Path(source).absolute().parent
        where = lambda path: f"{document.where(path)}: "  # noqa: E731
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
    seed = whole(data["seed"], "seed", 0, _MOST_SEED, where(("seed",))) if "seed" in data else 0
    scene = _scene(data, base, where, overrides)
    vary, classes = _vary(data, scene, where)
    scene = _sharing(scene, vary)
    truth = _truth(data, scene, where)
    content = {key: data.get(key) for key in ("vary", "seed", "files", "camera_model")}
    if truth:
        content["truth"] = True
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
    of_camera = ("f_number", "stop_diameter_mm", "focal_length_mm", "focus", "movements.rise_mm", "movements.shift_mm")
    states = (*(f"camera.{key}" for key in of_camera), "film.")
    if camera.focus.point is not None or camera.focus.object is not None:
        states += ("camera.eye", "camera.target", "objects")
    drawn = [key for key, law in vary.items() if law.kind not in ("choice", "grid")]
    return set_keys(scene, {"camera.pupil": "shared"}) if any(key.startswith(states) for key in drawn) else scene


def _error(where: Where, key: str, problem: str) -> InputError:
    """The error of a key of the specification, with its place."""
    return InputError(f"{where((key,))}{key}: {problem}")


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


#
# A folder with the frames of a dataset, loose or in shards, which a run that was killed leaves fit to go on from.
#
# The record of a frame is written after its files, and a shard after the records of all its frames; each file is
# written whole or not at all. So whatever is there is done.

_ABOUT, _MANIFEST = "dataset.json", "manifest.jsonl"
PIXELS = {"centre_of_the_first_pixel": 0.5}
PICTURES = ("png", "jpg", "tif")  # which annotations name where a frame has one
_RECORD = re.compile(r"\d+\.json")
LOOSE = "unfinished"  # folder of frames whose shard is not whole yet


class _MovedError(Exception):
    """Another run of the same dataset has moved frames into their shard meanwhile."""


class DatasetFolder:
    """Writes frames and finds those that are there.

    Parameters
    ----------
    path : Path
        Made if it is missing.
    wanted : DatasetSpecification
    shard : int or None
        Frames in each shard.
    allow_mixed : bool
        Whether frames that other code has made stay beside those of this program.
    """

    def __init__(
        self, path: Path, wanted: DatasetSpecification, shard: int | None, *, allow_mixed: bool = False
    ) -> None:
        self.path, self.wanted, self.shard, self._same = path, wanted, shard, OneMaker(allow_mixed)
        self.frames = path if shard is None else path / LOOSE
        self._shards: dict[int, dict[int, dict[str, Any]]] = {}

    def begin(self) -> None:
        """Make the folder, or make sure that it holds this dataset.

        Raises
        ------
        StateError
            When it cannot be written, or holds another dataset, or the same in other shards or by other code.
        """
        make_folder(self.path)
        if self.shard is not None:
            make_folder(resolve_links(self.frames))
        about, mine = self.path / _ABOUT, {"key": self.wanted.key, "shard": self.shard}
        if about.exists():
            try:
                facts = json.loads(about.read_text("utf-8"))
                known = {name: facts[name] for name in mine}
            except (OSError, ValueError, KeyError, TypeError):
                raise StateError(f"{about}: is damaged (remove the folder, or name another)") from None
            for name, words in (("key", "frames of another dataset"), ("shard", "frames in other shards")):
                if known[name] != mine[name]:
                    raise StateError(f"{self.path}: holds {words} (remove it, or name another folder)")
            if makers := facts.get("made_by", [UNKNOWN]):  # none where no device was opened yet
                self._same.add(str(self.path), makers)
                self.join([self._same.makers[0]["driver"]])  # whether the code is the same; the device is opened later
        elif any(self.path.glob("*.json")):
            raise StateError(f"{self.path}: holds other files (name an empty folder)")
        self._write_about()

    def join(self, drivers: Iterable[str]) -> None:
        """Let this program add frames by devices with these drivers, and note it.

        Raises
        ------
        StateError
            When frames that are there were made otherwise.
        """
        known = len(self._same.makers)
        self._same.add("this program", made_by(drivers))
        if len(self._same.makers) > known:
            self._write_about()

    def _write_about(self) -> None:
        facts = {
            "key": self.wanted.key, "shard": self.shard, **PIXELS, "frames": self.wanted.frames,
            "specification": self.wanted.content, "categories": categories_of(self.wanted.classes),
            "made_by": self._same.makers,
        }  # fmt: skip
        self._write(self.path / _ABOUT, (json.dumps(facts, indent=2, default=str) + "\n").encode())

    def record(self, index: int) -> dict[str, Any] | None:
        """Return the record of a frame that is there with all its files undamaged; None for one that has to be made."""
        if self.shard is not None and index in (packed := self._records_of_shard(index // self.shard)):
            return packed[index]
        try:
            record = json.loads(self._file(index, "json").read_text("utf-8"))
            for name, digest in record["files"].items():
                if hashlib.sha256((self.frames / name).read_bytes()).hexdigest() != digest:
                    return None
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None
        return record if isinstance(record, dict) and record.get("frame") == index else None

    def keep(self, index: int, image: Image, layers: Sequence[str], record: dict[str, Any]) -> dict[str, Any]:
        """Write the files of a frame, and its record with their digests, which is returned.

        Parameters
        ----------
        layers
            Those of the image that the scene asks for; truth may need others.

        Raises
        ------
        StateError
            A file cannot be written, as on a full disk; nothing of the frame is left then.
        """
        self.frames.mkdir(exist_ok=True)  # where another run has finished meanwhile
        try:
            return self._keep(index, image, layers, record)
        except BaseException:
            for suffix in (*self._suffixes, "json"):
                self._file(index, suffix).unlink(missing_ok=True)
            raise

    def _keep(self, index: int, image: Image, layers: Sequence[str], record: dict[str, Any]) -> dict[str, Any]:
        shown = replace(image, layers={name: image[name] for name in layers})
        for suffix in self.wanted.files:
            shown.save(resolve_links(self._file(index, suffix)))
        if self.wanted.truth:
            picture = next((suffix for suffix in self.wanted.files if suffix in PICTURES), self.wanted.files[0])
            labels, prefix = replace(image, layers={name: image[name] for name in LABELS}), self._file(index, "").name
            labels.save_truth(self.frames, f"{prefix}{picture}", image_id=index, prefix=prefix)
        paths = [self._file(index, suffix) for suffix in self._suffixes]
        digests = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}
        record = json.loads(json.dumps(record | {"files": digests}))
        self._write(self._file(index, "json"), (json.dumps(record) + "\n").encode())
        return dict(record)

    def finish(self) -> None:
        """Write the manifest of all frames that are there, one line each; pack what a killed run left loose."""
        if self.shard is not None:
            for number in range(-(-self.wanted.frames // self.shard)):
                self.pack(number)
        with (
            replacing(resolve_links(self.path / _MANIFEST)) as temporary,
            temporary.open("w", encoding="utf-8", newline="\n") as out,
        ):
            for index in range(self.wanted.frames):
                if (record := self.record(index)) is not None:
                    self._same.add(f"{self.path}: frame {index}", record.get("made_by"))
                    out.write(json.dumps(record) + "\n")
        if self.shard is not None and all(map(self._records_of_shard, range(-(-self.wanted.frames // self.shard)))):
            with contextlib.suppress(OSError):  # another run may write there, or have removed it
                self.frames.rmdir()

    @property
    def _suffixes(self) -> tuple[str, ...]:
        """Of the files of a frame but its record."""
        return (*self.wanted.files, *TRUTH_FILES) if self.wanted.truth else self.wanted.files

    def _file(self, index: int, suffix: str) -> Path:
        return self.frames / f"{index:06d}.{suffix}"

    def _write(self, path: Path, content: bytes) -> None:
        with replacing(resolve_links(path)) as temporary:
            temporary.write_bytes(content)

    def _range(self, number: int) -> range:
        assert self.shard is not None
        return range(number * self.shard, min((number + 1) * self.shard, self.wanted.frames))

    def _tar(self, number: int) -> Path:
        return self.path / f"shard-{number:06d}.tar"

    def _records_of_shard(self, number: int) -> dict[int, dict[str, Any]]:
        """Return the records of a shard that is there and whole."""
        if number not in self._shards:
            try:
                with tarfile.open(self._tar(number)) as shard:
                    names = [member for member in shard.getmembers() if _RECORD.fullmatch(member.name)]
                    read = [json.load(file) for member in names if (file := shard.extractfile(member)) is not None]
                records = {record["frame"]: record for record in read}
            except (OSError, tarfile.TarError, ValueError, KeyError, TypeError):
                return {}
            if set(self._range(number)) - set(records):
                return {}
            self._shards[number] = records
        return self._shards[number]

    def pack(self, number: int) -> None:
        """Move the frames of a shard into its file, when all are there."""
        if not self._records_of_shard(number):
            if any(self.record(index) is None for index in self._range(number)):
                return
            try:
                self._write_shard(number)
            except _MovedError:
                return
        for path in self._files_of(number):
            path.unlink(missing_ok=True)

    def _write_shard(self, number: int) -> None:
        with (
            replacing(resolve_links(self._tar(number))) as temporary,
            tarfile.open(temporary, "w", format=tarfile.USTAR_FORMAT) as out,
        ):
            for path in self._files_of(number):
                try:
                    content = path.read_bytes()
                except FileNotFoundError:
                    raise _MovedError from None
                member = tarfile.TarInfo(path.name)
                member.size = len(content)
                out.addfile(member, io.BytesIO(content))

    def _files_of(self, number: int) -> Iterator[Path]:
        for index in self._range(number):
            yield from (self._file(index, suffix) for suffix in (*self._suffixes, "json"))


# The frames of a dataset, one after the other: rendered, described, written, and kept when they are there.

REMEMBERED = 512  # camera models
SAMPLES = ("spp", "spp_min", "spp_mean")


@dataclass(frozen=True, eq=False)
class DatasetFrame:
    """One frame of a dataset.

    Attributes
    ----------
    index : int
        Counts from 0.
    values : dict
        What was drawn, by key path.
    record : dict
        Its line of the manifest: seed, values, hash of the scene, files, and ``camera``: pose, intrinsics, distortion
        and entrance pupil.
    image : Image or None
        The picture with its layers; None for a frame that was there already, whose files hold it.
    """

    index: int
    values: dict[str, Any]
    record: dict[str, Any]
    image: Image | None

    @property
    def kept(self) -> bool:
        """Whether an earlier run made it."""
        return self.image is None


def dataset(
    source: DatasetSpecification | str | Path | Mapping[str, Any],
    folder: str | Path | None = None,
    *,
    frames: int | None = None,
    only: Iterable[int] | None = None,
    shard: int | None = None,
    device: Wanted = None,
    allow_mixed: bool = False,
) -> Iterator[DatasetFrame]:
    """Return an iterator over the frames of a dataset, in their order.

    Each frame depends on the specification and its index alone, so any of them can be made anywhere. With a folder,
    each is written whole before the next begins, and frames that are there are kept; at the end follows the manifest.

    Parameters
    ----------
    source
        A specification, its file or its content; see docs/datasets.md.
    folder
        Where to write; made if it is missing. Without one nothing is written.
    frames
        How many there are, in place of the specification's.
    only
        The frames to make, of all; by default every one.
    shard
        Frames in each shard, a TAR file as WebDataset reads it, in place of loose files.
    device
        As for `render`.
    allow_mixed
        Whether frames of the folder that other code, another numpy or another driver has made are kept beside new ones;
        each says what made it.

    Raises
    ------
    InputError
        Something in the specification, the scene or the arguments is wrong.
    DeviceError
        No device fits, or a kernel failed.
    StateError
        The folder cannot be written, or holds another dataset.
    """
    if not isinstance(source, DatasetSpecification):
        wanted = read_specification(source, frames=frames)
    else:
        wanted = source if frames is None else replace(source, frames=whole(frames, "frames", 1, MOST_FRAMES))
    chosen = range(wanted.frames) if only is None else _check_indices(only, wanted.frames)
    if shard is not None:
        whole(shard, "shard", 1, MOST_FRAMES)
        if folder is None:
            raise InputError(f"shard: needs a folder (got {shard}; allowed: with a folder to write to)")
    if folder is not None and not isinstance(folder, str | os.PathLike):
        raise InputError(f"folder: must be a path (got {folder!r}; allowed: as out/balls)")
    place = None if folder is None else DatasetFolder(Path(folder), wanted, shard, allow_mixed=allow_mixed)
    if place is not None:
        place.begin()
    return _frames(wanted, place, chosen, device)


def _check_indices(only: Any, frames: int) -> Sequence[int]:
    """Return the numbers of the frames that are to be made."""
    allowed = f"allowed: 0 to {frames - 1}"
    if not isinstance(only, Iterable):
        raise InputError(f"only: must be a list of numbers of frames (got {only!r}; {allowed}, as [0])")
    chosen = only if isinstance(only, range) else list(only)
    for index in chosen:
        if isinstance(index, bool) or not isinstance(index, Integral):
            raise InputError(f"only: must be a list of whole numbers (got {index!r} in it; {allowed})")
        if not 0 <= int(index) < frames:
            raise InputError(f"frames: {index} is none of the dataset's {frames} ({allowed})")
    if not chosen:
        raise InputError(f"only: names no frame ({allowed})")
    return chosen if isinstance(chosen, range) else [int(index) for index in chosen]


def _frames(
    wanted: DatasetSpecification, place: DatasetFolder | None, chosen: Sequence[int], device: Wanted
) -> Iterator[DatasetFrame]:
    renderer: SeriesRenderer | None = None
    cameras = _Cameras(wanted.camera_model)
    for index in chosen:
        if place is not None and (known := place.record(index)) is not None:
            yield DatasetFrame(index, known["values"], known, None)
            continue
        values, scene = wanted.frame(index)
        if renderer is None:
            renderer = SeriesRenderer(open_sessions(device)[0][0])
            if place is not None:
                place.join([renderer.device.info.driver])
        with name_errors(f"frame {index}"):
            shown = scene
            if wanted.truth:  # masks and annotations need layers beside those that files of a frame hold
                layers = tuple(dict.fromkeys((*scene.render.layers, *LABELS)))
                shown = change_scene(scene, render={"layers": layers})
            image = renderer.render(shown)
            if "class_names" in image.metadata:
                named, metadata = with_classes(image.layers, image.metadata, wanted.classes)
                image = replace(image, layers=named, metadata=metadata)
            record = {
                "frame": index,
                "version": __version__,
                "made_by": image.metadata["made_by"],
                "scene_hash": image.metadata["scene_hash"],
                "seed": scene.render.seed,
                **{key: image.metadata[key] for key in SAMPLES if key in image.metadata},
                "values": values,
                "camera": cameras.describe(image, renderer),
            }
            if wanted.truth and "boards" in image.metadata:
                record["boards"] = image.metadata["boards"]
            if place is not None:
                record = place.keep(index, image, scene.render.layers, record)
                if place.shard is not None:
                    place.pack(index // place.shard)
        yield DatasetFrame(index, values, record, image)
    if place is not None:
        place.finish()


class _Cameras:
    """Describes the cameras of frames; a lens that only moves about is traced and fitted once."""

    def __init__(self, model: str) -> None:
        self._model = model
        self._known: Memory[dict[str, Any]] = Memory(REMEMBERED)
        self._lit: Memory[dict[str, Any]] = Memory(REMEMBERED)  # where the whole picture has light, by all but the stop

    def describe(self, image: Image, renderer: SeriesRenderer) -> dict[str, Any]:
        """The pose, pupil, film, lens, and the camera model with its residual, of the camera that took the picture."""
        scene, plan = renderer.resolved, renderer.plan
        assert scene is not None and plan is not None, "of the image"
        if scene.camera.sees_all_around:
            return {"camera": scene.camera.kind, "world_from_camera": image.metadata["world_from_camera"]}
        seen = view(scene, camera=plan.camera)
        known = {name: image.metadata[name] for name in ("lens", "f_number") if name in image.metadata}
        return seen.facts() | known | ({} if self._model == "none" else self._fit(seen))

    def _fit(self, seen: CameraView) -> dict[str, Any]:
        optics, stop = _content(seen)
        known: dict[str, Any] | None = self._known.find(optics + stop)
        if known is None and seen.is_of_any_stop:
            known = self._lit.find(optics)
        if known is None:
            is_free = self._model == "auto"
            fit = calibrate_best(seen, list(COEFFICIENTS)) if is_free else calibrate(seen, self._model)
            of = fit.named
            known = {
                "model": fit.model,
                "parameters": of,
                "matrix": [[of["fx"], 0.0, of["cx"]], [0.0, of["fy"], of["cy"]], [0.0, 0.0, 1.0]],
                "largest_error_px": fit.max_px,
                "rms_error_px": fit.rms_px,
            }
            if fit.lit_share == 1.0:
                self._lit.add(optics, known)
        self._known.add(optics + stop, known)
        return known


def _content(seen: CameraView) -> tuple[str, str]:
    """Keys of the optics that a camera model is fitted to, and of the stop."""
    optics = seen.scene.camera.model_dump(mode="json", exclude=KEY_GROUPS["pose"])
    stop = [optics.pop(key, None) for key in sorted(KEY_GROUPS["opening"])]
    facts = [optics, seen.scene.film.model_dump(mode="json"), seen.distance_m, seen.scene.metres_per_unit]
    if seen.setting is not None:
        facts += [seen.setting.film_distance_mm, seen.setting.lens.vertices.tobytes()]
    return hashlib.sha256(repr(facts).encode()).hexdigest(), repr(stop)
