"""Anamorphic pictures made wide again: a film that a lens has squeezed sideways, on as many more columns.

Every new column is the mean of the film over what it covers (box integration), so that light is kept: the mean of the
picture stays, and a film that is even across stays so.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging.image import SENSOR, Image

LEAST, MOST = 1.0, 4.0
OF_PIXELS = ("window", "resolution", "intrinsics", SENSOR)  # metadata of the pixels as they were


def desqueezed(image: Image, factor: float) -> Image:
    """Return an image that is wider by a factor, with metadata ``desqueezed``; its layers stay behind.

    Parameters
    ----------
    image
        Rendered through a lens that squeezes.
    factor
        By which: the ratio of its focal lengths, up and down over across. The width is rounded to whole columns.

    Raises
    ------
    InputError
        For a factor out of range, or a film that was desqueezed before.
    """
    if not LEAST <= factor <= MOST:
        raise InputError(f"desqueeze: is out of range (got {factor:g}; allowed: {LEAST:g} to {MOST:g})")
    if "desqueezed" in image.metadata:
        raise InputError("desqueeze: the film was desqueezed before (allowed: once)")
    width = max(round(image.width * factor), 1)
    metadata = {key: value for key, value in image.metadata.items() if key not in OF_PIXELS}
    pixels = _resampled(image.seen, width)  # a sensor counts the pixels that are squeezed
    return replace(image, pixels=pixels, metadata=metadata | {"desqueezed": width / image.width}, layers={})


def _resampled(pixels: NDArray[np.float32], width: int) -> NDArray[np.float32]:
    """Return rows of as many columns or more, each the mean of the one or two that it covers."""
    columns = pixels.shape[1]
    # Whole numbers, in parts of 1 / width of a column: each new one has `columns` of them, from `starts` on.
    starts = np.arange(width, dtype=np.int64) * columns
    first = starts // width
    share = np.minimum((first + 1) * width - starts, columns)[:, None] / columns
    beside = pixels[:, np.minimum(first + 1, columns - 1)]
    beside = np.where(share < 1, beside, 0)  # what is not covered does not count, be it no number
    return np.asarray(share * pixels[:, first] + (1 - share) * beside, dtype=np.float32)
