"""Renders that can be interrupted, continued and merged: their file, whether it fits, and its picture."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import struct
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import __version__
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import StateError
from rptcam_cl.core.files import replacing
from rptcam_cl.core.records import RayStatus
from rptcam_cl.core.remember import Maker, OneMaker, made_by
from rptcam_cl.rendering import film as films
from rptcam_cl.rendering.account import clamp_text, of_makers
from rptcam_cl.rendering.film import PLANES, FilmLayout
from rptcam_cl.rendering.layers import OWNER_SLOTS, SHARP, SLOT_PLANES, LayerPlanes, layer_arrays, saved_truth
from rptcam_cl.rendering.progressive import SavedState
from rptcam_cl.rendering.several import WHOLE, FilmPart, Part, join_parts, part_of_facts, pixels_of, split_of
from rptcam_cl.scene.film import LAYER_NAMES, SHARP_LAYERS, Film
from rptcam_cl.scene.scene import Scene

#
# Renders that can be interrupted and continued: the file of their state, when it is saved, whether it fits.
#
# Magic, version and length of the header (little endian), the header as JSON, the arrays as they lie in memory
# (little endian), and the SHA-256 of all that. Nothing in it is executed when it is read.

MAGIC = b"RPTCAMCK"
VERSION = 3
SUFFIX = ".rpck"
_START = struct.Struct("<8sII")
_MOST_HEADER = 1 << 24
_TYPES = {"<f4", "<f8", "<i4", "<u4", "<u8"}
_DIGEST = hashlib.sha256().digest_size


@dataclass(frozen=True)
class Checkpoint:
    """A saved render, whole or a part.

    Attributes
    ----------
    path : Path
    facts : dict
        About the render.
    arrays : dict
        By name.
    """

    path: Path
    facts: dict[str, Any]
    arrays: dict[str, NDArray[Any]]

    @property
    def part(self) -> FilmPart:
        """What it is of the film."""
        return part_of_facts(self.facts.get("part"))

    @property
    def done(self) -> int:
        """Number of the first sample that it has not."""
        return int(self.facts["done"])

    @property
    def end(self) -> int:
        """Number of the sample that it is to end before."""
        part, picture = self.part, self.facts.get("picture") or {}
        end = part.end or (self.done if part.count == 1 else picture.get("spp") or self.done)
        return max(end, self.done)

    @property
    def title(self) -> str:
        """What it is, as people read it."""
        return f"{self.path} ({self.part.title})"


def write_checkpoint(
    path: str | os.PathLike[str], facts: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> None:
    """Write a checkpoint, whole or not at all.

    Raises
    ------
    StateError
        The file cannot be written; one that was there before is as it was.
    """
    with replacing(path) as temporary, temporary.open("xb") as stream:
        stream.writelines(_pieces(facts, arrays))


def _pieces(facts: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Iterator[bytes]:
    """Yield the bytes of a checkpoint, piece by piece."""
    little = {name: np.ascontiguousarray(array, array.dtype.newbyteorder("<")) for name, array in arrays.items()}
    listed = [{"name": name, "type": array.dtype.str, "shape": array.shape} for name, array in little.items()]
    header = json.dumps({"facts": dict(facts), "arrays": listed}).encode()
    digest = hashlib.sha256()
    for piece in (_START.pack(MAGIC, VERSION, len(header)), header, *(array.tobytes() for array in little.values())):
        digest.update(piece)
        yield piece
    yield digest.digest()


def read_checkpoint(path: str | os.PathLike[str]) -> Checkpoint:
    """Read a checkpoint.

    Raises
    ------
    StateError
        The file cannot be read, is something else, damaged, or of another version.
    """
    try:
        size = Path(path).stat().st_size
        with Path(path).open("rb") as stream:
            start = stream.read(_START.size)
            length = _header_length(path, start, size)
            header = stream.read(length)
            places = _places(path, header, size - _START.size - length - _DIGEST)
            digest = hashlib.sha256(start + header)
            arrays = {}
            for name, kind, shape in places:
                data = stream.read(math.prod(shape) * np.dtype(kind).itemsize)
                digest.update(data)
                arrays[name] = np.frombuffer(data, kind).reshape(shape) if len(data) else np.zeros(shape, kind)
            facts = json.loads(header)["facts"]
            if not isinstance(facts, dict) or stream.read() != digest.digest():
                raise _damage(path)
    except OSError as error:
        raise StateError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError, MemoryError) as error:
        raise _damage(path) from error
    return Checkpoint(Path(path), facts, arrays)


def _damage(path: str | os.PathLike[str], what: str = "") -> StateError:
    return StateError(f"{path}: this saved render is damaged{': ' * bool(what)}{what}")


def _header_length(path: str | os.PathLike[str], start: bytes, size: int) -> int:
    if len(start) < _START.size or not start.startswith(MAGIC):
        raise StateError(f"{path}: is not a saved render")
    _, version, length = _START.unpack(start)
    if version != VERSION:
        which = "a later" if version > VERSION else "an earlier"
        raise StateError(f"{path}: was saved by {which} version (its format is {version}; this one reads {VERSION})")
    if length > min(_MOST_HEADER, size):
        raise _damage(path)
    return int(length)


def _places(path: str | os.PathLike[str], header: bytes, size: int) -> list[tuple[str, str, tuple[int, ...]]]:
    """Return name, type and shape of the arrays; they must fill ``size`` bytes, so that no memory is promised away."""
    places, total = [], 0
    for entry in json.loads(header)["arrays"]:
        kind, shape = entry["type"], tuple(int(length) for length in entry["shape"])
        if kind not in _TYPES or min(shape, default=0) < 0:
            raise _damage(path)
        places.append((str(entry["name"]), kind, shape))
        total += math.prod(shape) * np.dtype(kind).itemsize
    if total != size:
        raise _damage(path)
    return places


INTERVAL = 60.0  # [s]


class Saver:
    """Keeps the state of one render in a file.

    Parameters
    ----------
    path
        The file.
    scene
        What is rendered. A saved state continues it only if everything that decides the picture is the same: scene,
        lens, meshes, pictures, seed, film, layers and version; not the number of samples, the time or the output.
    devices : list of str
        Names of the devices.
    drivers : list of str
        Their drivers.
    part
        What this run renders of the film.
    allow_mixed
        Whether a state that other code, or another driver, has saved is gone on from.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        scene: Scene,
        devices: Sequence[str],
        drivers: Sequence[str],
        part: FilmPart = WHOLE,
        *,
        allow_mixed: bool = False,
    ) -> None:
        self.path, self.part, self._scene = Path(path), part, scene
        self._layout = FilmLayout.of(scene.film)
        self._facts = {
            "version": __version__,
            "resolution": list(scene.film.resolution),
            "crop": list(scene.film.crop or ()),
            "seed": scene.render.seed,
            "noise": scene.render.noise,
            "layers": list(scene.render.layers),
            "layers_spp": scene.render.layers_spp if scene.render.layers else None,
            "scene": scene.content_hash(),
            "part": part.facts(),
        }
        self._devices = list(dict.fromkeys(devices))
        self._drivers, self._same = list(drivers), OneMaker(allow_mixed)
        self.parts: list[Part] = []
        """Which device took which samples of the saved render once it is loaded."""
        self.parts_since: Callable[[int], list[Part]] = lambda done: []
        """The same of this one, up to so many samples per pixel."""
        self.metered_cd_m2: float | None = None
        """What the exposure follows from; that of the saved render once it is loaded."""
        self.focus: dict[str, Any] | None = None
        """What autofocus found, likewise."""
        self.spp: int = scene.render.spp
        """The samples by which the camera's accuracy chose its model, likewise."""
        self.of_picture: dict[str, Any] = {}
        """What the picture is made of without the scene, beside the arrays."""
        self.beside: Callable[[], Mapping[str, NDArray[Any]]] = dict
        """Arrays that it needs beside those of the state."""
        self._saved = time.monotonic()
        self._written = False

    def load(self) -> SavedState | None:
        """Return the saved state; None if there is no file.

        Raises
        ------
        StateError
            The file is damaged, or of another render.
        """
        if not self.path.exists():
            return None
        try:
            saved = self._read()
            self.makers  # noqa: B018 -- this program is the first of them
            self._same.add(str(self.path), saved.facts.get("made_by"))
        except StateError as problem:
            raise StateError(f"{problem} (remove it, or render without --resume)") from None
        self._devices = list(dict.fromkeys([*saved.facts["devices"], *self._devices]))
        self.metered_cd_m2 = saved.facts.get("metered_cd_m2")
        self.focus = saved.facts.get("focus")
        self.spp = saved.facts.get("spp", self.spp)
        self.parts = list(saved.facts.get("work", []))
        _warn_of_not_finite(saved)
        return saved.done, self.part.unpack(saved.arrays, self._layout.tiles, self._layout.pixels)

    @property
    def makers(self) -> list[Maker]:
        """What has made the picture: this program, and others that are allowed."""
        if not self._same.makers:
            self._same.add("this program", made_by(self._drivers))
        return self._same.makers

    def _read(self) -> Checkpoint:
        """Read the file; raise if it is of another render."""
        saved = read_checkpoint(self.path)
        check_facts(self.path, saved.facts)
        facts = self._facts
        if self._may_go_on(saved, self._scene.render.noise):
            before = {"noise": saved.facts["noise"]}
            scene = self._scene.model_copy(update={"render": self._scene.render.model_copy(update=before)})
            facts = facts | before | {"scene": scene.content_hash()}
        for name, value in facts.items():
            if saved.facts.get(name) != value:
                raise self._misfit(name, saved.facts.get(name), value)
        return saved

    def _may_go_on(self, saved: Checkpoint, noise: float | None) -> bool:
        """Return whether a lower noise target can go on, with the bits of one run.

        It can while each tile that was left alone meets it, too: those that do not have missed samples and decisions.
        """
        target, error, tiles = (saved.facts.get("noise"), *map(saved.arrays.get, ("noise_error", "noise_tiles")))
        if target is None or noise is None or noise >= target or error is None or tiles is None:
            return False
        alone = np.setdiff1d(np.arange(len(error)), tiles)
        missed = int(np.count_nonzero(~(error[alone] <= noise)))
        if missed:
            raise StateError(
                f"{self.path}: does not continue this render: {missed} of {len(error)} tiles met its noise target"
                f" {target:g} and were left alone, but do not meet {noise:g}; --noise {target:g} goes on"
            )
        return True

    def _misfit(self, name: str, saved: Any, wanted: Any) -> StateError:
        if name == "part":
            saved, wanted = (part_of_facts(value).title for value in (saved, wanted))
        saved, wanted = ("not given" if value in (None, []) else value for value in (saved, wanted))
        what = {
            "version": f"it was saved by version {saved}, and this is {wanted}",
            "scene": "it is of another scene, or one that has changed since",
        }.get(name, f"its {name} is {saved}, and this render's {wanted}")
        return StateError(f"{self.path}: does not continue this render: {what}")

    @property
    def devices(self) -> str:
        """Names of all devices that have worked on the picture."""
        return ", ".join(self._devices)

    def save_now_and_then(self, state: Callable[[], SavedState]) -> None:
        """Save if the last time is a minute ago. That a file cannot be written does not end the render."""
        if time.monotonic() - self._saved >= INTERVAL:
            self._try_to_save(state)

    def save(self, state: SavedState) -> None:
        """Save a state in place of the last one."""
        write_checkpoint(self.path, *self._contents(state, self.part))
        self._written = True

    def content(self, state: SavedState, part: FilmPart) -> bytes:
        """The content of the file of a part in this state; none is written."""
        return b"".join(_pieces(*self._contents(state, part)))

    def _contents(self, state: SavedState, part: FilmPart) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return the facts and the arrays of a state."""
        resolved = {"metered_cd_m2": self.metered_cd_m2, "focus": self.focus, "spp": self.spp}
        done, arrays = state
        work = join_parts(self.parts, self.parts_since(done))
        facts = {**self._facts, **resolved, "done": done, "devices": self._devices, "work": work}
        facts |= {"picture": self.of_picture, "part": part.facts(), "made_by": self.makers}
        return facts, part.pack({**arrays, **self.beside()}, self._layout.tiles)

    def _try_to_save(self, state: Callable[[], SavedState]) -> bool:
        self._saved = time.monotonic()
        try:
            self.save(state())
        except StateError as error:
            warnings.warn(f"the state of the render is not saved: {error}", UserWarning, stacklevel=2)
            return False
        return True

    def end(self, state: Callable[[], SavedState], *, keep: bool) -> str | None:
        """Save the last state, or remove what this render has saved; return the file's name if it is kept."""
        if keep:
            return str(self.path) if self._try_to_save(state) else None
        if self._written:
            with contextlib.suppress(OSError):
                self.path.unlink()
        return None


