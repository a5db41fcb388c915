"""Films as the image data of frames: developed, made small enough for the client, encoded."""

from __future__ import annotations

import io
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from rptcam_cl.imaging import Image, quantised

Codes = NDArray[np.uint8]
Format = Literal["jpeg", "webp", "png"]
MEDIA = {"jpeg": "image/jpeg", "webp": "image/webp", "png": "image/png"}
_OPTIONS: dict[str, dict[str, Any]] = {
    "jpeg": {"subsampling": "4:2:0"},
    "webp": {"method": 0},
    "png": {"compress_level": 1},
}


def codes_of(image: Image) -> Codes:
    """Return the developed picture in codes of 8 bits, as PNG files have them."""
    return np.asarray(quantised(image.developed(), 8), np.uint8)


def fitted(codes: Codes, width: int, height: int) -> Codes:
    """Return codes that are made smaller, by the means of areas, where they have more pixels than they are shown with.

    Parameters
    ----------
    codes
        (height, width, 3 or 4).
    width, height
        What the client shows them with [pixels].
    """
    rows, columns = codes.shape[:2]
    scale = min(width / columns, height / rows)
    if scale >= 1:
        return codes
    size = (max(1, round(columns * scale)), max(1, round(rows * scale)))
    return np.asarray(Pillow.fromarray(codes).resize(size, Pillow.Resampling.BOX))


def encoded(codes: Codes, form: Format, quality: int) -> bytes:
    """Return codes, (height, width, 3 or 4), as an image file."""
    stream = io.BytesIO()
    options = _OPTIONS[form] | ({} if form == "png" else {"quality": quality})
    Pillow.fromarray(codes).save(stream, form.upper(), **options)
    return stream.getvalue()
