"""Picture files: PNG, JPEG and TIFF for screens, OpenEXR and NumPy arrays for the linear film, its layers and masks."""

from __future__ import annotations

import itertools
import json
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO, TypeGuard

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import files
from rptcam_cl.core.colour import PRIMARIES, Primaries, srgb_from_primaries
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.imaging import formats
from rptcam_cl.imaging.development import WHOLE, Part, developed_codes, quantise
from rptcam_cl.scene.assets.pictures import write_exr
from rptcam_cl.scene.film import LIGHT_LAYER, PictureSettings

# Masks of instances and classes, and COCO annotations, of a picture with sharp identifiers.
#
# The format is that of the data set "Common Objects in Context" (Lin et al. 2014) and its `cocoapi`: masks as run
# lengths down the columns, as text of six bits a letter.

#
# Cryptomatte: which objects share a pixel and how much of it each covers, as compositing programs read it.
#
# After Friedman and Jones, "Fully automatic ID mattes with support for motion blur and transparency" (SIGGRAPH 2015
# posters) and the specification 1.2.0 of Psyop: names become 32-bit floats by MurmurHash3, pairs of these and of
# coverages lie in channels by rank, and a manifest in the header says which name is which.

_RANKS = 6  # of a pixel, those with most coverage
NAMES = {"crypto_object": "object_names", "crypto_material": "material_names"}  # metadata with the names of each layer
_KEY_DIGITS = 7  # of a layer's hash, in the keys of the header
EXPONENT, LOWEST_OF_EXPONENT = 0x7F800000, 1 << 23
_WORD = 0xFFFFFFFF


def _rank_channels(layer: str) -> tuple[str, ...]:
    """Return the EXR channels of a layer: identifier and coverage of two ranks in each group of four."""
    groups = range(-(-_RANKS // 2))
    return tuple(f"{layer}{group:02d}.{channel}" for group in groups for channel in "RGBA")[: 2 * _RANKS]


def murmur3_32(data: bytes, seed: int = 0) -> int:
    """Return MurmurHash3_x86_32 of some bytes (Appleby's public-domain definition)."""
    state, whole = seed, len(data) & ~3
    for start in range(0, whole, 4):
        state ^= _scramble(int.from_bytes(data[start : start + 4], "little"))
        state = (_rotate(state, 13) * 5 + 0xE6546B64) & _WORD
    if tail := data[whole:]:
        state ^= _scramble(int.from_bytes(tail, "little"))
    state ^= len(data)
    state = ((state ^ state >> 16) * 0x85EBCA6B) & _WORD
    state = ((state ^ state >> 13) * 0xC2B2AE35) & _WORD
    return state ^ state >> 16


def _scramble(word: int) -> int:
    return (_rotate((word * 0xCC9E2D51) & _WORD, 15) * 0x1B873593) & _WORD


def _rotate(word: int, places: int) -> int:
    return (word << places | word >> (32 - places)) & _WORD


def name_hash(name: str) -> int:
    """Return the bits of a name's identifier: its hash, changed where as a float it would be no normal number."""
    bits = murmur3_32(name.encode())
    return bits ^ LOWEST_OF_EXPONENT if bits & EXPONENT in (0, EXPONENT) else bits


def identifier(name: str) -> np.float32:
    """Return the float that stands for a name in the channels."""
    return np.uint32(name_hash(name)).view(np.float32)


def ranked(owners: NDArray[np.float64], names: Sequence[str]) -> NDArray[np.float32]:
    """Return identifiers and coverages in turn (height, width, 2 * `_RANKS`), most coverage first.

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
    order = np.lexsort((index, -cover), axis=1)[:, :_RANKS]
    cover, index = np.take_along_axis(cover, order, axis=1), np.take_along_axis(index, order, axis=1)
    hashes = np.array([identifier(name) for name in names] or [np.float32(0)], np.float32)
    ranks = np.zeros((len(pairs), 2 * _RANKS), np.float32)
    ranks[:, 0 : 2 * cover.shape[1] : 2] = np.where(cover > 0, hashes[index], np.float32(0.0))
    ranks[:, 1 : 2 * cover.shape[1] : 2] = cover
    return ranks.reshape(height, width, 2 * _RANKS)


def header_of(layers: Mapping[str, Any], metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return the attributes of an EXR header that describe the Cryptomatte layers among these; none without any."""
    header: dict[str, str] = {}
    for layer, key in NAMES.items():
        if layer in layers:
            prefix = f"cryptomatte/{name_hash(layer):08x}"[: len("cryptomatte/") + _KEY_DIGITS]
            manifest = {name: f"{name_hash(name):08x}" for name in metadata.get(key, ())}
            header |= {
                f"{prefix}/name": layer,
                f"{prefix}/hash": "MurmurHash3_32",
                f"{prefix}/conversion": "uint32_to_float32",
                f"{prefix}/manifest": json.dumps(manifest, separators=(",", ":"), ensure_ascii=True),
            }
    return header


_NEEDS = ("sharp_object_id", "sharp_class_id")
LABELS = (*_NEEDS, "occlusion", "pupil_depth")  # layers of masks, annotations and depth
TRUTH_FILES = ("coco.json", "instances.png", "classes.png", "depth.npy")  # the last with its layer alone
MOST_INSTANCES = 65535  # of a mask of 16 bits
_UNLABELLED = "object"  # category of what has no label, the last one


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
    _check_layers_of_truth(layers)
    _check_names(layers, metadata)
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
                "category_id": of_object[index] or number_of[_UNLABELLED], "iscrowd": 0,
                "segmentation": {"size": [height, width], "counts": run_text(run_lengths(mask))},
                "area": int(mask.sum()), "bbox": [float(value) for value in box], "name": names[index],
                **({} if hidden is None else {"occlusion": hidden[index]}),
            }
        )  # fmt: skip
    image = {"id": picture, "file_name": file_name, "width": width, "height": height}
    return {"images": [image], "categories": categories, "annotations": annotations}


