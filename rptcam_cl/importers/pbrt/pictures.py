"""Pictures of pbrt scenes: those that ours reads by their name, TGA and PFM files in another format."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.pictures import LARGEST_PIXELS, SUFFIXES, read_picture
from rptcam_cl.core.atomic import utf8_name
from rptcam_cl.core.errors import InputError
from rptcam_cl.importers.pbrt.context import Context
from rptcam_cl.importers.pbrt.source import Place, read_limited

Pixels = NDArray[np.float32]

# Kinds of pictures that pbrt reads and ours does not.
OTHERS = (".tga", ".pfm")
_PFM = re.compile(rb"(P[Ff])\s+(\d{1,9})\s+(\d{1,9})\s+([-+.\deE]{1,30})\s")
_LARGEST_FILE = 16 * LARGEST_PIXELS


def is_readable(path: Path) -> bool:
    """Return whether a picture can be shown, by its suffix."""
    return path.suffix.lower() in (*SUFFIXES, *OTHERS)


def picture_name(context: Context, path: Path, place: Place) -> str:
    """Return the name under which the scene of ours reads a picture; one of another kind is written anew."""
    suffix = path.suffix.lower()
    if suffix not in OTHERS:
        return context.files.reference(path, place, read_picture)
    if str(path) not in context.pictures:
        if suffix == ".tga":
            name = context.files.add("files", f"{path.stem}.png", partial(_write_png, _tga(path, place)))
        else:
            name = context.files.add("files", f"{path.stem}.exr", partial(write_exr, _pfm(path, place)))
        context.report.noted(place, f"{path.name}: written anew, to {name}")
        context.pictures[str(path)] = name
    return context.pictures[str(path)]


def linear_pixels(path: Path, place: Place) -> Pixels:
    """Return the linear colours of a picture, (height, width, 3), the top row first."""
    texels = _texels(path, place)
    return np.asarray(texels, np.float32) if texels.dtype != np.uint8 else _decoded(texels)


def mean_colour(path: Path, place: Place, *, linear: bool) -> NDArray[np.float64]:
    """Return the mean of a picture's linear colours; bytes are sRGB unless they are linear."""
    texels = _texels(path, place)
    if texels.dtype != np.uint8:
        return np.asarray(texels.mean(axis=(0, 1), dtype=np.float64))
    return np.asarray((texels / 255 if linear else _decoded(texels)).mean(axis=(0, 1), dtype=np.float64))


def _texels(path: Path, place: Place) -> NDArray[Any]:
    """Return the colours of a picture as it stores them, (height, width, 3)."""
    if path.suffix.lower() == ".pfm":
        return _pfm(path, place)
    if path.suffix.lower() == ".tga":
        return _tga(path, place)[..., :3]
    try:
        return read_picture(path).texels[..., :3]
    except InputError as problem:
        raise place.error(f"{path.name}: {problem}") from None


def _decoded(texels: NDArray[Any]) -> Pixels:
    """Return the linear values of sRGB bytes (IEC 61966-2-1)."""
    encoded = np.arange(256) / 255
    curve = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return np.asarray(curve.astype(np.float32)[texels])


def _tga(path: Path, place: Place) -> NDArray[np.uint8]:
    import PIL.Image

    try:
        with PIL.Image.open(path, formats=("TGA",)) as image:
            if image.width * image.height > LARGEST_PIXELS:
                raise place.error(f"{path.name}: is too large (allowed: at most {LARGEST_PIXELS} pixels)")
            return np.asarray(image.convert("RGBA" if "A" in image.getbands() else "RGB"))
    except (OSError, ValueError, SyntaxError, PIL.Image.DecompressionBombError) as problem:
        raise place.error(f"{path.name}: is not a TGA picture ({str(problem).splitlines()[0]})") from None


def _pfm(path: Path, place: Place) -> Pixels:
    """Return the colours of a portable float map, whose rows run upwards; a negative scale means little-endian."""
    raw = read_limited(path, path.name, _LARGEST_FILE)
    header = _PFM.match(raw)
    if header is None:
        raise place.error(f"{path.name}: is not a PFM picture")
    channels = 3 if header[1] == b"PF" else 1
    width, height = int(header[2]), int(header[3])
    order = "<" if header[4].startswith(b"-") else ">"
    count = width * height * channels
    if not count or len(raw) - header.end() < 4 * count:
        raise place.error(f"{path.name}: holds fewer than its {width} x {height} pixels")
    values = np.frombuffer(raw, f"{order}f4", count, header.end()).astype(np.float32)
    if not np.isfinite(values).all():
        raise place.error(f"{path.name}: holds numbers that are not finite")
    return np.maximum(np.broadcast_to(values.reshape(height, width, channels)[::-1], (height, width, 3)), 0)


def _write_png(pixels: NDArray[np.uint8], path: Path) -> None:
    import PIL.Image

    PIL.Image.fromarray(pixels).save(path, format="PNG")


def write_exr(pixels: Pixels, path: Path) -> None:
    """Write linear colours as OpenEXR in float32."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": np.ascontiguousarray(pixels)}) as file, utf8_name(path) as name:
        file.write(name)
