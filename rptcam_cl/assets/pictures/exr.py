"""OpenEXR pictures: the first part, its R, G, B and A or Y channels, over the display window."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.pictures.picture import Picture, check_size, checked_floats
from rptcam_cl.core.atomic import utf8_name
from rptcam_cl.core.errors import InputError

_MAGIC = b"\x76\x2f\x31\x01"
Window = tuple[int, int, int, int]


def is_exr(head: bytes) -> bool:
    """Return whether a file that begins like this is OpenEXR."""
    return head.startswith(_MAGIC)


def read(path: Path) -> Picture:
    """Return the picture of a file; what lies outside the data window is black and transparent.

    Raises
    ------
    InputError
        When it is damaged or cut off, deep, has no colours, is too large, or holds numbers that are no light.
    """
    import OpenEXR

    try:
        with utf8_name(path) as name, OpenEXR.File(name, separate_channels=True, header_only=True) as file:
            header = dict(file.header())  # emptied when the file closes
        data, display = _window(header, "dataWindow"), _window(header, "displayWindow")
        for window in (data, display):
            check_size(window[2] - window[0], window[3] - window[1])
        if header["type"] not in (OpenEXR.scanlineimage, OpenEXR.tiledimage):
            raise InputError("is a deep OpenEXR file (allowed: scan lines or tiles)")
        with utf8_name(path) as name, OpenEXR.File(name, separate_channels=True) as file:
            channels = {name: channel.pixels for name, channel in file.channels().items()}
    except (RuntimeError, ValueError, KeyError, TypeError, MemoryError, OSError) as problem:
        raise InputError(f"is damaged ({problem})") from None
    texels, has_alpha = _colours(channels, (data[3] - data[1], data[2] - data[0]))
    colours, negative = checked_floats(texels)
    return Picture(_placed(colours, data, display), has_alpha=has_alpha, encoded=False, negative=negative)


def _window(header: dict[str, Any], name: str) -> Window:
    """Return a window of the header as left, top, right, bottom; right and bottom are behind the last pixel."""
    (left, top), (right, bottom) = header[name]
    return int(left), int(top), int(right) + 1, int(bottom) + 1


def _colours(channels: dict[str, NDArray[Any]], shape: tuple[int, int]) -> tuple[NDArray[np.float32], bool]:
    names = ("R", "G", "B") if "R" in channels else ("Y", "Y", "Y")
    if any(name not in channels for name in names) or "RY" in channels:
        raise InputError(f"has no colours (got channels {', '.join(sorted(channels))}; allowed: R, G and B, or Y)")
    texels = np.ones((*shape, 4), np.float32)
    for index, name in enumerate((*names, "A")):
        if name in channels:
            if channels[name].shape != shape:
                raise InputError(f"has a channel {name} of another resolution (allowed: one resolution)")
            texels[..., index] = channels[name]
    return texels, "A" in channels


def _placed(texels: NDArray[np.float32], data: Window, display: Window) -> NDArray[np.float32]:
    if data == display:
        return texels
    width, height = display[2] - display[0], display[3] - display[1]
    whole = np.zeros((height, width, 4), np.float32)
    left, top = max(data[0], display[0]), max(data[1], display[1])
    right, bottom = min(data[2], display[2]), min(data[3], display[3])
    if left < right and top < bottom:
        whole[top - display[1] : bottom - display[1], left - display[0] : right - display[0]] = texels[
            top - data[1] : bottom - data[1], left - data[0] : right - data[0]
        ]
    return whole