def categories_of(classes: Sequence[str]) -> list[dict[str, Any]]:
    """Return the categories of class names, of which the first stands for what has none: by their index, it last."""
    named = classes if _UNLABELLED in classes else [*classes, _UNLABELLED]
    return [{"id": number, "name": name} for number, name in enumerate(named) if number]


def with_classes(
    layers: Mapping[str, NDArray[Any]], metadata: Mapping[str, Any], classes: Sequence[str]
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return layers and metadata of a picture with the numbers of a table of classes that has all of its own."""
    places = np.array([classes.index(name) for name in metadata["class_names"]], np.int32)
    numbers = places[metadata["object_classes"]].tolist()
    said = {"class_names": list(classes), "object_classes": numbers}
    return {**layers, "sharp_class_id": places[layers["sharp_class_id"]]}, {**metadata, **said}


def _check_layers_of_truth(layers: Mapping[str, NDArray[Any]]) -> None:
    """Refuse a picture without the layers of instances and classes."""
    if missing := [name for name in _NEEDS if name not in layers]:
        raise InputError(f"annotations need the layers {' and '.join(_NEEDS)} (missing: {', '.join(missing)})")


def _check_names(layers: Mapping[str, NDArray[Any]], metadata: Mapping[str, Any]) -> None:
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
    _check_layers_of_truth(layers)
    if layers["sharp_object_id"].max(initial=0) >= MOST_INSTANCES:
        raise InputError(f"masks of 16 bits hold {MOST_INSTANCES} objects (allowed: fewer)")
    said = coco(layers, metadata, file_name, image_id)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise StateError(f"{folder}: cannot be made ({problem.strerror})") from None
    written = [files.resolve_links(folder / f"{prefix}{name}") for name in TRUTH_FILES]
    depth = written.pop()
    with files.replacing(written[0]) as temporary:
        temporary.write_text(json.dumps(said) + "\n", encoding="utf-8")
    _write_mask(written[1], layers["sharp_object_id"] + 1)
    _write_mask(written[2], layers["sharp_class_id"])
    if "pupil_depth" in layers:
        written.append(depth)
        with files.replacing(depth) as temporary:
            formats.write_npy(temporary, layers["pupil_depth"])
    rays = {name: layers[name] for name in ("ray_origin", "ray_direction") if name in layers}
    if rays:
        written.append(files.resolve_links(folder / f"{prefix}rays.npz"))
        with files.replacing(written[-1]) as temporary, temporary.open("xb") as stream:
            np.savez_compressed(stream, **rays)  # type: ignore[arg-type]
    return written


def _write_mask(path: Path, values: NDArray[np.int32]) -> None:
    import PIL.Image

    with files.replacing(path) as temporary, temporary.open("xb") as stream:
        PIL.Image.fromarray(np.ascontiguousarray(values, np.uint16)).save(stream, "PNG")


# Auxiliary layers of a picture: what each is called in files, and the check of their arrays.

Layer = NDArray[Any]

# EXR channels by layer, as compositors know them: a plain Z is the depth, N the normal.
CHANNELS: dict[str, tuple[str, ...]] = {
    "depth": ("Z",),
    "distance": ("distance.X",),
    "position": ("position.X", "position.Y", "position.Z"),
    "normal": ("N.X", "N.Y", "N.Z"),
    "geometric_normal": ("Ng.X", "Ng.Y", "Ng.Z"),
    "albedo": ("albedo.R", "albedo.G", "albedo.B"),
    "coverage": ("coverage.X",),
    "coc": ("coc.X",),
    "transmittance": ("transmittance.R", "transmittance.G", "transmittance.B"),
    "object_id": ("object_id.X",),
    "material_id": ("material_id.X",),
    "uv": ("uv.U", "uv.V"),
    "pupil": ("pupil.X", "pupil.Y"),
    "samples": ("samples.X",),
    "variance": ("variance.Y",),
    "direct": ("direct.R", "direct.G", "direct.B"),
    "ghosts": ("ghosts.R", "ghosts.G", "ghosts.B"),
    "crypto_object": _rank_channels("crypto_object"),
    "crypto_material": _rank_channels("crypto_material"),
    "sharp_depth": ("sharp.Z",),
    "pupil_depth": ("pupil_depth.Z",),
    "sharp_position": ("sharp_position.X", "sharp_position.Y", "sharp_position.Z"),
    "sharp_normal": ("sharp_N.X", "sharp_N.Y", "sharp_N.Z"),
    "sharp_object_id": ("sharp_object_id.X",),
    "sharp_material_id": ("sharp_material_id.X",),
    "sharp_class_id": ("sharp_class_id.X",),
    "occlusion": ("occlusion.X",),
    "flow_forward": ("forward.u", "forward.v"),
    "flow_backward": ("backward.u", "backward.v"),
    "motion": ("motion.u", "motion.v"),
    "ray_origin": ("ray_origin.X", "ray_origin.Y", "ray_origin.Z"),
    "ray_direction": ("ray_direction.X", "ray_direction.Y", "ray_direction.Z"),
}


def _channels_of(name: str) -> tuple[str, ...] | None:
    return tuple(f"{name}.{colour}" for colour in "RGB") if name.startswith(LIGHT_LAYER) else CHANNELS.get(name)


def check_layers(layers: Mapping[str, Layer], height: int, width: int) -> None:
    """Refuse layers that are not of a picture of this size.

    Raises
    ------
    InputError
        A layer is not one of `CHANNELS`, or its shape does not fit the picture.
    """
    for name, values in layers.items():
        if (channels := _channels_of(name)) is None:
            raise InputError(f"layers: unknown layer (got {name}; allowed {', '.join(CHANNELS)})")
        count = len(channels)
        shape = (height, width) if count == 1 else (height, width, count)
        if np.shape(values) != shape:
            raise InputError(f"layers: {name}: wrong shape (got {np.shape(values)}; allowed {shape})")


def _exr_channels(layers: Mapping[str, Layer]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield name and values (height, width) of each EXR channel; identifiers are floats there, as readers expect."""
    for name, values in layers.items():
        planes = values[..., None] if values.ndim == 2 else values
        for index, channel in enumerate(_channels_of(name) or ()):
            yield channel, planes[..., index]


def _is_colour(layer: str) -> bool:
    """Return whether a layer holds red, green and blue."""
    return [channel.rpartition(".")[2] for channel in _channels_of(layer) or ()] == ["R", "G", "B"]


# Marks of focus zones: their outlines in a developed picture.

Codes = NDArray[np.unsignedinteger[Any]]

MARKED = "marked_zones"  # in the metadata: rectangles [left, right, top, bottom] in fractions of the whole film
_LINES_PER_SIDE = 400  # a line is as thick as the shorter side over this, at least a pixel


def _with_rectangles(codes: Codes, rectangles: Sequence[Sequence[float]], part: Part) -> Codes:
    """Return a picture (height, width, 3) with the outlines of rectangles in white.

    Parameters
    ----------
    rectangles
        Left, right, top and bottom of each, in fractions of the whole film.
    part
        Which part of the film the picture is.
    """
    drawn = codes.copy()
    height, width = codes.shape[:2]
    thick = max(round(min(height, width) / _LINES_PER_SIDE), 1)
    x0, x1, y0, y1 = part
    for left, right, top, bottom in rectangles:
        columns = [round((x - x0) / (x1 - x0) * width) for x in (left, right)]
        rows = [round((y - y0) / (y1 - y0) * height) for y in (top, bottom)]
        box = np.zeros((height, width), np.bool_)
        box[_span(rows, 0, height), _span(columns, 0, width)] = True
        box[_span(rows, thick, height), _span(columns, thick, width)] = False
        drawn[box] = np.iinfo(codes.dtype).max
    return drawn


def _span(ends: Sequence[int], inset: int, size: int) -> slice:
    first, last = ends[0] + inset, ends[1] - inset
    return slice(min(max(first, 0), size), min(max(last, 0), size))


Pixels = NDArray[np.float32]
Metadata = Mapping[str, Any]
Layers = Mapping[str, Layer]

# Names that OpenEXR gives a meaning of its own, and drops or refuses when the type is another.
_EXR_RESERVED = {
    "channels", "chunkCount", "compression", "dataWindow", "displayWindow", "lineOrder", "maxSamplesPerPixel", "name",
    "pixelAspectRatio", "screenWindowCenter", "screenWindowWidth", "tiles", "type", "version", "view",
}  # fmt: skip
_TIMECODE_FLAGS = 14  # drop frame, colour frame, phase, three group flags and eight groups of user bits: none
# The colours of films by the names of the Color Interop Forum, which OpenEXR 3.4 recommends.
_EXR_COLOUR_SPACES: dict[Primaries, str] = {
    "rec709": "lin_rec709_scene",
    "rec2020": "lin_rec2020_scene",
    "acescg": "lin_ap1_scene",
}
_MOST_MARKS = 1000
PNG_BITS, TIFF_BITS = 8, 16  # unless the picture says otherwise
_JPEG_BITS = 8  # whatever the picture says: the format has no other
_JPEG_FULL_COLOUR = 90  # quality from which on colour has the full resolution
_JPEG_COMMENT = 65_533  # bytes that a comment holds at most
_JPEG_SIDE = 65_500  # pixels along a side that libjpeg writes at most


def _text(value: Any) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, np.generic):
        value = value.item()
    return json.dumps(value, default=str)


