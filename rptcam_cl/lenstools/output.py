"""Pictures as files, by suffix."""

from __future__ import annotations

from pathlib import Path

from rptcam_cl.core.errors import InputError
from rptcam_cl.lenstools.picture import Drawing
from rptcam_cl.lenstools.svg_file import svg_text

SUFFIXES = (".svg", ".png")


def check_suffix(path: Path) -> None:
    """Raise an error when a picture cannot be written under this name."""
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: unknown kind of picture (allowed: a name that ends in {' or '.join(SUFFIXES)})")


def encoded(picture: Drawing, path: Path) -> bytes:
    """Return the bytes of the file that a picture becomes under a name that ends in .svg or .png."""
    check_suffix(path)
    if path.suffix.lower() == ".svg":
        return svg_text(picture).encode()
    from rptcam_cl.lenstools.png import png_bytes

    return png_bytes(picture)
