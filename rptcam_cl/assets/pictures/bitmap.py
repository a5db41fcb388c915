"""PNG, JPEG, TIFF, BMP and WebP, read by Pillow with its other formats shut off."""

from __future__ import annotations

import io
import struct
import warnings
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.pictures.picture import Picture, check_size, checked_floats
from rptcam_cl.core.errors import InputError

FORMATS = ("PNG", "JPEG", "TIFF", "BMP", "WEBP")
ALLOWED = "PNG, JPEG, TIFF, BMP, WebP, OpenEXR or Radiance HDR"
_WIDE = {"I;16": 65535.0, "I;16B": 65535.0, "I;16L": 65535.0, "I": 65535.0, "F": 1.0}  # greys of more than 8 bits


def read(content: bytes) -> Picture:
    """Return the picture of a file's content; the size is checked before pixels are decoded.

    Palettes, grey, CMYK and 1-bit pictures become red, green and blue of 8 bits; grey of 16 bits becomes floats.

    Raises
    ------
    InputError
        When it is none of these formats, is damaged or cut off, or is too large.
    """
    import PIL.Image

    if not content:
        raise InputError(f"is empty (allowed: {ALLOWED})")
    troubles = (OSError, SyntaxError, ValueError, TypeError, KeyError, IndexError, EOFError, struct.error, zlib.error)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # our own limit is below the one that Pillow warns of
            with PIL.Image.open(io.BytesIO(content), formats=FORMATS) as image:
                check_size(*image.size)
                image.load()
                return _converted(image)
    except PIL.UnidentifiedImageError:
        raise InputError(f"is not a picture that can be read (allowed: {ALLOWED})") from None
    except (*troubles, PIL.Image.DecompressionBombError, OverflowError, MemoryError) as problem:
        raise InputError(f"is damaged ({str(problem) or type(problem).__name__}; allowed: {ALLOWED})") from None


def _converted(image: Any) -> Picture:
    if image.mode in _WIDE:
        grey = np.asarray(image, dtype=np.float32) / np.float32(_WIDE[image.mode])
        texels = np.ones((*grey.shape, 4), np.float32)
        texels[..., :3], negative = checked_floats(grey[..., None])
        return Picture(texels, has_alpha=False, encoded=image.mode != "F", negative=negative)
    has_alpha = image.mode in ("RGBA", "LA", "PA", "RGBa", "La") or "transparency" in image.info
    if image.mode == "CMYK":
        image = image.convert("RGB")
    texels_8: NDArray[np.uint8] = np.array(image.convert("RGBA"), dtype=np.uint8)
    return Picture(texels_8, has_alpha=has_alpha, encoded=True)