def _exr_value(value: Any) -> str | int | float:
    """Return a value as an EXR attribute: integers of 32 bits and floats exact in float32 as numbers, else text."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, int) and not isinstance(value, bool) and -(2**31) <= value < 2**31:
        return value
    with np.errstate(over="ignore"):
        if isinstance(value, float) and float(np.float32(value)) == value:
            return value
    return _text(value)


def _place(metadata: Metadata, pixels: Pixels) -> tuple[int, int, int, int] | None:
    """Return x, y, width and height [pixels] of the pixels in the whole film; None where that is not known."""
    window, film = metadata.get("window"), metadata.get("resolution")
    if not (_are_counts(window, 4) and _are_counts(film, 2) and all(film)):
        return None
    x, y, width, height = window
    return (x, y, width, height) if pixels.shape[:2] == (height, width) else None  # pixels that were scaled since


def _are_counts(value: Any, length: int) -> TypeGuard[Sequence[int]]:
    """Return whether metadata, which may come from a file of another program, are a list of so many counts."""
    return (
        isinstance(value, (list, tuple))
        and len(value) == length
        and all(isinstance(item, int) and 0 <= item < 2**31 for item in value)
    )


def _rectangles(value: Any) -> list[Sequence[float]]:
    """Return the rectangles of a piece of metadata, which may come from a file of another program."""
    rows = value if isinstance(value, (list, tuple)) else []
    return [row for row in rows[:_MOST_MARKS] if isinstance(row, (list, tuple)) and len(row) == 4 and _are_shares(row)]


def _are_shares(values: Sequence[Any]) -> bool:
    return all(isinstance(value, (int, float)) and abs(value) < 1e3 for value in values)


def film_part(metadata: Metadata, pixels: Pixels) -> Part:
    """Return the part of the film that the pixels are: x0, x1, y0, y1 in fractions from its left and top."""
    if (place := _place(metadata, pixels)) is None:
        return WHOLE
    x, y, width, height = place
    columns, rows = metadata["resolution"]
    return (x / columns, (x + width) / columns, y / rows, (y + height) / rows)


def png_to(
    stream: BinaryIO,
    pixels: Pixels,
    metadata: Metadata,
    picture: PictureSettings,
    bits: int,
    layers: Layers = MappingProxyType({}),
) -> None:
    """Write the developed picture; each piece of metadata becomes a text chunk, some also EXIF data."""
    codes = _codes_with_alpha(pixels, metadata, picture, bits, layers)
    texts = {key: _text(value) for key, value in {**metadata, "ev": picture.ev}.items()}
    encoded = picture.is_encoded
    formats.write_png_to(stream, codes, texts, formats.exif_bytes(metadata, encoded=encoded), encoded=encoded)


def alpha_of(metadata: Metadata, layers: Layers) -> Layer | None:
    """Return the alpha of a picture without a background, (height, width); None where it has one."""
    return layers.get("coverage") if metadata.get("transparent") is True else None


def _codes_with_alpha(
    pixels: Pixels, metadata: Metadata, picture: PictureSettings, bits: int, layers: Layers
) -> NDArray[Any]:
    """Return the developed picture; of one without a background the colours before it and alpha, (height, width, 4)."""
    if (alpha := alpha_of(metadata, layers)) is None:
        return _codes_with_marks(pixels, metadata, picture, bits)
    opaque = pixels / np.where(alpha > 0, alpha, 1.0)[..., None]
    codes = _codes_with_marks(np.asarray(opaque, np.float32), metadata, picture, bits)
    return np.concatenate([codes, quantise(np.clip(alpha, 0.0, 1.0), bits)[..., None]], axis=-1)


def _codes_with_marks(pixels: Pixels, metadata: Metadata, picture: PictureSettings, bits: int) -> NDArray[Any]:
    """Return the developed picture, with the zones that are to be drawn."""
    part = film_part(metadata, pixels)
    codes = developed_codes(pixels, picture, part, bits)
    zones = _rectangles(metadata.get(MARKED))
    return _with_rectangles(codes, zones, part) if zones else codes


def _write_png(path: Path, pixels: Pixels, metadata: Metadata, picture: PictureSettings, layers: Layers) -> None:
    with path.open("xb") as stream:
        png_to(stream, pixels, metadata, picture, picture.bits or PNG_BITS, layers)


def _write_jpeg(path: Path, pixels: Pixels, metadata: Metadata, picture: PictureSettings, layers: Layers) -> None:
    """Write the developed picture with its EXIF data, and all metadata as JSON in comments of the file."""
    import PIL.Image

    if max(pixels.shape) > _JPEG_SIDE:
        height, width = pixels.shape[:2]
        most = f"JPEG files have at most {_JPEG_SIDE} a side"
        raise StateError(f"the picture is {width} x {height}, and {most}; use .png")

    encoded = picture.is_encoded
    encoder = PIL.Image.fromarray(_codes_with_marks(pixels, metadata, picture, _JPEG_BITS))
    quality = picture.jpeg_quality
    options = {
        "quality": quality, "subsampling": 0 if quality >= _JPEG_FULL_COLOUR else 2,
        "icc_profile": None if encoded is None else formats.profile(encoded=encoded),
        "extra": _jpeg_comments({**metadata, "ev": picture.ev}),
    }  # fmt: skip
    with path.open("xb") as stream:
        encoder.save(stream, "JPEG", exif=b"Exif\0\0" + formats.exif_bytes(metadata, encoded=encoded), **options)


def _jpeg_comments(metadata: Metadata) -> bytes:
    """Return metadata as JSON text in as many comment segments as it takes (ISO/IEC 10918-1, B.2.4.5)."""
    text = json.dumps(dict(metadata), default=_text).encode()  # ASCII, so that any cut is between characters
    parts = [text[start : start + _JPEG_COMMENT] for start in range(0, len(text), _JPEG_COMMENT)]
    return b"".join(b"\xff\xfe" + (len(part) + 2).to_bytes(2, "big") + part for part in parts)


def _write_tiff(path: Path, pixels: Pixels, metadata: Metadata, picture: PictureSettings, layers: Layers) -> None:
    codes = _codes_with_alpha(pixels, metadata, picture, picture.bits or TIFF_BITS, layers)
    with path.open("xb") as stream:
        formats.write_tiff_to(stream, codes, {**metadata, "ev": picture.ev}, encoded=picture.is_encoded)


def _windows(metadata: Metadata, pixels: Pixels) -> dict[str, tuple[NDArray[np.int32], NDArray[np.int32]]]:
    """Return the place of a cropped picture in the whole film, as EXR has it: first and last pixel of each."""
    if (place := _place(metadata, pixels)) is None:
        return {}
    x, y, width, height = place
    first, last = np.array([x, y], np.int32), np.array([x + width - 1, y + height - 1], np.int32)
    whole = np.array(metadata["resolution"], np.int32) - np.int32(1)
    return {"dataWindow": (first, last), "displayWindow": (np.zeros(2, np.int32), whole)}


def _exr_pixel_aspect(metadata: Metadata) -> dict[str, float]:
    """Return the standard attribute of the width of pixels over their height, where they are not square."""
    size, film = metadata.get("film_size_mm"), metadata.get("resolution")
    if not (_are_counts(film, 2) and all(film) and isinstance(size, (list, tuple)) and len(size) == 2):
        return {}
    if not all(isinstance(side, (int, float)) and 0 < side < math.inf for side in size):
        return {}
    aspect = size[0] * film[1] / (size[1] * film[0])
    return {} if math.isclose(aspect, 1.0, rel_tol=1e-6) else {"pixelAspectRatio": aspect}


def _exr_timecode(metadata: Metadata) -> dict[str, Any]:
    """Return the standard attributes of a frame's time: SMPTE ST 12-1 counts up to 30 frames a second and 24 hours."""
    import OpenEXR

    rate, numbers = metadata.get("frames_per_second"), str(metadata.get("timecode", "")).split(":")
    if not isinstance(rate, int | float) or isinstance(rate, bool) or len(numbers) != 4:
        return {}
    attributes: dict[str, Any] = {"framesPerSecond": Fraction(rate).limit_denominator(1001)}
    if all(number.isdecimal() for number in numbers):
        hours, minutes, seconds, frame = map(int, numbers)
        if hours < 24 and minutes < 60 and seconds < 60 and frame < 30:
            attributes["timeCode"] = OpenEXR.TimeCode(hours, minutes, seconds, frame, *[0] * _TIMECODE_FLAGS)
    return attributes


