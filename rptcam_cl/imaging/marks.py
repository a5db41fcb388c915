"""Marks of focus zones: their outlines in a developed picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.imaging.white_balance import Part

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
