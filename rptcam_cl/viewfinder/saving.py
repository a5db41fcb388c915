"""A picture as the bytes of a file."""

from __future__ import annotations

import tempfile
from pathlib import Path

from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging import Image

MEDIA = {"png": "image/png", "jpeg": "image/jpeg", "exr": "image/x-exr", "dng": "image/x-adobe-dng"}
_SUFFIXES = {"png": ".png", "jpeg": ".jpg", "exr": ".exr", "dng": ".dng"}


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
    with tempfile.TemporaryDirectory(prefix="rptcam-") as folder:
        path = Path(folder) / f"picture{_SUFFIXES[kind]}"
        if kind == "dng":
            try:
                image.raw().save(path)
            except InputError:
                raise InputError("a DNG holds what a sensor puts out (allowed: scenes with `sensor: {}`)") from None
        else:
            image.save(path)
        return path.read_bytes()