def _write_exr(path: Path, pixels: Pixels, metadata: Metadata, picture: PictureSettings, layers: Layers) -> None:
    """Write film and layers in float32 with each piece of metadata as an attribute, some also by standard names.

    How the picture is developed is left to the viewer.
    """
    primaries, white = PRIMARIES[picture.primaries]
    if picture.primaries != "rec709":
        matrix = np.linalg.inv(srgb_from_primaries(primaries, white)).T
        pixels = np.asarray(pixels @ matrix, np.float32)
        layers = {
            name: np.asarray(values @ matrix, np.float32) if _is_colour(name) else values
            for name, values in layers.items()
        }
    attributes = {
        (f"rptcam_{key}" if key in _EXR_RESERVED else key): _exr_value(value) for key, value in metadata.items()
    }
    header = {
        **attributes,
        **formats.exr_attributes(metadata),
        **formats.world_to_camera(metadata),
        **_exr_timecode(metadata),
        **header_of(layers, metadata),
        formats.ALL_METADATA: _text(dict(metadata)),
        "chromaticities": (*itertools.chain(*primaries), *white),
        "colorInteropID": _EXR_COLOUR_SPACES[picture.primaries],
        **_exr_pixel_aspect(metadata),
        **_windows(metadata, pixels),
    }
    alpha = alpha_of(metadata, layers)
    over = {} if alpha is None else {"A": alpha}
    write_exr({"RGB": pixels, **over, **dict(_exr_channels(layers))}, path, header)


