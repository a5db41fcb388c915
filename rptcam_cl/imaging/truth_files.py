"""Masks of instances and classes, and COCO annotations, of a picture with sharp identifiers.

The format is that of the data set "Common Objects in Context" (Lin et al. 2014) and its `cocoapi`: masks as run lengths
down the columns, as text of six bits a letter.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.files import replacing, unlinked

#
# Cryptomatte: which objects share a pixel and how much of it each covers, as compositing programs read it.
#
# After Friedman and Jones, "Fully automatic ID mattes with support for motion blur and transparency" (SIGGRAPH 2015
# posters) and the specification 1.2.0 of Psyop: names become 32-bit floats by MurmurHash3, pairs of these and of
# coverages lie in channels by rank, and a manifest in the header says which name is which.

RANKS = 6  # of a pixel, those with most coverage
NAMES = {"crypto_object": "object_names", "crypto_material": "material_names"}  # metadata with the names of each layer
KEY_DIGITS = 7  # of a layer's hash, in the keys of the header
EXPONENT, LOWEST_OF_EXPONENT = 0x7F800000, 1 << 23
WORD = 0xFFFFFFFF


def rank_channels(layer: str) -> tuple[str, ...]:
    """Return the EXR channels of a layer: identifier and coverage of two ranks in each group of four."""
    groups = range(-(-RANKS // 2))
    return tuple(f"{layer}{group:02d}.{channel}" for group in groups for channel in "RGBA")[: 2 * RANKS]


def murmur3_32(data: bytes, seed: int = 0) -> int:
    """Return MurmurHash3_x86_32 of some bytes (Appleby's public-domain definition)."""
    state, whole = seed, len(data) & ~3
    for start in range(0, whole, 4):
        state ^= _scramble(int.from_bytes(data[start : start + 4], "little"))
        state = (_rotate(state, 13) * 5 + 0xE6546B64) & WORD
    if tail := data[whole:]:
        state ^= _scramble(int.from_bytes(tail, "little"))
    state ^= len(data)
    state = ((state ^ state >> 16) * 0x85EBCA6B) & WORD
    state = ((state ^ state >> 13) * 0xC2B2AE35) & WORD
    return state ^ state >> 16


def _scramble(word: int) -> int:
    return (_rotate((word * 0xCC9E2D51) & WORD, 15) * 0x1B873593) & WORD


def _rotate(word: int, places: int) -> int:
    return (word << places | word >> (32 - places)) & WORD


def name_hash(name: str) -> int:
    """Return the bits of a name's identifier: its hash, changed where as a float it would be no normal number."""
    bits = murmur3_32(name.encode())
    return bits ^ LOWEST_OF_EXPONENT if bits & EXPONENT in (0, EXPONENT) else bits


def identifier(name: str) -> np.float32:
    """Return the float that stands for a name in the channels."""
    return np.uint32(name_hash(name)).view(np.float32)


def ranked(owners: NDArray[np.float64], names: Sequence[str]) -> NDArray[np.float32]:
    """Return identifiers and coverages in turn (height, width, 2 * `RANKS`), most coverage first.

    Things of one name are one thing.

    Parameters
    ----------
    owners : (height, width, slots, 2) array
        Indices of names, and coverages; 0 where a slot is free.
    """
    height, width, slots, _ = owners.shape
    pairs = owners.reshape(-1, slots, 2)
    _, first = np.unique(np.array([name_hash(name) for name in names], np.uint32), return_index=True)
    numbers = {name_hash(names[index]): index for index in first.tolist()}
    merged = np.array([numbers[name_hash(name)] for name in names] or [0])
    index = merged[np.clip(pairs[..., 0].astype(np.int64), 0, len(merged) - 1)]
    cover = pairs[..., 1].copy()
    for slot in range(1, slots):  # what has the name of an earlier slot is added there
        for before in range(slot):
            same = (index[:, slot] == index[:, before]) & (cover[:, before] > 0)
            cover[same, before] += cover[same, slot]
            cover[same, slot] = 0.0
    order = np.lexsort((index, -cover), axis=1)[:, :RANKS]
    cover, index = np.take_along_axis(cover, order, axis=1), np.take_along_axis(index, order, axis=1)
    hashes = np.array([identifier(name) for name in names] or [np.float32(0)], np.float32)
    ranks = np.zeros((len(pairs), 2 * RANKS), np.float32)
    ranks[:, 0 : 2 * cover.shape[1] : 2] = np.where(cover > 0, hashes[index], np.float32(0.0))
    ranks[:, 1 : 2 * cover.shape[1] : 2] = cover
    return ranks.reshape(height, width, 2 * RANKS)


def header_of(layers: Mapping[str, Any], metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return the attributes of an EXR header that describe the Cryptomatte layers among these; none without any."""
    header: dict[str, str] = {}
    for layer, key in NAMES.items():
        if layer in layers:
            prefix = f"cryptomatte/{name_hash(layer):08x}"[: len("cryptomatte/") + KEY_DIGITS]
            manifest = {name: f"{name_hash(name):08x}" for name in metadata.get(key, ())}
            header |= {
                f"{prefix}/name": layer,
                f"{prefix}/hash": "MurmurHash3_32",
                f"{prefix}/conversion": "uint32_to_float32",
                f"{prefix}/manifest": json.dumps(manifest, separators=(",", ":"), ensure_ascii=True),
            }
    return header


NEEDS = ("sharp_object_id", "sharp_class_id")
LABELS = (*NEEDS, "occlusion", "pupil_depth")  # layers of masks, annotations and depth
TRUTH_FILES = ("coco.json", "instances.png", "classes.png", "depth.npy")  # the last with its layer alone
MOST_INSTANCES = 65535  # of a mask of 16 bits
UNLABELLED = "object"  # category of what has no label, the last one


def run_lengths(mask: NDArray[np.bool_]) -> list[int]:
    """Return how many pixels a mask is off, on, off and so on, down its columns."""
    flat = np.concatenate([[False], mask.ravel(order="F")])
    changes = np.flatnonzero(flat[1:] != flat[:-1])
    runs: list[int] = np.diff(np.concatenate([[0], changes, [mask.size]])).tolist()
    return runs


def run_text(runs: list[int]) -> str:
    """Return run lengths as COCO's text: from the third on less those two before, in groups of five bits."""
    text = []
    for index, run in enumerate(runs):
        value = run - runs[index - 2] if index > 2 else run
        more = True
        while more:
            bits = value & 0x1F
            value >>= 5
            more = value != -1 if bits & 0x10 else value != 0
            text.append(chr((bits | 0x20 if more else bits) + 48))
    return "".join(text)


def coco(
    layers: Mapping[str, NDArray[Any]], metadata: Mapping[str, Any], file_name: str, image_id: int | None = None
) -> dict[str, Any]:
    """Return the COCO annotations of a picture: an instance for each object that a chief ray meets first.

    Parameters
    ----------
    image_id
        Number of the picture among others; identifiers of annotations differ from theirs. By default it is alone.

    Raises
    ------
    InputError
        When a layer is missing.
    """
    check_layers_of_truth(layers)
    check_names(layers, metadata)
    objects, names = layers["sharp_object_id"], metadata["object_names"]
    classes, of_object = metadata["class_names"], metadata["object_classes"]
    hidden, (height, width) = metadata.get("occlusion"), objects.shape
    categories = categories_of(classes)
    number_of = {each["name"]: each["id"] for each in categories}
    picture, before = (1, 0) if image_id is None else (image_id, image_id * (MOST_INSTANCES + 1))
    annotations = []
    for index in np.unique(objects[objects >= 0]).tolist():
        mask = objects == index
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        box = [columns[0], rows[0], columns[-1] - columns[0] + 1, rows[-1] - rows[0] + 1]
        annotations.append(
            {
                "id": before + index + 1, "image_id": picture,
                "category_id": of_object[index] or number_of[UNLABELLED], "iscrowd": 0,
                "segmentation": {"size": [height, width], "counts": run_text(run_lengths(mask))},
                "area": int(mask.sum()), "bbox": [float(value) for value in box], "name": names[index],
                **({} if hidden is None else {"occlusion": hidden[index]}),
            }
        )  # fmt: skip
    image = {"id": picture, "file_name": file_name, "width": width, "height": height}
    return {"images": [image], "categories": categories, "annotations": annotations}


def categories_of(classes: Sequence[str]) -> list[dict[str, Any]]:
    """Return the categories of class names, of which the first stands for what has none: by their index, it last."""
    named = classes if UNLABELLED in classes else [*classes, UNLABELLED]
    return [{"id": number, "name": name} for number, name in enumerate(named) if number]


def with_classes(
    layers: Mapping[str, NDArray[Any]], metadata: Mapping[str, Any], classes: Sequence[str]
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return layers and metadata of a picture with the numbers of a table of classes that has all of its own."""
    places = np.array([classes.index(name) for name in metadata["class_names"]], np.int32)
    numbers = places[metadata["object_classes"]].tolist()
    said = {"class_names": list(classes), "object_classes": numbers}
    return {**layers, "sharp_class_id": places[layers["sharp_class_id"]]}, {**metadata, **said}


def check_layers_of_truth(layers: Mapping[str, NDArray[Any]]) -> None:
    """Refuse a picture without the layers of instances and classes."""
    if missing := [name for name in NEEDS if name not in layers]:
        raise InputError(f"annotations need the layers {' and '.join(NEEDS)} (missing: {', '.join(missing)})")


def check_names(layers: Mapping[str, NDArray[Any]], metadata: Mapping[str, Any]) -> None:
    """Refuse metadata that do not name the objects and classes of a picture."""
    count = int(layers["sharp_object_id"].max(initial=-1)) + 1
    names, classes, of_object = (metadata.get(key) for key in ("object_names", "class_names", "object_classes"))
    lists = [each for each in (names, classes, of_object) if isinstance(each, list | tuple)]
    known = len(lists) == 3 and min(len(lists[0]), len(lists[2])) >= count
    if not (known and all(isinstance(each, int) and 0 <= each < len(lists[1]) for each in lists[2])):
        raise InputError("annotations need object_names, class_names and object_classes of all objects in the metadata")


def save_truth(
    folder: Path,
    layers: Mapping[str, NDArray[Any]],
    metadata: Mapping[str, Any],
    file_name: str,
    *,
    image_id: int | None = None,
    prefix: str = "",
) -> list[Path]:
    """Write `coco.json`, masks of 16 bits and, with their layers, `depth.npy` and `rays.npz`; return the files.

    Parameters
    ----------
    image_id
        As for `coco`.
    prefix
        What the names of the files begin with.

    Raises
    ------
    InputError
        When a layer is missing, or there are too many objects for a mask.
    StateError
        When a file cannot be written.
    """
    check_layers_of_truth(layers)
    if layers["sharp_object_id"].max(initial=0) >= MOST_INSTANCES:
        raise InputError(f"masks of 16 bits hold {MOST_INSTANCES} objects (allowed: fewer)")
    said = coco(layers, metadata, file_name, image_id)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise StateError(f"{folder}: cannot be made ({problem.strerror})") from None
    written = [unlinked(folder / f"{prefix}{name}") for name in TRUTH_FILES]
    depth = written.pop()
    with replacing(written[0]) as temporary:
        temporary.write_text(json.dumps(said) + "\n", encoding="utf-8")
    _write_mask(written[1], layers["sharp_object_id"] + 1)
    _write_mask(written[2], layers["sharp_class_id"])
    if "pupil_depth" in layers:
        written.append(depth)
        with replacing(depth) as temporary, temporary.open("xb") as stream:
            np.save(stream, layers["pupil_depth"])
    rays = {name: layers[name] for name in ("ray_origin", "ray_direction") if name in layers}
    if rays:
        written.append(unlinked(folder / f"{prefix}rays.npz"))
        with replacing(written[-1]) as temporary, temporary.open("xb") as stream:
            np.savez_compressed(stream, **rays)  # type: ignore[arg-type]
    return written


def _write_mask(path: Path, values: NDArray[np.int32]) -> None:
    import PIL.Image

    with replacing(path) as temporary, temporary.open("xb") as stream:
        PIL.Image.fromarray(np.ascontiguousarray(values, np.uint16)).save(stream, "PNG")