def _warn_of_not_finite(saved: Checkpoint) -> None:
    """Warn of pixels whose sums are no finite numbers, as failing memory or an overflow leaves them: they stay so."""
    film, layers = saved.arrays.get("film"), saved.arrays.get("layers")
    summed = [] if film is None else [film]
    if layers is not None:
        summed.append(layers[: 2 * LayerPlanes(saved.facts["layers"]).sums])
    bad = np.zeros(1, np.bool_)
    for planes in summed:
        with np.errstate(invalid="ignore"):
            whole = planes.sum(dtype=np.float64)
        if not np.isfinite(whole):
            bad = bad | ~np.isfinite(planes).all(axis=0)
    if count := int(bad.sum()):
        what = f"{count} pixel{'s' * (count > 1)}"
        warnings.warn(
            f"{saved.path}: {what} of its film hold no finite numbers, and the picture neither (render it again)",
            UserWarning,
            stacklevel=2,
        )


def check_facts(path: Path, facts: dict[str, Any]) -> None:
    """Refuse a saved render whose facts are not of the kinds that one writes.

    Raises
    ------
    StateError
        It names the fact.
    """
    light, work, focus = facts.get("metered_cd_m2"), facts.get("work", []), facts.get("focus")
    known = {
        "done": type(facts.get("done")) is int and 0 <= facts["done"] < 2**31,
        "devices": _is_list(str, facts.get("devices")),
        "metered_cd_m2": light is None or (type(light) in (int, float) and 0 < light < math.inf),
        "focus": focus is None or (_has_dicts(focus, "camera") and _has_dicts(focus, "metadata")),
        "spp": type(facts.get("spp", 1)) is int,
        "work": _is_list(dict, work) and all(map(_is_work, work)),
        "part": _is_part(facts.get("part")),
        "picture": isinstance(facts.get("picture", {}), dict),
    }
    _check(path, known)


