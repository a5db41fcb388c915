"""ICC profiles of the pictures: the primaries of sRGB with its encoding, or with none (ISO 15076-1, version 4.3)."""

from __future__ import annotations

import struct
from functools import cache

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import SRGB_WHITE, XYZ_FROM_RGB, adaptation, xyz_of

_D50 = np.array([0.9642, 1.0, 0.8249])  # what the profile connection space calls white
_HEADER = 128


@cache
def profile(*, encoded: bool) -> bytes:
    """Return the profile of pictures that are encoded as sRGB, or linear."""
    to_d50 = adaptation(xyz_of(SRGB_WHITE), _D50)
    red, green, blue = (to_d50 @ XYZ_FROM_RGB).T
    name = "sRGB IEC61966-2-1" if encoded else "Linear light, primaries of sRGB"
    curve = _parametric_curve() if encoded else b"curv" + struct.pack(">II", 0, 0)
    tags = {
        b"desc": _text(name),
        b"cprt": _text("No copyright, use freely"),
        b"wtpt": _xyz(_D50),
        b"chad": b"sf32" + bytes(4) + _fixed(to_d50.ravel()),
        b"rXYZ": _xyz(red),
        b"gXYZ": _xyz(green),
        b"bXYZ": _xyz(blue),
        b"rTRC": curve,
        b"gTRC": curve,
        b"bTRC": curve,
    }
    return _assembled(tags)


def _assembled(tags: dict[bytes, bytes]) -> bytes:
    """Return header, table of tags, and their data; equal data are stored once."""
    table, data, places = b"", b"", dict[bytes, int]()
    start = _HEADER + 4 + 12 * len(tags)
    for name, content in tags.items():
        if content not in places:
            places[content] = start + len(data)
            data += content + bytes(-len(content) % 4)
        table += name + struct.pack(">II", places[content], len(content))
    header = struct.pack(
        ">I4sI4s4s4s6H4s4sIIIQI3i4s",
        start + len(data), b"", 0x04300000, b"mntr", b"RGB ", b"XYZ ",
        2020, 1, 1, 0, 0, 0,  # a date that does not change, so that the same picture is the same file
        b"acsp", b"", 0, 0, 0, 0, 0, *_s15(_D50), b"",
    )  # fmt: skip
    return header.ljust(_HEADER, b"\0") + struct.pack(">I", len(tags)) + table + data


def _s15(numbers: NDArray[np.float64]) -> list[int]:
    """Return numbers in units of 2^-16."""
    return [round(float(number) * 65536) for number in numbers]


def _fixed(numbers: NDArray[np.float64]) -> bytes:
    return struct.pack(f">{len(numbers)}i", *_s15(numbers))


def _xyz(colour: NDArray[np.float64]) -> bytes:
    return b"XYZ " + bytes(4) + _fixed(colour)


def _text(text: str) -> bytes:
    """Return text in one language."""
    encoded = text.encode("utf-16-be")
    return b"mluc" + struct.pack(">III2s2sII", 0, 1, 12, b"en", b"US", len(encoded), 28) + encoded


def _parametric_curve() -> bytes:
    """Return the decoding of IEC 61966-2-1: exponent g, then a, b, c of the curve and of the line, and the knee d."""
    constants = np.array([2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045])
    return b"para" + struct.pack(">IHH", 0, 3, 0) + _fixed(constants)
