"""Films as image data: those of frames, made small enough for the client, and those of files to keep."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from rptcam_cl.core.atomic import scratch_folder
from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging import Image, quantised

Codes = NDArray[np.uint8]
Format = Literal["jpeg", "webp", "png"]
MEDIA = {"jpeg": "image/jpeg", "webp": "image/webp", "png": "image/png"}
FILE_MEDIA = {"png": "image/png", "jpeg": "image/jpeg", "exr": "image/x-exr", "dng": "image/x-adobe-dng"}
_SUFFIXES = {"png": ".png", "jpeg": ".jpg", "exr": ".exr", "dng": ".dng"}
_OPTIONS: dict[str, dict[str, Any]] = {
    "jpeg": {"subsampling": "4:2:0"},
    "webp": {"method": 0},
    "png": {"compress_level": 1},
}


def codes_of(image: Image) -> Codes:
    """Return the developed picture in codes of 8 bits, as PNG files have them."""
    return np.asarray(quantised(image.developed(), 8), np.uint8)


def fitted(codes: Codes, width: int, height: int) -> Codes:
    """Return codes that are made smaller, by the means of areas, where they have more pixels than they are shown with.

    Parameters
    ----------
    codes
        (height, width, 3 or 4).
    width, height
        What the client shows them with [pixels].
    """
    rows, columns = codes.shape[:2]
    scale = min(width / columns, height / rows)
    if scale >= 1:
        return codes
    size = (max(1, round(columns * scale)), max(1, round(rows * scale)))
    return np.asarray(Pillow.fromarray(codes).resize(size, Pillow.Resampling.BOX))


def encoded(codes: Codes, form: Format, quality: int) -> bytes:
    """Return codes, (height, width, 3 or 4), as an image file."""
    stream = io.BytesIO()
    options = _OPTIONS[form] | ({} if form == "png" else {"quality": quality})
    Pillow.fromarray(codes).save(stream, form.upper(), **options)
    return stream.getvalue()


def file_name(name: str, kind: str) -> str:
    """Return the name of the file that a client is offered: the one that it requests, with the suffix of its kind."""
    suffix = _SUFFIXES[kind]
    return name if name.lower().endswith(suffix) else f"{name}{suffix}"


def file_bytes(image: Image, kind: str) -> bytes:
    """Return what a file of the picture holds.

    Parameters
    ----------
    kind
        One of ``png``, ``jpeg``, ``exr`` and ``dng``.

    Raises
    ------
    InputError
        A raw file is requested, and the scene has no sensor.
    """
    with scratch_folder() as folder:
        path = Path(folder) / f"picture{_SUFFIXES[kind]}"
        if kind == "dng":
            try:
                image.raw().save(path)
            except InputError:
                raise InputError("a DNG holds what a sensor puts out (allowed: scenes with `sensor: {}`)") from None
        else:
            image.save(path)
        return path.read_bytes()