def _check(path: Path, right: dict[str, bool]) -> None:
    """Refuse a file by the first of its facts or arrays that is not right."""
    for name, is_right in right.items():
        if not is_right:
            raise _damage(path, name)


def _is_list(kind: type | tuple[type, ...], data: Any, count: int | None = None) -> bool:
    """Return whether data are a list of a kind, none of them true or false, of so many if that is said."""
    right = isinstance(data, list) and all(isinstance(each, kind) and type(each) is not bool for each in data)
    return right and count in (None, len(data))


def _is_part(fact: Any) -> bool:
    try:
        part_of_facts(fact)
    except (ValueError, TypeError):
        return False
    return True


def _has_dicts(fact: Any, key: str) -> bool:
    return isinstance(fact, dict) and isinstance(fact.get(key), dict)


def _is_work(fact: dict[str, Any]) -> bool:
    try:
        first, end = fact["samples"]
        return type(first) is type(end) is int and bool(split_of(fact["split"]))
    except (ValueError, TypeError, KeyError, AttributeError):
        return False


# The picture of a saved render, made on the host without its scene and without a device.


def picture_of(
    saved: Checkpoint, layout: FilmLayout
) -> tuple[NDArray[np.float32], dict[str, Any], dict[str, Any], dict[str, NDArray[Any]]]:
    """Make the picture of a saved render that is whole.

    Returns
    -------
    pixels : (height, width, 3) array
        Mean of the film.
    metadata, stats : dict
        As those of a render.
    layers : dict
        Auxiliary layers by name.
    """
    facts, arrays = saved.facts, saved.arrays
    picture, done, counts = facts["picture"], facts["done"], arrays["counts"]
    samples = np.full((layout.height, layout.width), done, np.uint32)
    named: dict[str, NDArray[Any]] = {"samples": samples}
    planes = LayerPlanes(facts["layers"])
    if planes.names:
        in_rows = layout.in_rows(arrays["layers"])
        named |= layer_arrays(planes, in_rows, np.asarray(picture["eye_m"]))
    tiles = np.full(layout.pixels // films.TILE_PIXELS, done, np.uint32)
    stats: dict[str, Any] = {
        "samples": int(samples.sum(dtype=np.uint64)),
        "spp": done,
        "device": ", ".join(facts["devices"]),
        "not_finite": int(counts[-2]),
        "parts": picture.get("parts", []),
        "made_by": facts["made_by"],
    }
    if picture["has_lens"]:
        stats["lens"] = films.outcomes_of(counts)
    if picture["clamp"] is not None:
        stats["clamp"] = {"limit": picture["clamp"], "removed_share": films.removed_share_of(arrays["film"])}
    named["direct"] = pixels = layout.picture(arrays["film"][:PLANES], tiles)
    named["ghosts"] = np.zeros_like(pixels)  # they are added by `merge`
    lights = films.group_pictures(layout, arrays["film"], tiles, picture.get("light_groups", ()))
    named |= saved_truth(arrays, layout)[0]
    layers = {name: named[name] for name in facts["layers"] if name != "lights"} | lights
    return pixels, _metadata(picture["metadata"], stats), stats, layers


def _metadata(before: dict[str, Any], stats: dict[str, Any]) -> dict[str, Any]:
    """Return metadata with what follows from the samples, in the order that a render gives them."""
    metadata = before | {"spp": stats["spp"], "device": stats["device"]} | of_makers(stats["made_by"])
    metadata["numerics"] = before["numerics"] | {
        "samples_dropped": stats["not_finite"],
        "rays_not_converged": stats["lens"]["no_convergence"] if "lens" in stats else 0,
    }
    if "clamp" in stats:
        metadata["clamp"] = clamp_text(**stats["clamp"])
    if len({tuple(part["devices"]) for part in stats["parts"]}) > 1:
        metadata["parts"] = stats["parts"]
    return metadata


#
# Parts of one render become the whole: tiles and ranges of samples that were rendered in several runs, anywhere.
#
# Tiles are put side by side, so that the film has the bits of one run. Sums of several ranges of samples of a tile
# are added in float64: they differ from those of one run, which adds sample after sample, by the rounding of float32.

Arrays = dict[str, NDArray[Any]]
Planes = NDArray[np.float32]
# Begin the names of what comes to the film of the samples, the same in all parts.
_EXTRA = ("diffraction_", "ghosts_", "truth_")
PASSED = 0  # plane of the layers with the weight of the rays that pass

# What all parts of one render have in common, and how it is said where they have not.
_COMMON = {
    "version": "version",
    "resolution": "resolution",
    "crop": "crop",
    "seed": "seed",
    "noise": "noise target",
    "layers": "layers",
    "layers_spp": "samples of the layers",
}
RESOLVED = {"metered_cd_m2": "exposure", "focus": "focus"}


def read_part(path: str | os.PathLike[str]) -> Checkpoint:
    """Read a saved render that is to be merged.

    Raises
    ------
    StateError
        The file cannot be read, is damaged, or is of a render that cannot be merged.
    """
    path = Path(path)
    saved = read_checkpoint(path)
    facts = saved.facts
    check_facts(path, facts)
    _check(path, {"layers": _is_list(str, facts.get("layers")) and set(facts["layers"]) <= set(LAYER_NAMES)})
    layers = facts["layers"]
    if facts.get("noise") is not None or "variance" in layers:
        raise StateError(f"{path}: a render with a noise target or the layer variance cannot be merged")
    picture = facts.get("picture") or {}
    if not isinstance(picture.get("metadata"), dict):
        raise StateError(f"{path}: was saved by a version that could not merge (render it again)")
    spp, metadata = picture.get("spp"), picture["metadata"]
    extras = {prefix.rstrip("_"): prefix for prefix in _EXTRA}
    right = {name: isinstance(metadata.get(name, {}), dict) for name in extras}
    _check(path, right | {"scene": isinstance(facts.get("scene"), str), "spp": spp is None or type(spp) is int})
    wanted = {what: prefix for what, prefix in extras.items() if metadata.get(what, {}).get("on", False)}
    wanted |= {f"the layer {name}": f"{SHARP}{name}" for name in layers if name in SHARP_LAYERS}
    for what, prefix in wanted.items():
        if not any(name.startswith(prefix) for name in saved.arrays):
            raise StateError(
                f"{path}: was saved whole, or by a version that could not merge {what} (render parts again)"
            )
    return saved


def check_whole(part: Checkpoint) -> None:
    """Refuse a saved render that lacks what the picture is made with, or has something else in its place.

    Raises
    ------
    StateError
        It names the first fact or array.
    """
    facts, picture, arrays = part.facts, part.facts["picture"], part.arrays
    metadata, clamp = picture["metadata"], picture.get("clamp")
    counts = arrays.get("counts", np.zeros(0))
    right = {
        "resolution": _is_list(int, facts.get("resolution"), 2),
        "crop": facts.get("crop") == [] or _is_list((int, float), facts.get("crop"), 4),
        "numerics": isinstance(metadata.get("numerics"), dict),
        "eye_m": _is_list((int, float), picture.get("eye_m"), 3),
        "has_lens": isinstance(picture.get("has_lens"), bool),
        "light_groups": _is_list(str, picture.get("light_groups", [])),
        "clamp": clamp is None or (type(clamp) in (int, float) and clamp > 0),
        "counts": counts.shape == (len(RayStatus) + 2,) and counts.dtype == np.uint64,
    }
    for layer, name in (("crypto_object", "object_names"), ("crypto_material", "material_names")):
        right[name] = layer not in facts["layers"] or _is_list(str, metadata.get(name))
    _check(part.path, right)
    try:
        layout = layout_of(facts)
    except ValueError:
        raise _damage(part.path, "resolution or crop") from None
    held, count = arrays.get("film", counts).shape, part.part.count
    pixels = layout.pixels if count == 1 else films.TILE_PIXELS * (layout.tiles // count)  # of a part, or a tile more
    if len(held) != 2 or held[1] not in (pixels, pixels + films.TILE_PIXELS * (count > 1)):
        raise _damage(part.path, "its array film does not fit")


def _check_same(parts: Sequence[Checkpoint]) -> None:
    """Refuse parts that are not of one render.

    Raises
    ------
    StateError
        It names two of them, and what differs.
    """
    first = parts[0]
    one = first.facts
    for part in parts[1:]:
        other = part.facts
        for name, words in _COMMON.items():
            if one.get(name) != other.get(name):
                values = [_as_text(facts.get(name)) for facts in (one, other)]
                raise _differ(first, part, f"the {words} is {values[0]} there and {values[1]} here")
        if one["scene"] != other["scene"]:
            lenses = [facts["picture"]["metadata"].get("lens") for facts in (one, other)]
            what = "the scene is another"
            if lenses[0] != lenses[1]:
                what = f"the lens is {_as_text(lenses[0])} there and {_as_text(lenses[1])} here"
            raise _differ(first, part, what)
        shown = [facts["picture"]["metadata"].get("picture_hash") for facts in (one, other)]
        if shown[0] != shown[1]:
            raise _differ(first, part, "what follows the film is another: picture, sensor, ghosts, diffraction or stop")
        for name, words in RESOLVED.items():
            if one.get(name) != other.get(name):
                raise _differ(first, part, f"auto {words} differs (first `rptcam settle`, then render that scene)")


def _differ(one: Checkpoint, other: Checkpoint, what: str) -> StateError:
    return StateError(f"{other.path}: is not of the render of {one.path}: {what}")


def _as_text(value: Any) -> str:
    return "not given" if value in (None, []) else str(value)


def layout_of(facts: dict[str, Any]) -> FilmLayout:
    """Return the layout of a saved film."""
    return FilmLayout.of(Film(resolution=tuple(facts["resolution"]), crop=tuple(facts["crop"]) or None))


def _check_complete(parts: Sequence[Checkpoint], layout: FilmLayout) -> int:
    """Return the samples per pixel of the whole; refuse parts that overlap or leave gaps.

    Raises
    ------
    StateError
        It names the overlap, or all gaps.
    """
    end = max(part.end for part in parts)
    reached = np.zeros(layout.tiles, np.int64)
    owner = np.full(layout.tiles, -1)
    gaps: list[str] = []
    for index, part in sorted(enumerate(parts), key=lambda each: each[1].part.first):
        tiles = part.part.tiles(layout.tiles)
        if len(overlap := tiles[reached[tiles] > part.part.first]):
            other = parts[owner[overlap[0]]]
            shared = f"both have the same samples of {len(overlap)} tiles"
            raise StateError(f"{part.title}: overlaps {other.title}: {shared}")
        gaps += _gaps(parts, layout, tiles, reached, part.part.first)
        reached[tiles], owner[tiles] = part.done, index
    gaps += _gaps(parts, layout, np.arange(layout.tiles), reached, end)
    if gaps:
        raise StateError(f"gaps: {'; '.join(gaps)} (render them, or go on with --resume, and merge again)")
    return end


def _gaps(
    parts: Sequence[Checkpoint], layout: FilmLayout, tiles: NDArray[Any], reached: NDArray[np.int64], end: int
) -> list[str]:
    """Name the samples before ``end`` that tiles lack: by parts where it is whole parts, else by tiles."""
    lacking = np.zeros(layout.tiles, np.bool_)
    lacking[tiles] = reached[tiles] < end
    gaps = []
    for begin in np.unique(reached[lacking]):
        alike = lacking & (reached == begin)
        names = []
        for count in sorted({part.part.count for part in parts}):
            for number in range(1, count + 1):
                own = FilmPart(number, count).tiles(layout.tiles)
                if alike.any() and alike[own].all():
                    names.append("the whole film" if count == 1 else f"part {number}/{count}")
                    alike[own] = False
        if alike.any():
            first = int(np.flatnonzero(alike)[0])
            x, y = films.TILE * (first % layout.tiles_across), films.TILE * (first // layout.tiles_across)
            names.append(f"{int(alike.sum())} tiles, the first at pixel {x}, {y}")
        gaps.append(f"samples {begin}:{end} of {', '.join(names)}")
    return gaps


def merge_arrays(parts: Sequence[Checkpoint], layout: FilmLayout) -> Arrays:
    """Return the arrays of the whole, as a saved render has them.

    Raises
    ------
    StateError
        Those of a part do not fit.
    """
    facts = parts[0].facts
    has_limit, groups = facts["picture"].get("clamp") is not None, len(facts["picture"].get("light_groups", ()))
    planes = {"film": films.planes_of(has_limit, groups)}
    layers = LayerPlanes(facts["layers"])
    if layers.names:
        planes["layers"] = layers.count
    whole = {name: np.zeros((count, layout.pixels), np.float32) for name, count in planes.items()}
    counts = np.zeros_like(parts[0].arrays.get("counts", np.zeros(0)), np.uint64)
    for part in sorted(parts, key=lambda each: each.part.first):
        arrays = part.part.unpack(part.arrays, layout.tiles, layout.pixels)
        _check_fit(part, arrays, whole, counts)
        pixels = pixels_of(part.part.tiles(layout.tiles))
        first = PLANES + has_limit
        whole["film"][PLANES:first, pixels] += arrays["film"][PLANES:first, pixels]  # what the limit removed
        for start in (0, *range(first, len(whole["film"]), PLANES)):
            rows = slice(start, start + PLANES)
            _add(whole["film"][rows], arrays["film"][rows], pixels, PLANES // 2)
        _put_sharp(part, arrays, whole, pixels)
        if layers.names:
            for name in layers.owners:
                _add_owners(whole["layers"], arrays["layers"], pixels, 2 * layers.sums + layers.places[name])
            _take_first(whole["layers"], arrays["layers"], pixels, 2 * layers.sums)
            _add(whole["layers"], arrays["layers"], pixels, layers.sums)
        counts += arrays["counts"]
    extra = {name: array for name, array in parts[0].arrays.items() if name.startswith(_EXTRA)}
    return whole | {"counts": counts} | extra


def _check_fit(part: Checkpoint, arrays: Arrays, wanted: Arrays, counts: NDArray[np.uint64]) -> None:
    for name, whole in (wanted | {"counts": counts}).items():
        if name not in arrays or (arrays[name].shape, arrays[name].dtype) != (whole.shape, whole.dtype):
            raise _damage(part.path, f"its array {name} does not fit")


def _put_sharp(part: Checkpoint, arrays: Arrays, merged: Arrays, pixels: NDArray[np.int64]) -> None:
    """Put the sharp layers of some pixels beside those of others; all parts know the same of each."""
    for name in (f"{SHARP}{layer}" for layer in part.facts["layers"] if layer in SHARP_LAYERS):
        own = arrays.get(name, np.zeros(0))
        whole = merged.setdefault(name, np.zeros_like(own))
        if whole.ndim != 2 or own.shape != (len(whole), merged["film"].shape[1]) or own.dtype != whole.dtype:
            raise _damage(part.path, f"its array {name} does not fit")
        whole[:, pixels] = own[:, pixels]


def _add_owners(whole: Planes, part: Planes, pixels: NDArray[np.int64], start: int) -> None:
    """Add the weights that objects or materials have in some pixels, from plane ``start`` on, as a kernel adds rays.

    Each has a slot from where it comes first; what finds none is left out.
    """
    end = start + OWNER_SLOTS * SLOT_PLANES
    slots, new = (planes[start:end, pixels].reshape(OWNER_SLOTS, SLOT_PLANES, -1) for planes in (whole, part))
    for owner, weight, less in new:
        waiting = weight != 0
        for slot in slots:
            free = waiting & (slot[1] == 0)
            slot[:, free] = owner[free], weight[free], less[free]
            mine = waiting & ~free & (slot[0].view(np.int32) == owner.view(np.int32))
            exact = slot[1, mine].astype(np.float64) - slot[2, mine] + weight[mine] - less[mine]
            slot[1, mine] = exact
            slot[2, mine] = slot[1, mine] - exact
            waiting &= ~(free | mine)
    whole[start:end, pixels] = slots.reshape(end - start, -1)


def _take_first(whole: Planes, part: Planes, pixels: NDArray[np.int64], start: int) -> None:
    """Take over the values of the first ray that passes, from plane ``start`` on, where none has before."""
    passed = whole[PASSED, pixels] != 0
    whole[start:, pixels] = np.where(passed, whole[start:, pixels], part[start:, pixels])


def _add(whole: Planes, part: Planes, pixels: NDArray[np.int64], sums: int) -> None:
    """Add the compensated sums of some pixels; where nothing was before, the bits are taken over."""
    new, old = part[: 2 * sums, pixels], whole[: 2 * sums, pixels]
    exact = np.asarray(sum(planes[:sums].astype(np.float64) - planes[sums:] for planes in (old, new)))
    added = exact.astype(np.float32)
    both = np.concatenate([added, (added - exact).astype(np.float32)])
    whole[: 2 * sums, pixels] = np.where(old.any(axis=0), both, new)


def merge_states(paths: Sequence[str | os.PathLike[str]], *, allow_mixed: bool = False) -> Checkpoint:
    """Return the saved render that several parts of it come to.

    Parameters
    ----------
    allow_mixed
        Whether parts that other code, or other drivers, have made are taken too.

    Raises
    ------
    StateError
        A file cannot be read or is damaged; or parts are not of one render, overlap, or leave gaps.
    """
    parts = [read_part(path) for path in paths]
    _check_same(parts)
    same = OneMaker(allow_mixed)
    for part in parts:
        same.add(str(part.path), part.facts.get("made_by"))
    for part in parts:
        check_whole(part)
    layout = layout_of(parts[0].facts)
    for part in parts:
        if part.part.count > layout.tiles:
            raise _damage(part.path, "part")
    end = _check_complete(parts, layout)
    arrays = merge_arrays(parts, layout)
    for part in parts:
        _warn_of_not_finite(part)
    facts = parts[0].facts
    devices = list(dict.fromkeys(name for part in parts for name in part.facts["devices"]))
    whole = facts | {"part": None, "done": end, "devices": devices, "work": _work(parts), "made_by": same.makers}
    whole["picture"] = facts["picture"] | {"parts": [_describe(part) for part in parts]}
    return Checkpoint(parts[0].path, whole, arrays)


def _work(parts: Sequence[Checkpoint]) -> list[Any]:
    """Return the record of devices where all parts have the same one."""
    works = [part.facts.get("work", []) for part in parts]
    return works[0] if all(work == works[0] for work in works) else []


def _describe(part: Checkpoint) -> dict[str, Any]:
    facts = part.facts
    return {"part": part.part.title, "samples": [part.part.first, part.done], "devices": facts["devices"]}
