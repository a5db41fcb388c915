"""Sharpness at an edge in a picture: MTF by the slanted edge.

The method of ISO 12233, without its corrections for chart angles: pixels around the point are sorted by their distance
from the edge, which gives the edge's profile at a quarter of a pixel; its derivative is the line spread, whose Fourier
transform is the MTF in the direction across the edge.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

BINS_PER_PIXEL = 4
REACH_PX = 20  # of the region around the point, on each side
SPAN_PX = 24  # of the profile, across the edge
LEAST_SLANT = 0.02  # of the edge against rows and columns, or its profile has gaps
LEAST_CONTRAST = 0.1  # (bright - dark) / (bright + dark) of both sides

WHOLE_STEP = 0.8  # of the largest step of a row: others the edge leaves at a side

Plane = NDArray[np.float64]


def mtf50_at(luminance: NDArray[np.floating], x: float, y: float) -> float | None:
    """Return the frequency at which the contrast of the edge at a point has fallen to a half [cycles per pixel].

    Parameters
    ----------
    luminance : (height, width) array
        Linear.
    x, y
        The point, in fractions of width and height from the left and the top.

    Returns
    -------
    float or None
        None where there is no single straight edge of some contrast, slanted against rows and columns.
    """
    found = _profile(np.asarray(luminance, np.float64), x, y)
    if found is None:
        return None
    spread = np.gradient(found) * _window(len(found))
    response = np.abs(np.fft.rfft(spread, 8 * len(spread)))
    if response[0] <= 0:
        return None
    frequency = np.fft.rfftfreq(8 * len(spread), 1 / BINS_PER_PIXEL)
    # bins average over their width, and the difference of neighbours over twice that
    mtf = response / response[0] / (np.sinc(frequency / BINS_PER_PIXEL) * np.sinc(2 * frequency / BINS_PER_PIXEL))
    below = int(np.argmax(mtf < 0.5))
    if below == 0:
        return None
    ahead = (mtf[below - 1] - 0.5) / (mtf[below - 1] - mtf[below])
    return float(frequency[below - 1] + ahead * (frequency[below] - frequency[below - 1]))


def _window(length: int) -> Plane:
    """Return a window that is flat in its inner half and falls by cosines to its ends (Tukey), to keep noise out."""
    across = np.abs(np.linspace(-1, 1, length))
    return np.asarray(np.where(across <= 0.5, 1.0, 0.5 * (1 + np.cos(2 * np.pi * (across - 0.5)))))


def _profile(values: Plane, x: float, y: float) -> Plane | None:
    """Return the mean of the pixels by their distance from the edge; None where there is no edge."""
    height, width = values.shape
    row, column = min(int(y * height), height - 1), min(int(x * width), width - 1)
    rows = slice(max(row - REACH_PX, 0), row + REACH_PX + 1)
    columns = slice(max(column - REACH_PX, 0), column + REACH_PX + 1)
    region = values[rows, columns]
    if min(region.shape) < REACH_PX:
        return None
    down, across = (float(np.abs(np.diff(region, axis=axis)).sum()) for axis in (0, 1))
    level = down > across  # the edge is nearer to a row than to a column
    distance = _distance(region.T if level else region)
    if distance is None:
        return None
    distance = distance.T if level else distance
    bins = np.floor((distance + SPAN_PX / 2) * BINS_PER_PIXEL).astype(np.int64)
    count = SPAN_PX * BINS_PER_PIXEL
    inside = (bins >= 0) & (bins < count)
    number = np.bincount(bins[inside], minlength=count)
    if not number.all():
        return None
    profile = np.bincount(bins[inside], region[inside], minlength=count) / number
    first, last = profile[: count // 8].mean(), profile[-(count // 8) :].mean()
    if abs(last - first) < LEAST_CONTRAST * abs(last + first):
        return None
    return np.asarray(profile)


def _distance(region: Plane) -> Plane | None:
    """Return how far each pixel is from an edge that crosses the rows; None where it is not slanted or there is none.

    The edge is the straight line through the centroids of the rows' derivatives.
    """
    steps = np.diff(region, axis=1)
    rises = steps.sum(axis=1)
    if not np.isfinite(rises).all() or not (largest := np.abs(rises).max()) > 0:
        return None
    crossed = np.abs(rises) > WHOLE_STEP * largest
    rows = np.flatnonzero(crossed)
    if len(rows) < REACH_PX / 2:
        return None
    centroids = steps[crossed] @ (np.arange(steps.shape[1]) + 0.5) / rises[crossed]
    slope, start = np.polyfit(rows, centroids, 1)
    if abs(slope) < LEAST_SLANT:
        return None
    y, x = np.mgrid[: region.shape[0], : region.shape[1]].astype(np.float64)
    return np.asarray((x - start - slope * y) / math.hypot(1.0, slope))
