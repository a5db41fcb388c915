"""PNG files of the developed picture. Pillow writes those of 8 bits; it knows no colours of 16, which are written here.

Format: Portable Network Graphics, third edition, W3C 2025.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.imaging.icc import profile

if TYPE_CHECKING:
    from PIL.PngImagePlugin import PngInfo

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_TRUE_COLOUR = 2
_PERCEPTUAL_INTENT = b"\0"
_PAETH = 4
_ROWS = 64  # per data chunk
_LEVEL = 3  # of zlib: 0.35 of the time of 6, and files of 0.97 (with noise) to 1.17 (small and smooth) of the size


def write_png_to(
    stream: BinaryIO, codes: NDArray[np.unsignedinteger[Any]], texts: dict[str, str], exif: bytes, *, encoded: bool
) -> None:
    """Write codes of 8 or 16 bits, (height, width, 3).

    Parameters
    ----------
    stream
        Where to write.
    codes
        uint8 or uint16.
    texts
        What becomes a text chunk each, by name.
    exif
        EXIF data with a TIFF header.
    encoded
        Whether the codes are encoded as sRGB, or linear.
    """
    from PIL.PngImagePlugin import PngInfo

    information = PngInfo()
    if encoded:
        information.add(b"sRGB", _PERCEPTUAL_INTENT)
    for key, value in texts.items():
        information.add_text(key, value)
    icc = None if encoded else profile(encoded=False)
    if codes.dtype == np.uint8:
        import PIL.Image

        picture = PIL.Image.fromarray(codes)
        picture.save(stream, format="PNG", pnginfo=information, exif=exif, icc_profile=icc, compress_level=_LEVEL)
    else:
        _write_16(stream, codes, information, exif, icc)


def _write_16(
    stream: BinaryIO, codes: NDArray[np.unsignedinteger[Any]], information: PngInfo, exif: bytes, icc: bytes | None
) -> None:
    height, width = codes.shape[:2]
    stream.write(_SIGNATURE + _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 16, _TRUE_COLOUR, 0, 0, 0)))
    if icc is not None:
        stream.write(_chunk(b"iCCP", b"ICC profile\0\0" + zlib.compress(icc)))
    for name, data, *_ in information.chunks:
        stream.write(_chunk(name, data))
    stream.write(_chunk(b"eXIf", exif))
    for data in _compressed(codes):
        stream.write(_chunk(b"IDAT", data))
    stream.write(_chunk(b"IEND", b""))


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(data, zlib.crc32(name)))


def _compressed(codes: NDArray[np.unsignedinteger[Any]]) -> Iterator[bytes]:
    """Yield the pieces of the compressed rows, each byte less the one that Paeth's filter predicts."""
    packer = zlib.compressobj()
    width = codes.shape[1]
    above = np.zeros((1, 6 * (width + 1)), np.uint8)
    for start in range(0, len(codes), _ROWS):
        raw = np.ascontiguousarray(codes[start : start + _ROWS], ">u2").view(np.uint8).reshape(-1, 6 * width)
        rows = np.concatenate([above, np.pad(raw, ((0, 0), (6, 0)))])
        filtered = raw - _predicted(rows[1:, :-6], rows[:-1, 6:], rows[:-1, :-6])
        yield packer.compress(np.pad(filtered, ((0, 0), (1, 0)), constant_values=_PAETH).tobytes())
        above = rows[-1:]
    yield packer.flush()


def _predicted(left: NDArray[np.uint8], up: NDArray[np.uint8], corner: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return whichever of three neighbours is nearest to left + up - corner, in this order (A. Paeth, 1991)."""
    a, b, c = (part.astype(np.int16) for part in (left, up, corner))
    to_a, to_b, to_c = np.abs(b - c), np.abs(a - c), np.abs(a + b - 2 * c)
    nearest: NDArray[np.uint8] = np.where((to_a <= to_b) & (to_a <= to_c), left, np.where(to_b <= to_c, up, corner))
    return nearest
