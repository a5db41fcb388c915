"""Renders that can be interrupted and continued: the file of their state, when it is saved, whether it fits.

Magic, version and length of the header (little endian), the header as JSON, the arrays as they lie in memory (little
endian), and the SHA-256 of all that. Nothing in it is executed when it is read.
"""

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

from rptcam_cl._version import __version__
from rptcam_cl.core.atomic import replacing
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import StateError
from rptcam_cl.core.kept import Maker, OneMaker, made_by
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.film_part import WHOLE, FilmPart, part_of_facts
from rptcam_cl.rendering.film_run import SavedState
from rptcam_cl.rendering.layers import LayerPlanes
from rptcam_cl.rendering.shares import Part, joined, split_of
from rptcam_cl.scene import Scene

MAGIC = b"RPTCAMCK"
VERSION = 1
SUFFIX = ".rpck"
_START = struct.Struct("<8sII")
_MOST_HEADER = 1 << 24
_TYPES = {"<f4", "<f8", "<i4", "<u4", "<u8"}
_DIGEST = hashlib.sha256().digest_size


@dataclass(frozen=True)
class Checkpoint:
    """What a file holds: facts about the render, and arrays by name."""

    facts: dict[str, Any]
    arrays: dict[str, NDArray[Any]]


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
    """Return what a checkpoint holds.

    Raises
    ------
    StateError
        The file cannot be read, is something else, damaged, or of a later version.
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
                raise _damaged(path)
    except OSError as error:
        raise StateError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError, MemoryError) as error:
        raise _damaged(path) from error
    return Checkpoint(facts, arrays)


def _damaged(path: str | os.PathLike[str]) -> StateError:
    return StateError(f"{path}: this saved render is damaged")


def _header_length(path: str | os.PathLike[str], start: bytes, size: int) -> int:
    if len(start) < _START.size or not start.startswith(MAGIC):
        raise StateError(f"{path}: is not a saved render")
    _, version, length = _START.unpack(start)
    if version > VERSION:
        raise StateError(f"{path}: was saved by a later version (its format is {version}; this one reads {VERSION})")
    if length > min(_MOST_HEADER, size):
        raise _damaged(path)
    return int(length)


def _places(path: str | os.PathLike[str], header: bytes, size: int) -> list[tuple[str, str, tuple[int, ...]]]:
    """Return name, type and shape of the arrays; they must fill ``size`` bytes, so that no memory is promised away."""
    found, total = [], 0
    for entry in json.loads(header)["arrays"]:
        kind, shape = entry["type"], tuple(int(length) for length in entry["shape"])
        if kind not in _TYPES or min(shape, default=0) < 0:
            raise _damaged(path)
        found.append((str(entry["name"]), kind, shape))
        total += math.prod(shape) * np.dtype(kind).itemsize
    if total != size:
        raise _damaged(path)
    return found


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
        self.path, self.part = Path(path), part
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
        self.of_picture: dict[str, Any] = {}
        """What `rptcam_cl.rendering.merge` needs to make the picture without the scene."""
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
            found = self._fitting()
            self.makers  # noqa: B018 -- this program is the first of them
            self._same.add(str(self.path), found.facts.get("made_by"))
        except StateError as problem:
            raise StateError(f"{problem} (remove it, or render without --resume)") from None
        self._devices = list(dict.fromkeys([*found.facts["devices"], *self._devices]))
        self.metered_cd_m2 = found.facts.get("metered_cd_m2")
        self.focus = found.facts.get("focus")
        self.parts = list(found.facts.get("work", []))
        warn_of_not_finite(self.path, found)
        arrays = self.part.unpacked(found.arrays, self._layout.tiles, self._layout.pixels)
        return SavedState(int(found.facts["done"]), arrays)

    @property
    def makers(self) -> list[Maker]:
        """What has made the picture: this program, and others that are allowed."""
        if not self._same.makers:
            self._same.add("this program", made_by(self._drivers))
        return self._same.makers

    def _fitting(self) -> Checkpoint:
        found = read_checkpoint(self.path)
        check_facts(self.path, found.facts)
        for name, value in self._facts.items():
            if found.facts.get(name) != value:
                raise self._misfit(name, found.facts.get(name), value)
        return found

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
        """Return what the file of a part would hold in this state; none is written."""
        return b"".join(_pieces(*self._contents(state, part)))

    def _contents(self, state: SavedState, part: FilmPart) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return the facts and the arrays of a state."""
        resolved = {"metered_cd_m2": self.metered_cd_m2, "focus": self.focus}
        work = joined(self.parts, self.parts_since(state.done))
        facts = {**self._facts, **resolved, "done": state.done, "devices": self._devices, "work": work}
        facts |= {"picture": self.of_picture, "part": part.facts(), "made_by": self.makers}
        return facts, part.packed({**state.arrays, **self.beside()}, self._layout.tiles)

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


def warn_of_not_finite(path: Path, saved: Checkpoint) -> None:
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
            f"{path}: {what} of its film hold no finite numbers, and the picture neither (render it again)",
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
        "devices": _are(str, facts.get("devices")),
        "metered_cd_m2": light is None or (type(light) in (int, float) and 0 < light < math.inf),
        "focus": focus is None or (_has_dicts(focus, "camera") and _has_dicts(focus, "metadata")),
        "work": _are(dict, work) and all(map(_is_work, work)),
        "part": _is_part(facts.get("part")),
        "picture": isinstance(facts.get("picture", {}), dict),
    }
    for name, right in known.items():
        if not right:
            raise StateError(f"{path}: this saved render is damaged: {name}")


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


def _are(kind: type, values: Any) -> bool:
    return isinstance(values, list) and all(isinstance(value, kind) for value in values)
