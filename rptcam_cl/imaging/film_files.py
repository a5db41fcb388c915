"""Linear films that were saved: OpenEXR and NumPy files with their metadata, to be developed anew."""

from __future__ import annotations

import json
import math
import os
import re
import zipfile
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import SRGB_PRIMARIES, SRGB_WHITE
from rptcam_cl.core.atomic import utf8_name
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.host_memory import free_host_bytes
from rptcam_cl.imaging.image import Image
from rptcam_cl.imaging.photographic import ALL_METADATA, from_exr_attributes

FILM_SUFFIXES = (".exr", ".npy", ".npz")
_NAME = re.compile(r"[A-Za-z]\w{0,60}", re.ASCII)  # of metadata, which become keys in all formats
LARGE = 1 << 26  # pixels of a film, from which on small files may be meant to keep a machine busy
NEEDED = 3  # times its own size, to read and to develop a film; measured at 48 million pixels
_CLOSE = 1e-3  # in chromaticity: programs round those of sRGB differently


def read_film(path: str | os.PathLike[str], *, most_pixels: int | None = None) -> Image:
    """Return the film of a file, with the metadata it holds and without layers.

    Parameters
    ----------
    most_pixels
        Of a film that is read; by its head alone, larger ones are refused.

    Raises
    ------
    InputError
        The file is none of these formats, is damaged, or is not of linear colours with the primaries of sRGB.
    StateError
        The file cannot be read.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in FILM_SUFFIXES:
        raise InputError(f"{path}: is no linear film (got {suffix or 'no suffix'}; allowed {' '.join(FILM_SUFFIXES)})")
    try:
        size, pixels_there = _size(path, suffix)
        if most_pixels is not None and pixels_there > most_pixels:
            found, most = pixels_there / 1e6, most_pixels / 1e6
            raise InputError(f"has {found:.4g} million pixels (allowed: {most:.4g}, or any with --large)")
        _check_memory(size)
        pixels, metadata = _exr(path) if suffix == ".exr" else _numpy(path)
        known = metadata.items() if isinstance(metadata, dict) else ()
        return Image(np.asarray(pixels, np.float32), {key: value for key, value in known if _NAME.fullmatch(key)})
    except InputError as problem:
        raise InputError(f"{path}: {problem}") from None
    except OSError as problem:
        raise StateError(f"{path}: cannot be read: {problem.strerror or problem}") from None
    except Exception as problem:  # numpy, zipfile, tokenize and OpenEXR raise nearly anything for a damaged file
        raise InputError(f"{path}: is damaged, or holds no film ({str(problem) or type(problem).__name__})") from None


def _size(path: str | os.PathLike[str], suffix: str) -> tuple[int, int]:
    """Return how many bytes the film of a file takes in memory, and its pixels, by its head, without unpacking it."""
    if suffix == ".exr":
        import OpenEXR

        with Path(path).open("rb"):
            pass  # the library's own words for a file that is not there name no reason
        with utf8_name(path) as name, OpenEXR.File(name, separate_channels=True, header_only=True) as file:
            header = dict(file.header())
        (left, top), (right, bottom) = header["dataWindow"]
        count = max(0, int(right) - int(left) + 1) * max(0, int(bottom) - int(top) + 1)
        return count * 4 * len(header["channels"]), count  # all channels of the file are read, at most 4 bytes each
    with Path(path).open("rb") as file:
        if not zipfile.is_zipfile(file):
            file.seek(0)
            return _bytes_of_array(file)
        with zipfile.ZipFile(file) as archive:
            wanted = [name for name in ("rgb.npy", "metadata.npy") if name in archive.namelist()]
            sizes = [(0, 0)]
            for name in wanted:
                with archive.open(name) as member:
                    sizes.append(_bytes_of_array(member))
            return sum(size for size, _ in sizes), max(count for _, count in sizes)


def _bytes_of_array(stream: IO[bytes]) -> tuple[int, int]:
    """Return the bytes of an array, and its pixels if it is a film, by the head of its file (``numpy.lib.format``)."""
    major, _ = np.lib.format.read_magic(stream)
    read = np.lib.format.read_array_header_1_0 if major == 1 else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(stream)
    return math.prod(shape) * dtype.itemsize, math.prod(shape[:2])


def _check_memory(size: int) -> None:
    """Refuse a film whose development takes more memory than the machine has free."""
    free = free_host_bytes()
    if free is not None and size * NEEDED > free:
        raise InputError(
            f"takes {size * NEEDED / 1e9:.3g} GB to develop, and {free / 1e9:.3g} GB of memory are free"
            " (allowed: a smaller film, as of a part with crop)"
        )


def _numpy(path: str | os.PathLike[str]) -> tuple[NDArray[Any], dict[str, Any]]:
    held = np.load(path, allow_pickle=False)
    if isinstance(held, np.ndarray):
        return held, {}
    with held:
        return held["rgb"], json.loads(str(held["metadata"])) if "metadata" in held else {}


def _exr(path: str | os.PathLike[str]) -> tuple[NDArray[Any], dict[str, Any]]:
    import OpenEXR

    with utf8_name(path) as name, OpenEXR.File(name, separate_channels=True) as file:
        header = dict(file.header())  # the file empties its own when it closes
        planes = [file.channels()[name].pixels for name in "RGB"]
    primaries = header.get("chromaticities")
    expected = np.ravel([*SRGB_PRIMARIES, SRGB_WHITE])
    if primaries is not None and not np.allclose(np.ravel(primaries), expected, atol=_CLOSE):
        got = ", ".join(f"{number:.4g}" for number in np.ravel(primaries))
        raise InputError(f"has other primaries than sRGB (got {got}; allowed {', '.join(map(str, expected))})")
    metadata = header.get(ALL_METADATA)
    return np.stack(planes, axis=-1), json.loads(metadata) if isinstance(metadata, str) else from_exr_attributes(header)
