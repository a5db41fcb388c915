"""PNG files of the developed picture, of 8 or 16 bits. Bands of rows are compressed side by side.

Format: Portable Network Graphics, third edition, W3C 2025; ZLIB, RFC 1950.
"""

from __future__ import annotations

import os
import struct
import zlib
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.imaging.icc import profile

Codes = NDArray[np.unsignedinteger[Any]]

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_TRUE_COLOUR = 2
_PERCEPTUAL_INTENT = b"\0"
_SUB, _PAETH = 1, 4  # filters
_BAND_BYTES = 1 << 19  # of rows that are compressed by themselves
_LEVELS = {8: 3, 16: 6}  # of zlib, by bits: of 8, 3 takes 0.35 of the time of 6, for 0.97 to 1.17 of the size
_ZLIB_HEADER = b"\x78\x5e"
_MOD = 65521  # of Adler's checksum


def write_png_to(stream: BinaryIO, codes: Codes, texts: dict[str, str], exif: bytes, *, encoded: bool) -> None:
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
    from concurrent.futures import ThreadPoolExecutor

    height, width = codes.shape[:2]
    bits = 8 * codes.dtype.itemsize
    stream.write(_SIGNATURE + _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, _TRUE_COLOUR, 0, 0, 0)))
    if encoded:
        stream.write(_chunk(b"sRGB", _PERCEPTUAL_INTENT))
    else:
        stream.write(_chunk(b"iCCP", b"ICC profile\0\0" + zlib.compress(profile(encoded=False))))
    for key, value in texts.items():
        stream.write(_text_chunk(key, value))
    stream.write(_chunk(b"eXIf", exif))
    step = max(1, _BAND_BYTES // max(1, codes[0].nbytes))
    starts = range(0, height, step)
    checksum, before = 1, _ZLIB_HEADER
    with ThreadPoolExecutor(min(len(starts), os.cpu_count() or 1)) as threads:
        for data, own, count in threads.map(lambda start: _compressed(codes, start, start + step), starts):
            stream.write(_chunk(b"IDAT", before + data))
            checksum, before = _joined(checksum, own, count), b""
    stream.write(_chunk(b"IDAT", struct.pack(">I", checksum)))
    stream.write(_chunk(b"IEND", b""))


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(data, zlib.crc32(name)))


def _text_chunk(key: str, value: str) -> bytes:
    """Return a text in Latin-1, or in UTF-8 where that has not all of its letters."""
    name = key.encode("latin-1")
    try:
        return _chunk(b"tEXt", name + b"\0" + value.encode("latin-1"))
    except UnicodeEncodeError:
        return _chunk(b"iTXt", name + b"\0\0\0\0\0" + value.encode())


def _compressed(codes: Codes, start: int, end: int) -> tuple[bytes, int, int]:
    """Return rows as blocks of a deflated stream, and checksum and number of the bytes that were deflated."""
    rows = _subtracted(codes[start:end]) if codes.dtype == np.uint8 else _less_paeth(codes, start, end)
    packer = zlib.compressobj(_LEVELS[8 * codes.dtype.itemsize], wbits=-zlib.MAX_WBITS)
    data = packer.compress(rows)
    data += packer.flush() if end >= len(codes) else packer.flush(zlib.Z_FULL_FLUSH)
    return data, zlib.adler32(rows), len(rows)


def _joined(first: int, second: int, count: int) -> int:
    """Return Adler's checksum of two runs of bytes, one after the other; the second has ``count``."""
    low = (first & 0xFFFF) + (second & 0xFFFF) - 1
    high = (first >> 16) + (second >> 16) + count * ((first & 0xFFFF) - 1)
    return high % _MOD << 16 | low % _MOD


def _subtracted(codes: Codes) -> bytes:
    """Return rows of 8 bits, each byte less that of the pixel to its left.

    With the filter that suits each row best 15 pictures took 1.7 times as long, for 0.92 to 1.34 of the size.
    """
    rows = codes.reshape(len(codes), -1)
    filtered = np.empty((len(rows), rows.shape[1] + 1), np.uint8)
    filtered[:, 0] = _SUB
    filtered[:, 1:4] = rows[:, :3]
    np.subtract(rows[:, 3:], rows[:, :-3], out=filtered[:, 4:])
    return filtered.tobytes()


def _less_paeth(codes: Codes, start: int, end: int) -> bytes:
    """Return rows of 16 bits, each byte less the one that Paeth's filter predicts."""
    part = np.ascontiguousarray(codes[max(start - 1, 0) : end], ">u2").view(np.uint8)
    part = part.reshape(-1, 6 * codes.shape[1])
    if start == 0:
        part = np.pad(part, ((1, 0), (0, 0)))
    rows = np.pad(part, ((0, 0), (6, 0)))
    filtered = part[1:] - _predicted(rows[1:, :-6], rows[:-1, 6:], rows[:-1, :-6])
    return np.pad(filtered, ((0, 0), (1, 0)), constant_values=_PAETH).tobytes()


def _predicted(left: NDArray[np.uint8], up: NDArray[np.uint8], corner: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return whichever of three neighbours is nearest to left + up - corner, in this order (A. Paeth, 1991)."""
    a, b, c = (part.astype(np.int16) for part in (left, up, corner))
    to_a, to_b, to_c = np.abs(b - c), np.abs(a - c), np.abs(a + b - 2 * c)
    nearest: NDArray[np.uint8] = np.where((to_a <= to_b) & (to_a <= to_c), left, np.where(to_b <= to_c, up, corner))
    return nearest