def _write_npy(path: Path, pixels: Pixels, metadata: Metadata, picture: PictureSettings, layers: Layers) -> None:
    """Write the linear film alone."""
    formats.write_npy(path, pixels)


def _write_npz(path: Path, pixels: Pixels, metadata: Metadata, picture: PictureSettings, layers: Layers) -> None:
    """Write the linear film, its layers and the metadata as JSON text, each an array by its name."""
    with path.open("xb") as stream:
        arrays: dict[str, Any] = {"rgb": pixels, "metadata": np.array(_text(dict(metadata))), **layers}
        np.savez_compressed(stream, **arrays)


_WRITERS: dict[str, Callable[[Path, Pixels, Metadata, PictureSettings, Layers], None]] = {
    ".png": _write_png,
    ".jpg": _write_jpeg,
    ".jpeg": _write_jpeg,
    ".tif": _write_tiff,
    ".tiff": _write_tiff,
    ".exr": _write_exr,
    ".npy": _write_npy,
    ".npz": _write_npz,
}


def check_output(path: str | os.PathLike[str], inputs: Iterable[str | os.PathLike[str]] = ()) -> None:
    """Raise an error, before anything is rendered, when a picture could not be saved at ``path``.

    Parameters
    ----------
    path
        Where the picture is to go.
    inputs
        Files that the picture must not overwrite.
    """
    files.known_suffix(path, _WRITERS, "the suffix sets the format")
    files.check_writable(path, inputs)


