"""Parts of one render become the whole: tiles and ranges of samples that were rendered in several runs, anywhere.

Tiles are put side by side, so that the film has the bits of one run. Sums of several ranges of samples of a tile are
added in float64: they differ from those of one run, which adds sample after sample, by the rounding of float32.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import StateError
from rptcam_cl.core.kept import OneMaker
from rptcam_cl.core.records import RayStatus
from rptcam_cl.rendering.checkpoint import Checkpoint, check_facts, read_checkpoint, warn_of_not_finite
from rptcam_cl.rendering.film import PLANES, TILE, TILE_PIXELS, FilmLayout
from rptcam_cl.rendering.film_part import SHARP, FilmPart, part_of_facts, pixels_of
from rptcam_cl.rendering.layers import OWNER_SLOTS, SLOT_PLANES, LayerPlanes
from rptcam_cl.scene import LAYER_NAMES, SHARP_LAYERS, Film

Arrays = dict[str, NDArray[Any]]
Planes = NDArray[np.float32]
BESIDE = (
    "diffraction_",
    "ghosts_",
    "truth_",
)  # begin the names of what comes to the film of the samples, the same in all parts
PASSED = 0  # plane of the layers with the weight of the rays that pass

# What all parts of one render have in common, and how it is said where they have not.
COMMON = {
    "version": "version",
    "resolution": "resolution",
    "crop": "crop",
    "seed": "seed",
    "noise": "noise target",
    "layers": "layers",
    "layers_spp": "samples of the layers",
}
RESOLVED = {"metered_cd_m2": "exposure", "focus": "focus"}


@dataclass(frozen=True)
class SavedPart:
    """A saved render, whole or a part.

    Attributes
    ----------
    path : Path
    saved : Checkpoint
    part : FilmPart
    done : int
        Number of the first sample that it has not.
    end : int
        Number of the sample that it is to end before.
    """

    path: Path
    saved: Checkpoint
    part: FilmPart
    done: int
    end: int

    @property
    def title(self) -> str:
        """What it is, as people read it."""
        return f"{self.path} ({self.part.title})"


def read_part(path: str | os.PathLike[str]) -> SavedPart:
    """Return a saved render.

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
    right = {name: isinstance(metadata.get(name, {}), dict) for name in (prefix.rstrip("_") for prefix in BESIDE)}
    _check(path, right | {"scene": isinstance(facts.get("scene"), str), "spp": spp is None or type(spp) is int})
    made = {prefix.rstrip("_"): prefix for prefix in BESIDE}
    wanted = {what: prefix for what, prefix in made.items() if metadata.get(what, {}).get("on", False)}
    wanted |= {f"the layer {name}": f"{SHARP}{name}" for name in layers if name in SHARP_LAYERS}
    for what, prefix in wanted.items():
        if not any(name.startswith(prefix) for name in saved.arrays):
            raise StateError(
                f"{path}: was saved whole, or by a version that could not merge {what} (render parts again)"
            )
    part, done = part_of_facts(facts.get("part")), facts["done"]
    end = part.end or (done if part.count == 1 else spp or done)
    return SavedPart(path, saved, part, done, max(end, done))


def _check(path: Path, right: dict[str, bool]) -> None:
    """Refuse a file by the first of its facts or arrays that is not right."""
    for name, is_right in right.items():
        if not is_right:
            raise StateError(f"{path}: this saved render is damaged: {name}")


def _is_list(kind: type | tuple[type, ...], data: Any, count: int | None = None) -> bool:
    """Return whether data are a list of a kind, none of them true or false, of so many if that is said."""
    right = isinstance(data, list) and all(isinstance(each, kind) and type(each) is not bool for each in data)
    return right and count in (None, len(data))


