"""From a picture file to a `Picture`: its first bytes say what kind it is, never its name."""

from __future__ import annotations

from pathlib import Path

from rptcam_cl.assets.pictures import bitmap, exr, radiance
from rptcam_cl.assets.pictures.picture import Picture
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.references import open_regular, read_whole

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".exr", ".hdr")
LARGEST_FILE = 2 << 30  # bytes; 64 million pixels of four floats are 1 GiB
_HEAD = 16


def read_picture(source: Path | bytes) -> Picture:
    """Return the picture of a file, or of the content of one (which an OpenEXR file may not be).

    Raises
    ------
    InputError
        When it is not a picture that can be used; the message says why, not which file.
    StateError
        When it cannot be read.
    """
    head = source[:_HEAD] if isinstance(source, bytes) else _first_bytes(source)
    if exr.is_exr(head):
        if isinstance(source, bytes):
            raise InputError("is OpenEXR inside another file (allowed: PNG or JPEG there)")
        return exr.read(source)
    content = read_whole(source, LARGEST_FILE)
    return radiance.read(content) if radiance.is_radiance(head) else bitmap.read(content)


def _first_bytes(path: Path) -> bytes:
    with open_regular(path, LARGEST_FILE) as file:
        return file.read(_HEAD)


PNG = b"\x89PNG\r\n\x1a\n"
WITH_ALPHA = (4, 6)  # colour types: grey and alpha; red, green, blue and alpha
WEBP_ALPHA = 0x10
HEAD_BYTES = 1 << 16


def has_alpha(source: Path | bytes) -> bool:
    """Return whether a PNG or a WebP says that it has alpha; pictures of other kinds count as opaque.

    A PNG has it by its colour type, or by a tRNS chunk before its first data (PNG specification, 11.2 and 11.3); a WebP
    by a flag of its extended or its lossless header (RFC 9649, 2.7 and 3.4).
    """
    if isinstance(source, Path):
        with open_regular(source, LARGEST_FILE) as file:
            head = file.read(HEAD_BYTES)
    else:
        head = source[:HEAD_BYTES]
    if head[:4] == b"RIFF" and head[8:12] == b"WEBP" and len(head) > 24:
        return bool({b"VP8X": head[20], b"VP8L": head[24]}.get(head[12:16], 0) & WEBP_ALPHA)
    if not head.startswith(PNG) or len(head) < 26:
        return False
    return head[25] in WITH_ALPHA or b"tRNS" in head.partition(b"IDAT")[0]
