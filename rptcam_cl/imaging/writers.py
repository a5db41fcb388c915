"""The picture files: PNG for screens, OpenEXR and NumPy arrays for the linear film and its layers."""

import json
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.errors import InputError
from rptcam_cl.imaging.atomic import check_writable, replacing
from rptcam_cl.imaging.layers import Layer, exr_channels
from rptcam_cl.imaging.tone import tone_mapped

Pixels = NDArray[np.float32]
Metadata = Mapping[str, Any]
Layers = Mapping[str, Layer]

# Names that OpenEXR gives a meaning of its own, and drops or refuses when the type is another.
_EXR_RESERVED = {
    "channels", "chunkCount", "compression", "dataWindow", "displayWindow", "lineOrder", "maxSamplesPerPixel", "name",
    "pixelAspectRatio", "screenWindowCenter", "screenWindowWidth", "tiles", "type", "version", "view",
}  # fmt: skip
_SRGB_PRIMARIES = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)  # ITU-R BT.709-6, and its white D65
_PERCEPTUAL_INTENT = b"\0"  # of PNG's sRGB chunk


def _text(value: Any) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, np.generic):
        value = value.item()
    return json.dumps(value, default=str)


def _exr_value(value: Any) -> str | int | float:
    """A value as an EXR attribute: integers of 32 bits and floats exact in single precision as numbers, else text."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, int) and not isinstance(value, bool) and -(2**31) <= value < 2**31:
        return value
    if isinstance(value, float) and float(np.float32(value)) == value:
        return value
    return _text(value)


def write_png_to(stream: BinaryIO, pixels: Pixels, metadata: Metadata, ev: float) -> None:
    """Write the tone-mapped picture; each piece of metadata becomes a text chunk."""
    import PIL.Image
    from PIL.PngImagePlugin import PngInfo

    information = PngInfo()
    information.add(b"sRGB", _PERCEPTUAL_INTENT)
    for key, value in {**metadata, "ev": ev}.items():
        information.add_text(key, _text(value))
    PIL.Image.fromarray(tone_mapped(pixels, ev)).save(stream, format="PNG", pnginfo=information)


def _write_png(path: Path, pixels: Pixels, metadata: Metadata, ev: float, layers: Layers) -> None:
    with path.open("xb") as stream:
        write_png_to(stream, pixels, metadata, ev)


def _windows(metadata: Metadata, pixels: Pixels) -> dict[str, tuple[NDArray[np.int32], NDArray[np.int32]]]:
    """The place of a cropped picture in the whole film, as EXR has it: first and last pixel of each."""
    if "window" not in metadata or "resolution" not in metadata:
        return {}
    x, y, width, height = metadata["window"]
    if pixels.shape[:2] != (height, width):  # pixels that were scaled since
        return {}
    first, last = np.array([x, y], np.int32), np.array([x + width - 1, y + height - 1], np.int32)
    whole = np.array(metadata["resolution"], np.int32) - np.int32(1)
    return {"dataWindow": (first, last), "displayWindow": (np.zeros(2, np.int32), whole)}


def _write_exr(path: Path, pixels: Pixels, metadata: Metadata, ev: float, layers: Layers) -> None:
    """Write film and layers in float32 with each piece of metadata as an attribute (``ev`` is left to the viewer)."""
    import OpenEXR

    attributes = {
        (f"rptcam_{key}" if key in _EXR_RESERVED else key): _exr_value(value) for key, value in metadata.items()
    }
    header = {
        **attributes,
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "chromaticities": _SRGB_PRIMARIES,
        **_windows(metadata, pixels),
    }
    channels = {"RGB": np.ascontiguousarray(pixels), **dict(exr_channels(layers))}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def _write_npy(path: Path, pixels: Pixels, metadata: Metadata, ev: float, layers: Layers) -> None:
    """Write the linear film alone; the format has no place for metadata."""
    with path.open("xb") as stream:
        np.save(stream, pixels, allow_pickle=False)


def _write_npz(path: Path, pixels: Pixels, metadata: Metadata, ev: float, layers: Layers) -> None:
    """Write the linear film, its layers and the metadata as JSON text, each an array by its name."""
    with path.open("xb") as stream:
        arrays: dict[str, Any] = {"rgb": pixels, "metadata": np.array(_text(dict(metadata))), **layers}
        np.savez_compressed(stream, **arrays)


_WRITERS: dict[str, Callable[[Path, Pixels, Metadata, float, Layers], None]] = {
    ".png": _write_png,
    ".exr": _write_exr,
    ".npy": _write_npy,
    ".npz": _write_npz,
}
SUFFIXES = tuple(_WRITERS)
LAYER_SUFFIXES = (".exr", ".npz")
DEVELOPED_SUFFIXES = (".png",)


def _suffix(path: str | os.PathLike[str]) -> str:
    suffix = Path(path).suffix.lower()
    if suffix not in _WRITERS:
        allowed = " ".join(SUFFIXES)
        raise InputError(f"{path}: the suffix decides the format (got {suffix or 'none'}; allowed {allowed})")
    return suffix


def check_output(path: str | os.PathLike[str], inputs: Iterable[str | os.PathLike[str]] = ()) -> None:
    """Raise an error, before anything is rendered, when a picture could not be saved at ``path``.

    Parameters
    ----------
    path
        Where the picture is to go.
    inputs
        Files that the picture must not overwrite.
    """
    _suffix(path)
    check_writable(path, inputs)


def is_developed(path: str | os.PathLike[str]) -> bool:
    """Return whether the format of a file's suffix holds the developed picture, and not the film."""
    return Path(path).suffix.lower() in DEVELOPED_SUFFIXES


def holds_layers(path: str | os.PathLike[str]) -> bool:
    """Return whether the format of a file's suffix has a place for layers."""
    return Path(path).suffix.lower() in LAYER_SUFFIXES


def write(
    path: str | os.PathLike[str], pixels: Pixels, metadata: Metadata, ev: float, layers: Layers = MappingProxyType({})
) -> None:
    """Write a picture in the format of its suffix, whole or not at all.

    Parameters
    ----------
    path
        File that ends in one of `SUFFIXES`.
    pixels
        (height, width, 3), linear, top row first.
    metadata
        What the file should know of its origin.
    ev
        Exposure compensation of the tone-mapped formats [stops].
    layers
        Arrays by name, for the formats in `LAYER_SUFFIXES`.
    """
    writer = _WRITERS[_suffix(path)]
    check_writable(path)
    with replacing(path) as temporary:
        writer(temporary, pixels, metadata, ev, layers)