def is_developed(path: str | os.PathLike[str]) -> bool:
    """Return whether the format of a file's suffix holds the developed picture, and not the film."""
    return Path(path).suffix.lower() in files.DEVELOPED_SUFFIXES


def holds_layers(path: str | os.PathLike[str]) -> bool:
    """Return whether the format of a file's suffix has a place for layers."""
    return Path(path).suffix.lower() in files.LAYER_SUFFIXES


def write(
    path: str | os.PathLike[str],
    pixels: Pixels,
    metadata: Metadata,
    picture: PictureSettings,
    layers: Layers = MappingProxyType({}),
) -> None:
    """Write a picture in the format of its suffix, whole or not at all.

    Parameters
    ----------
    path
        File that ends in one of `DEVELOPED_SUFFIXES` or `FILM_SUFFIXES`.
    pixels
        (height, width, 3), linear, top row first.
    metadata
        What the file should know of its origin.
    picture
        How the formats in `DEVELOPED_SUFFIXES` are developed.
    layers
        Arrays by name, for the formats in `LAYER_SUFFIXES`.
    """
    writer = _WRITERS[files.known_suffix(path, _WRITERS, "the suffix sets the format")]
    files.check_writable(path)
    with files.replacing(path) as temporary:
        writer(temporary, pixels, metadata, picture, layers)
