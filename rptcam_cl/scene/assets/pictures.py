"""Picture files, recognised by their first bytes: 8 bits by Pillow, OpenEXR, Radiance HDR."""

from __future__ import annotations

import io
import re
import struct
import warnings
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.colour import SRGB_PRIMARIES, SRGB_WHITE, srgb_from_primaries
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import name_errors, open_regular, read_whole, utf8_name

# A picture that was read: texels in rows from the top, as stored or as linear floats.

LARGEST_PIXELS = 1 << 26  # 64 million: an equirectangular picture of 8192 x 8192, or 256 MB in 8 bits
_SLIGHTLY_NEGATIVE = -1e-3  # what resampling leaves beside bright edges; taken as zero
# What Pillow raises on damaged pictures.
_DAMAGED = (OSError, SyntaxError, ValueError, TypeError, KeyError, IndexError, EOFError, OverflowError, MemoryError,
            struct.error, zlib.error)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Picture:
    """Texels of a picture.

    Attributes
    ----------
    texels : (height, width, 4) array
        Red, green, blue, alpha, top row first: uint8 as stored (0 to 255), or float32 from 0 up.
    has_alpha : bool
        Whether the file has an alpha channel; otherwise alpha is opaque.
    encoded : bool
        Whether a file of this kind normally holds sRGB-encoded colours and not linear ones.
    negative : (int, float)
        How many texels of the file have a clearly negative channel, and the least value; they are black here.
    """

    texels: NDArray[np.uint8] | NDArray[np.float32]
    has_alpha: bool
    encoded: bool
    negative: tuple[int, float] = (0, 0.0)

    @property
    def height(self) -> int:
        """Number of rows."""
        return int(self.texels.shape[0])

    @property
    def width(self) -> int:
        """Number of columns."""
        return int(self.texels.shape[1])


def _check_size(width: int, height: int) -> None:
    """Refuse a size before anything of that size is allocated.

    Raises
    ------
    InputError
        When a side is empty, or there are more than `LARGEST_PIXELS` pixels.
    """
    if width < 1 or height < 1:
        raise InputError(f"has no pixels (got {width} x {height})")
    if width * height > LARGEST_PIXELS:
        raise InputError(f"is too large (got {width} x {height} pixels; allowed: at most {LARGEST_PIXELS})")


def _checked_floats(texels: NDArray[np.float32]) -> tuple[NDArray[np.float32], tuple[int, float]]:
    """Texels (height, width, channels), negative ones made zero; how many were clearly negative, and the least value.

    Raises
    ------
    InputError
        When some are not finite: how many, and where the first is.
    """
    wrong = ~np.isfinite(texels)
    if wrong.any():
        row, column, _ = np.argwhere(wrong)[0]
        raise InputError(
            f"{int(wrong.any(axis=2).sum())} pixels are not finite, the first in column {column} of row {row}"
            f" (got {', '.join(f'{value:g}' for value in texels[row, column])}; allowed: finite numbers)"
        )
    least = float(texels.min(initial=0.0))
    below = int((texels < _SLIGHTLY_NEGATIVE).any(axis=2).sum()) if least < _SLIGHTLY_NEGATIVE else 0
    return np.maximum(texels, np.float32(0)), (below, least) if below else (0, 0.0)


# PNG, JPEG, TIFF, BMP, WebP and TGA, read by Pillow with its other formats shut off.

_FORMATS = ("PNG", "JPEG", "TIFF", "BMP", "WEBP", "TGA")
_ALLOWED = "PNG, JPEG, TIFF, BMP, WebP, TGA, OpenEXR or Radiance HDR"
_WIDE = {"I;16": 65535.0, "I;16B": 65535.0, "I;16L": 65535.0, "I": 65535.0, "F": 1.0}  # greys of more than 8 bits


def _read_bitmap(content: bytes) -> Picture:
    """Return the picture of a file's content; the size is checked before pixels are decoded.

    Palettes, grey, CMYK and 1-bit pictures become red, green and blue of 8 bits; grey of 16 bits becomes floats.

    Raises
    ------
    InputError
        When it is none of these formats, is damaged or cut off, or is too large.
    """
    import PIL.Image

    if not content:
        raise InputError(f"is empty (allowed: {_ALLOWED})")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # our own limit is below the one that Pillow warns of
            with PIL.Image.open(io.BytesIO(content), formats=_FORMATS) as image:
                _check_size(*image.size)
                image.load()
                return _convert(image)
    except PIL.UnidentifiedImageError:
        raise InputError(f"is not a picture that can be read (allowed: {_ALLOWED})") from None
    except (*_DAMAGED, PIL.Image.DecompressionBombError) as problem:
        raise InputError(f"is damaged ({str(problem) or type(problem).__name__}; allowed: {_ALLOWED})") from None


