"""TIFF files of the developed picture, of 8 or 16 bits, with EXIF data and an ICC profile.

Written here and not by a library: Pillow knows no colours of 16 bits, and tifffile writes no EXIF directory.
Format: TIFF revision 6.0, Adobe 1992, with the deflate compression of Adobe's technical note of 2002.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterator, Mapping
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import StateError
from rptcam_cl.imaging import tag_directory as tags
from rptcam_cl.imaging.icc import profile
from rptcam_cl.imaging.photographic import exif_fields

_WIDTH, _LENGTH, _BITS, _COMPRESSION, _PHOTOMETRIC, _DESCRIPTION = 256, 257, 258, 259, 262, 270
_STRIP_OFFSETS, _SAMPLES, _ROWS_PER_STRIP, _STRIP_SIZES, _X_DENSITY, _Y_DENSITY = 273, 277, 278, 279, 282, 283
_SOFTWARE, _PREDICTOR, _EXIF, _ICC = 305, 317, 34665, 34675
_DEFLATE, _RGB, _DIFFERENCES = 8, 2, 2
_LARGEST_FILE = 2**32 - 1  # bytes, as offsets have 32 bits
_STRIP = 1 << 18  # bytes before compression, about
_DENSITY = 72.0  # pixels per inch; the format requires one


def write_tiff_to(
    stream: BinaryIO, codes: NDArray[np.unsignedinteger[Any]], metadata: Mapping[str, Any], *, encoded: bool
) -> None:
    """Write codes of 8 or 16 bits, (height, width, 3); the metadata become EXIF data, and JSON as the description.

    Raises
    ------
    StateError
        The picture is too large for the format.
    """
    height, width = codes.shape[:2]
    rows = max(1, _STRIP // (3 * width * codes.itemsize))
    strips = list(_strips(codes, rows))
    sizes = [len(strip) for strip in strips]
    fields: dict[int, tags.TagField | tags.Directory] = {
        _WIDTH: tags.long([width]),
        _LENGTH: tags.long([height]),
        _BITS: tags.short(*[8 * codes.itemsize] * 3),
        _COMPRESSION: tags.short(_DEFLATE),
        _PHOTOMETRIC: tags.short(_RGB),
        _DESCRIPTION: tags.ascii_text(json.dumps(dict(metadata), default=str)),
        _SAMPLES: tags.short(3),
        _ROWS_PER_STRIP: tags.long([rows]),
        _STRIP_SIZES: tags.long(sizes),
        _X_DENSITY: tags.rational(_DENSITY),
        _Y_DENSITY: tags.rational(_DENSITY),
        _SOFTWARE: tags.ascii_text(str(metadata.get("software", "rptcam_cl"))),
        _PREDICTOR: tags.short(_DIFFERENCES),
        _EXIF: exif_fields(metadata, encoded=encoded),
        _ICC: tags.undefined(profile(encoded=encoded)),
    }
    without_places = tags.directory_bytes(fields | {_STRIP_OFFSETS: tags.long(sizes)}, len(tags.HEADER))
    start = len(tags.HEADER) + len(without_places)
    if start + sum(sizes) > _LARGEST_FILE:
        raise StateError(
            f"the picture takes {(start + sum(sizes)) / 1e9:.3g} GB, and TIFF files at most 4.29; use .exr"
        )
    fields[_STRIP_OFFSETS] = tags.long([start + sum(sizes[:index]) for index in range(len(sizes))])
    stream.write(tags.HEADER + tags.directory_bytes(fields, len(tags.HEADER)))
    stream.writelines(strips)


def _strips(codes: NDArray[np.unsignedinteger[Any]], rows: int) -> Iterator[bytes]:
    """Yield runs of rows, compressed; each pixel is stored as its difference from the one on its left."""
    little = codes.astype(codes.dtype.newbyteorder("<"), copy=False)
    for start in range(0, len(codes), rows):
        strip = little[start : start + rows].copy()
        strip[:, 1:] -= little[start : start + rows, :-1]
        yield zlib.compress(strip.tobytes())
