"""Auxiliary layers of a picture: what each is called in files, the check of their arrays; marks of focus zones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging.white_balance import Part

Layer = NDArray[Any]

# EXR channels by layer, as compositors know them: a plain Z is the depth, N the normal.
CHANNELS: dict[str, tuple[str, ...]] = {
    "depth": ("Z",),
    "distance": ("distance.X",),
    "position": ("position.X", "position.Y", "position.Z"),
    "normal": ("N.X", "N.Y", "N.Z"),
    "geometric_normal": ("Ng.X", "Ng.Y", "Ng.Z"),
    "albedo": ("albedo.R", "albedo.G", "albedo.B"),
    "coverage": ("coverage.X",),
    "coc": ("coc.X",),
    "object_id": ("object_id.X",),
    "material_id": ("material_id.X",),
    "uv": ("uv.U", "uv.V"),
    "pupil": ("pupil.X", "pupil.Y"),
    "samples": ("samples.X",),
    "variance": ("variance.Y",),
}


def check_layers(layers: Mapping[str, Layer], height: int, width: int) -> None:
    """Refuse layers that are not of a picture of this size.

    Raises
    ------
    InputError
        A layer is not one of `CHANNELS`, or its shape does not fit the picture.
    """
    for name, values in layers.items():
        if name not in CHANNELS:
            raise InputError(f"layers: unknown layer (got {name}; allowed {', '.join(CHANNELS)})")
        count = len(CHANNELS[name])
        shape = (height, width) if count == 1 else (height, width, count)
        if np.shape(values) != shape:
            raise InputError(f"layers: {name}: wrong shape (got {np.shape(values)}; allowed {shape})")


def exr_channels(layers: Mapping[str, Layer]) -> Iterator[tuple[str, NDArray[np.float32]]]:
    """Yield name and values (height, width) of each EXR channel; identifiers are floats there, as readers expect."""
    for name, values in layers.items():
        planes = values[..., None] if values.ndim == 2 else values
        for index, channel in enumerate(CHANNELS[name]):
            yield channel, np.ascontiguousarray(planes[..., index], np.float32)


Codes = NDArray[np.unsignedinteger[Any]]

MARKED = "marked_zones"  # in the metadata: rectangles [left, right, top, bottom] in fractions of the whole film
LINES_PER_SIDE = 400  # a line is as thick as the shorter side over this, at least a pixel


def with_rectangles(codes: Codes, rectangles: Sequence[Sequence[float]], part: Part) -> Codes:
    """Return a picture (height, width, 3) with the outlines of rectangles in white.

    Parameters
    ----------
    rectangles
        Left, right, top and bottom of each, in fractions of the whole film.
    part
        Which part of the film the picture is.
    """
    drawn = codes.copy()
    height, width = codes.shape[:2]
    thick = max(round(min(height, width) / LINES_PER_SIDE), 1)
    x0, x1, y0, y1 = part
    for left, right, top, bottom in rectangles:
        columns = [round((x - x0) / (x1 - x0) * width) for x in (left, right)]
        rows = [round((y - y0) / (y1 - y0) * height) for y in (top, bottom)]
        box = np.zeros((height, width), np.bool_)
        box[_span(rows, 0, height), _span(columns, 0, width)] = True
        box[_span(rows, thick, height), _span(columns, thick, width)] = False
        drawn[box] = np.iinfo(codes.dtype).max
    return drawn


def _span(ends: Sequence[int], inset: int, size: int) -> slice:
    first, last = ends[0] + inset, ends[1] - inset
    return slice(min(max(first, 0), size), min(max(last, 0), size))