def _convert(image: Any) -> Picture:
    if image.mode in _WIDE:
        grey = np.asarray(image, dtype=np.float32) / np.float32(_WIDE[image.mode])
        texels = np.ones((*grey.shape, 4), np.float32)
        texels[..., :3], negative = _checked_floats(grey[..., None])
        return Picture(texels, has_alpha=False, encoded=image.mode != "F", negative=negative)
    has_alpha = image.mode in ("RGBA", "LA", "PA", "RGBa", "La") or "transparency" in image.info
    if image.mode == "CMYK":
        image = image.convert("RGB")
    texels_8: NDArray[np.uint8] = np.array(image.convert("RGBA"), dtype=np.uint8)
    return Picture(texels_8, has_alpha=has_alpha, encoded=True)


_LARGEST = {"uint8": 255, "uint16": 65535}  # code of an array of codes; all else is linear
_ARRAYS = "an array (height, width) or with 1, 3 or 4 channels, of uint8, uint16 or floats"


def read_array(content: bytes) -> Picture:
    """Return the picture of a NumPy file's content, top row first: codes as sRGB has them, floats linear.

    Raises
    ------
    InputError
        When it is damaged, or an array of another shape or kind.
    """
    stream = io.BytesIO(content)
    try:
        read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
        shape, _, dtype = read[np.lib.format.read_magic(stream)](stream)
        is_known = dtype.name in _LARGEST or (dtype.kind == "f" and dtype.itemsize <= 8)
        if len(shape) not in (2, 3) or (*shape, 1)[2] not in (1, 3, 4) or not is_known:
            raise InputError(f"is no picture (got {shape} of {dtype}; allowed: {_ARRAYS})")
        _check_size(shape[1], shape[0])
        stored = np.load(io.BytesIO(content), allow_pickle=False).reshape(*shape[:2], -1)
    except (ValueError, KeyError, EOFError, SyntaxError) as problem:
        raise InputError(f"is damaged ({problem}; allowed: {_ARRAYS})") from None
    channels, largest = stored.shape[2], _LARGEST.get(dtype.name)
    texels = np.full((*shape[:2], 4), 255 if dtype == np.uint8 else 1, np.uint8 if dtype == np.uint8 else np.float32)
    texels[..., : max(channels, 3)] = stored if dtype == np.uint8 or largest is None else stored / np.float32(largest)
    negative = (0, 0.0)
    if texels.dtype != np.uint8:
        texels, negative = _checked_floats(texels)
    return Picture(texels, has_alpha=channels == 4, encoded=largest is not None, negative=negative)


# OpenEXR pictures: the first part, its R, G, B and A or Y channels, over the display window.

_EXR_MAGIC = b"\x76\x2f\x31\x01"
_SAME_PRIMARIES = 1e-3  # in chromaticity: programs round those of sRGB differently
Window = tuple[int, int, int, int]


