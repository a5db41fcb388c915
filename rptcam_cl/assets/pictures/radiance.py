"""Radiance HDR pictures: red, green, blue and a shared exponent of 8 bits each, run-length coded.

Format: G. Ward, «Real Pixels», Graphics Gems II, 1991; «Radiance File Formats», radsite.lbl.gov.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.pictures.picture import Picture, check_size, checked_floats
from rptcam_cl.core.errors import InputError

_MAGIC = (b"#?RADIANCE", b"#?RGBE")
_LONGEST_HEADER = 65536
_RESOLUTION = re.compile(rb"([-+])Y +(\d{1,9}) +([-+])X +(\d{1,9})")
_CODED_WIDTHS = range(8, 32768)  # of scanlines whose components are coded one after the other


def is_radiance(head: bytes) -> bool:
    """Return whether a file that begins like this is a Radiance picture."""
    return head.startswith(_MAGIC)


def read(content: bytes) -> Picture:
    """Return the picture of a file's content, in the unit in which its exposures were recorded.

    Raises
    ------
    InputError
        When the header is not understood, or the scanlines are damaged or cut off.
    """
    exposure, position = _header(content)
    end = content.find(b"\n", position, position + 64)
    match = _RESOLUTION.fullmatch(content[position : max(end, position)])
    if match is None:
        raise InputError("has no resolution line such as -Y 512 +X 1024")
    height, width = int(match[2]), int(match[4])
    check_size(width, height)
    rgbe = _scanlines(content, end + 1, width, height)
    scale = np.ldexp(np.float64(1 / exposure), rgbe[..., 3].astype(np.int32) - 136)
    texels = np.ones((height, width, 4), np.float32)
    texels[..., :3] = np.where(rgbe[..., 3:] > 0, rgbe[..., :3] * scale[..., None], 0.0)
    checked_floats(texels)
    upright = texels[:: 1 if match[1] == b"-" else -1, :: 1 if match[3] == b"+" else -1]
    return Picture(np.ascontiguousarray(upright), has_alpha=False, encoded=False)


def _header(content: bytes) -> tuple[float, int]:
    """Return the product of the exposures, and where the resolution line starts."""
    end = content.find(b"\n\n", 0, _LONGEST_HEADER)
    if end < 0:
        raise InputError("has no end of its header")
    exposure = 1.0
    for line in content[:end].splitlines()[1:]:
        name, _, value = line.partition(b"=")
        if name.strip() == b"FORMAT" and value.strip() != b"32-bit_rle_rgbe":
            raise InputError(f"holds {value.strip()[:40].decode('ascii', 'replace')} (allowed: 32-bit_rle_rgbe)")
        if name.strip() == b"EXPOSURE":
            try:
                exposure *= float(value)
            except ValueError:
                exposure = 0.0
            if not 1e-30 < exposure < 1e30:
                raise InputError("has an EXPOSURE that is not a positive number")
    return exposure, end + 2


def _scanlines(content: bytes, position: int, width: int, height: int) -> NDArray[np.uint8]:
    """Return red, green, blue and exponent of every pixel, shape (height, width, 4)."""
    # 128 bytes of one value take two of code: a file cannot hold many more pixels than that.
    if len(content) - position < height * min(width, 4 + 4 * (width // 128)):
        raise InputError(f"is cut off (got {len(content)} bytes for {width} x {height} pixels)")
    rows = np.empty((height, width, 4), np.uint8)
    head = bytes((2, 2, width >> 8, width & 255))
    for row in range(height):
        if width in _CODED_WIDTHS and content[position : position + 4] == head:
            line, position = _coded_line(content, position + 4, width)
            rows[row] = np.frombuffer(line, np.uint8).reshape(4, width).T
        else:
            rows[row], position = _plain_line(content, position, width)
    return rows


def _coded_line(content: bytes, position: int, width: int) -> tuple[bytes, int]:
    """Return the four components of a line one after the other, and where the next line starts."""
    parts: list[bytes] = []
    for _ in range(4):
        left = width
        while left > 0:
            code = content[position] if position < len(content) else 0
            count = code - 128 if code > 128 else code
            part = content[position + 1 : position + 2] * count if code > 128 else content[position + 1 :][:0]
            if code <= 128:
                part = content[position + 1 : position + 1 + count]
            if count == 0 or count > left or len(part) != count:
                raise InputError(f"is damaged or cut off at byte {position}")
            parts.append(part)
            left -= count
            position += 2 if code > 128 else 1 + count
    return b"".join(parts), position


def _plain_line(content: bytes, position: int, width: int) -> tuple[NDArray[np.uint8], int]:
    """Return a line of pixels that stand one by one, or repeat the last one where red, green and blue are 1."""
    pixels = np.frombuffer(content, np.uint8, min(4 * width, len(content) - position) // 4 * 4, position).reshape(-1, 4)
    if len(pixels) == width and not (pixels[:, :3] == 1).all(axis=1).any():
        return pixels, position + 4 * width
    line = bytearray()
    shift = 0
    while len(line) < 4 * width:
        pixel = content[position : position + 4]
        position += 4
        repeats = pixel[:3] == b"\1\1\1"
        count = pixel[3] << shift if repeats and len(pixel) == 4 else 1
        shift = shift + 8 if repeats else 0
        if len(pixel) < 4 or (repeats and not line) or len(line) + 4 * count > 4 * width:
            raise InputError(f"is damaged or cut off at byte {position}")
        line += (line[-4:] if repeats else pixel) * count
    return np.frombuffer(bytes(line), np.uint8).reshape(width, 4), position