def check_whole(part: SavedPart) -> None:
    """Refuse a saved render that lacks what the picture is made with, or has something else in its place.

    Raises
    ------
    StateError
        It names the first fact or array.
    """
    facts, picture, arrays = part.saved.facts, part.saved.facts["picture"], part.saved.arrays
    metadata, clamp = picture["metadata"], picture.get("clamp")
    counts = arrays.get("counts", np.zeros(0))
    right = {
        "resolution": _is_list(int, facts.get("resolution"), 2),
        "crop": facts.get("crop") == [] or _is_list((int, float), facts.get("crop"), 4),
        "numerics": isinstance(metadata.get("numerics"), dict),
        "eye_m": _is_list((int, float), picture.get("eye_m"), 3),
        "has_lens": isinstance(picture.get("has_lens"), bool),
        "clamp": clamp is None or (type(clamp) in (int, float) and clamp > 0),
        "counts": counts.shape == (len(RayStatus) + 2,) and counts.dtype == np.uint64,
    }
    for layer, name in (("crypto_object", "object_names"), ("crypto_material", "material_names")):
        right[name] = layer not in facts["layers"] or _is_list(str, metadata.get(name))
    _check(part.path, right)
    try:
        layout = layout_of(facts)
    except ValueError:
        raise StateError(f"{part.path}: this saved render is damaged: resolution or crop") from None
    held, count = arrays.get("film", counts).shape, part.part.count
    pixels = layout.pixels if count == 1 else TILE_PIXELS * (layout.tiles // count)  # of a part, or a tile more
    if len(held) != 2 or held[1] not in (pixels, pixels + TILE_PIXELS * (count > 1)):
        raise StateError(f"{part.path}: this saved render is damaged: its array film does not fit")


def check_same(parts: Sequence[SavedPart]) -> None:
    """Refuse parts that are not of one render.

    Raises
    ------
    StateError
        It names two of them, and what differs.
    """
    first = parts[0]
    one = first.saved.facts
    for part in parts[1:]:
        other = part.saved.facts
        for name, words in COMMON.items():
            if one.get(name) != other.get(name):
                values = [_shown(facts.get(name)) for facts in (one, other)]
                raise _differ(first, part, f"the {words} is {values[0]} there and {values[1]} here")
        if one["scene"] != other["scene"]:
            lenses = [facts["picture"]["metadata"].get("lens") for facts in (one, other)]
            what = "the scene is another"
            if lenses[0] != lenses[1]:
                what = f"the lens is {_shown(lenses[0])} there and {_shown(lenses[1])} here"
            raise _differ(first, part, what)
        shown = [facts["picture"]["metadata"].get("picture_hash") for facts in (one, other)]
        if shown[0] != shown[1]:
            raise _differ(first, part, "what follows the film is another: picture, sensor, ghosts, diffraction or stop")
        for name, words in RESOLVED.items():
            if one.get(name) != other.get(name):
                raise _differ(first, part, f"auto {words} differs (first `rptcam settle`, then render that scene)")


def _differ(one: SavedPart, other: SavedPart, what: str) -> StateError:
    return StateError(f"{other.path}: is not of the render of {one.path}: {what}")


def _shown(value: Any) -> str:
    return "not given" if value in (None, []) else str(value)


def layout_of(facts: dict[str, Any]) -> FilmLayout:
    """Return the layout of a saved film."""
    return FilmLayout.of(Film(resolution=tuple(facts["resolution"]), crop=tuple(facts["crop"]) or None))


def check_complete(parts: Sequence[SavedPart], layout: FilmLayout) -> int:
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
    parts: Sequence[SavedPart], layout: FilmLayout, tiles: NDArray[Any], reached: NDArray[np.int64], end: int
) -> list[str]:
    """Return what tiles lack of the samples before ``end``: by parts where it is whole parts, else by tiles."""
    lacking = np.zeros(layout.tiles, np.bool_)
    lacking[tiles] = reached[tiles] < end
    found = []
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
            x, y = TILE * (first % layout.tiles_across), TILE * (first // layout.tiles_across)
            names.append(f"{int(alike.sum())} tiles, the first at pixel {x}, {y}")
        found.append(f"samples {begin}:{end} of {', '.join(names)}")
    return found


def merged_arrays(parts: Sequence[SavedPart], layout: FilmLayout) -> Arrays:
    """Return the arrays of the whole, as a saved render has them.

    Raises
    ------
    StateError
        Those of a part do not fit.
    """
    facts = parts[0].saved.facts
    planes = {"film": PLANES + int(facts["picture"].get("clamp") is not None)}
    layers = LayerPlanes(facts["layers"])
    if layers.names:
        planes["layers"] = layers.count
    found = {name: np.zeros((count, layout.pixels), np.float32) for name, count in planes.items()}
    counts = np.zeros_like(parts[0].saved.arrays.get("counts", np.zeros(0)), np.uint64)
    for part in sorted(parts, key=lambda each: each.part.first):
        arrays = part.part.unpacked(part.saved.arrays, layout.tiles, layout.pixels)
        _check_fit(part, arrays, found, counts)
        pixels = pixels_of(part.part.tiles(layout.tiles))
        found["film"][PLANES:, pixels] += arrays["film"][PLANES:, pixels]  # what a limit of the samples removed
        _add(found["film"], arrays["film"], pixels, PLANES // 2)
        _put_sharp(part, arrays, found, pixels)
        if layers.names:
            for name in layers.owners:
                _add_owners(found["layers"], arrays["layers"], pixels, 2 * layers.sums + layers.places[name])
            _take_first(found["layers"], arrays["layers"], pixels, 2 * layers.sums)
            _add(found["layers"], arrays["layers"], pixels, layers.sums)
        counts += arrays["counts"]
    beside = {name: array for name, array in parts[0].saved.arrays.items() if name.startswith(BESIDE)}
    return found | {"counts": counts} | beside


def _check_fit(part: SavedPart, arrays: Arrays, found: Arrays, counts: NDArray[np.uint64]) -> None:
    for name, whole in (found | {"counts": counts}).items():
        if name not in arrays or (arrays[name].shape, arrays[name].dtype) != (whole.shape, whole.dtype):
            raise StateError(f"{part.path}: this saved render is damaged: its array {name} does not fit")


def _put_sharp(part: SavedPart, arrays: Arrays, found: Arrays, pixels: NDArray[np.int64]) -> None:
    """Put the sharp layers of some pixels beside those of others; all parts know the same of each."""
    for name in (f"{SHARP}{layer}" for layer in part.saved.facts["layers"] if layer in SHARP_LAYERS):
        own = arrays.get(name, np.zeros(0))
        whole = found.setdefault(name, np.zeros_like(own))
        if whole.ndim != 2 or own.shape != (len(whole), found["film"].shape[1]) or own.dtype != whole.dtype:
            raise StateError(f"{part.path}: this saved render is damaged: its array {name} does not fit")
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


def merged_state(paths: Sequence[str | os.PathLike[str]], *, allow_mixed: bool = False) -> Checkpoint:
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
    check_same(parts)
    same = OneMaker(allow_mixed)
    for part in parts:
        same.add(str(part.path), part.saved.facts.get("made_by"))
    for part in parts:
        check_whole(part)
    layout = layout_of(parts[0].saved.facts)
    for part in parts:
        if part.part.count > layout.tiles:
            raise StateError(f"{part.path}: this saved render is damaged: part")
    end = check_complete(parts, layout)
    arrays = merged_arrays(parts, layout)
    for part in parts:
        warn_of_not_finite(part.path, part.saved)
    facts = parts[0].saved.facts
    devices = list(dict.fromkeys(name for part in parts for name in part.saved.facts["devices"]))
    whole = facts | {"part": None, "done": end, "devices": devices, "work": _work(parts), "made_by": same.makers}
    whole["picture"] = facts["picture"] | {"parts": [_described(part) for part in parts]}
    return Checkpoint(whole, arrays)


def _work(parts: Sequence[SavedPart]) -> list[Any]:
    """Return the record of devices where all parts have the same one."""
    works = [part.saved.facts.get("work", []) for part in parts]
    return works[0] if all(work == works[0] for work in works) else []


def _described(part: SavedPart) -> dict[str, Any]:
    facts = part.saved.facts
    return {"part": part.part.title, "samples": [part.part.first, part.done], "devices": facts["devices"]}