def _read_exr(path: Path) -> Picture:
    """Return the picture of a file; what lies outside the data window is black and transparent.

    Colours of other `chromaticities` than those of sRGB become linear sRGB, adapted to its white.

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
            _check_size(window[2] - window[0], window[3] - window[1])
        if header["type"] not in (OpenEXR.scanlineimage, OpenEXR.tiledimage):
            raise InputError("is a deep OpenEXR file (allowed: scan lines or tiles)")
        with utf8_name(path) as name, OpenEXR.File(name, separate_channels=True) as file:
            channels = {name: channel.pixels for name, channel in file.channels().items()}
    except (RuntimeError, ValueError, KeyError, TypeError, MemoryError, OSError) as problem:
        raise InputError(f"is damaged ({problem})") from None
    texels, has_alpha = _colours(channels, (data[3] - data[1], data[2] - data[0]))
    if "chromaticities" in header and "R" in channels:
        red, green, blue, white = ((float(x), float(y)) for x, y in np.reshape(header["chromaticities"], (4, 2)))
        known = np.ravel([*SRGB_PRIMARIES, SRGB_WHITE])
        if not np.allclose(header["chromaticities"], known, atol=_SAME_PRIMARIES):
            with np.errstate(all="ignore"):  # what is not finite is refused in the next line
                matrix = srgb_from_primaries((red, green, blue), white)
                texels[..., :3] = texels[..., :3] @ matrix.T.astype(np.float32)
    colours, negative = _checked_floats(texels)
    return Picture(_place(colours, data, display), has_alpha=has_alpha, encoded=False, negative=negative)


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


def _place(texels: NDArray[np.float32], data: Window, display: Window) -> NDArray[np.float32]:
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


def write_exr(channels: Mapping[str, NDArray[Any]], path: Path, header: Mapping[str, Any] | None = None) -> None:
    """Write channels, of which ``RGB`` is three, as OpenEXR in scan lines of float32."""
    import OpenEXR

    attributes = {**(header or {}), "compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    planes = {name: np.ascontiguousarray(values, np.float32) for name, values in channels.items()}
    with OpenEXR.File(attributes, planes) as file, utf8_name(path) as name:
        file.write(name)


#
# Radiance HDR pictures: red, green, blue and a shared exponent of 8 bits each, run-length coded.
#
# Format: G. Ward, «Real Pixels», Graphics Gems II, 1991; «Radiance File Formats», radsite.lbl.gov.

_RADIANCE_MAGIC = (b"#?RADIANCE", b"#?RGBE")
_LONGEST_HEADER = 65536
_RESOLUTION = re.compile(rb"([-+])Y +(\d{1,9}) +([-+])X +(\d{1,9})")
_CODED_WIDTHS = range(8, 32768)  # of scanlines whose components are coded one after the other


def _read_radiance(content: bytes) -> Picture:
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
    _check_size(width, height)
    rgbe = _scanlines(content, end + 1, width, height)
    scale = np.ldexp(np.float64(1 / exposure), rgbe[..., 3].astype(np.int32) - 136)
    texels = np.ones((height, width, 4), np.float32)
    with np.errstate(over="ignore"):  # refused in the next line
        texels[..., :3] = np.where(rgbe[..., 3:] > 0, rgbe[..., :3] * scale[..., None], 0.0)
    _checked_floats(texels)
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
            line, position = _read_coded_line(content, position + 4, width)
            rows[row] = np.frombuffer(line, np.uint8).reshape(4, width).T
        else:
            rows[row], position = _plain_line(content, position, width)
    return rows


def _read_coded_line(content: bytes, position: int, width: int) -> tuple[bytes, int]:
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


# From a picture file to a `Picture`: its first bytes say what kind it is, never its name.

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
    if head.startswith(_EXR_MAGIC):
        if isinstance(source, bytes):
            raise InputError("is OpenEXR inside another file (allowed: PNG or JPEG there)")
        return _read_exr(source)
    content = read_whole(source, LARGEST_FILE)
    if head.startswith(np.lib.format.MAGIC_PREFIX):
        return read_array(content)
    return _read_radiance(content) if head.startswith(_RADIANCE_MAGIC) else _read_bitmap(content)


def _first_bytes(path: Path) -> bytes:
    with open_regular(path, LARGEST_FILE) as file:
        return file.read(_HEAD)


PNG = b"\x89PNG\r\n\x1a\n"
_WITH_ALPHA = (4, 6)  # colour types: grey and alpha; red, green, blue and alpha
_WEBP_ALPHA = 0x10
_HEAD_BYTES = 1 << 16


def has_alpha(source: Path | bytes) -> bool:
    """Return whether a PNG or a WebP says that it has alpha; pictures of other kinds count as opaque.

    A PNG has it by its colour type, or by a tRNS chunk before its first data (PNG specification, 11.2 and 11.3); a WebP
    by a flag of its extended or its lossless header (RFC 9649, 2.7 and 3.4).
    """
    if isinstance(source, Path):
        with open_regular(source, LARGEST_FILE) as file:
            head = file.read(_HEAD_BYTES)
    else:
        head = source[:_HEAD_BYTES]
    if head[:4] == b"RIFF" and head[8:12] == b"WEBP" and len(head) > 24:
        return bool({b"VP8X": head[20], b"VP8L": head[24]}.get(head[12:16], 0) & _WEBP_ALPHA)
    if not head.startswith(PNG) or len(head) < 26:
        return False
    return head[25] in _WITH_ALPHA or b"tRNS" in head.partition(b"IDAT")[0]


LARGEST_MASK_FILE = 16_000_000  # bytes


def bright_pixels(source: Path | bytes, where: str) -> NDArray[np.bool_]:
    """Return which pixels (height, width) of a mask picture are brighter than half, of an array which are above zero.

    Parameters
    ----------
    source
        The file, or its content.
    where
        What errors call it.

    Raises
    ------
    InputError
        When it is no picture, or none are.
    """
    from PIL import Image, UnidentifiedImageError

    with name_errors(where):
        content = read_whole(source, LARGEST_MASK_FILE)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            if content.startswith(b"\x93NUMPY"):
                cells = np.load(io.BytesIO(content), allow_pickle=False) > 0
                if cells.ndim != 2:
                    raise InputError(f"{where}: has {cells.ndim} dimensions (allowed: an array (height, width))")
            else:
                with Image.open(io.BytesIO(content), formats=["PNG", "JPEG", "TIFF"]) as picture:
                    cells = np.asarray(picture.convert("L")) > 127
    except (*_DAMAGED, UnidentifiedImageError, Image.DecompressionBombError, Warning) as problem:
        raise InputError(f"{where}: is not a readable PNG, JPEG or TIFF picture ({problem})") from None
    if not cells.any():
        raise InputError(f"{where}: is dark everywhere (allowed: some pixels brighter than half)")
    return np.asarray(cells)
