"""Linear films that were saved: OpenEXR and NumPy files with their metadata, to be developed anew."""

from __future__ import annotations

import json
import os
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.errors import InputError, StateError
from rptcam_cl.imaging.colour import SRGB_PRIMARIES, SRGB_WHITE
from rptcam_cl.imaging.image import Image
from rptcam_cl.imaging.photographic import ALL_METADATA, from_exr_attributes

FILM_SUFFIXES = (".exr", ".npy", ".npz")
_NAME = re.compile(r"[A-Za-z]\w{0,60}", re.ASCII)  # of metadata, which become keys in all formats
_CLOSE = 1e-3  # in chromaticity: programs round those of sRGB differently


def read_film(path: str | os.PathLike[str]) -> Image:
    """Return the film of a file, with the metadata it holds and without layers.

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
        with Path(path).open("rb"):
            pass
        pixels, metadata = _exr(path) if suffix == ".exr" else _numpy(path)
        told = metadata if isinstance(metadata, dict) else {}
        return Image(pixels, {key: value for key, value in told.items() if _NAME.fullmatch(key)})
    except InputError as problem:
        raise InputError(f"{path}: {problem}") from None
    except OSError as problem:
        raise StateError(f"{path}: cannot be read: {problem.strerror or problem}") from None
    except (RuntimeError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, MemoryError) as problem:
        raise InputError(f"{path}: is damaged, or holds no film ({str(problem) or type(problem).__name__})") from None


def _numpy(path: str | os.PathLike[str]) -> tuple[NDArray[Any], dict[str, Any]]:
    held = np.load(path, allow_pickle=False)
    if isinstance(held, np.ndarray):
        return held, {}
    with held:
        return held["rgb"], json.loads(str(held["metadata"])) if "metadata" in held else {}


def _exr(path: str | os.PathLike[str]) -> tuple[NDArray[Any], dict[str, Any]]:
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        header = dict(file.header())  # the file empties its own when it closes
        planes = [file.channels()[name].pixels for name in "RGB"]
    primaries = header.get("chromaticities")
    expected = np.ravel([*SRGB_PRIMARIES, SRGB_WHITE])
    if primaries is not None and not np.allclose(np.ravel(primaries), expected, atol=_CLOSE):
        got = ", ".join(f"{number:.4g}" for number in np.ravel(primaries))
        raise InputError(f"has other primaries than sRGB (got {got}; allowed {', '.join(map(str, expected))})")
    told = header.get(ALL_METADATA)
    return np.stack(planes, axis=-1), json.loads(told) if isinstance(told, str) else from_exr_attributes(header)
