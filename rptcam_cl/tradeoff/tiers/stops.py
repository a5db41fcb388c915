"""Round stops in place of shaped ones: of the same area, and how far from their place they bring light."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics import StopMask, StopShape

Array = NDArray[np.float64]

CELLS = 64  # along the side of the square round a stop
FINE_CELLS = 288  # along the side of a larger square
REACH = 1.125  # half that side
BLURRED = 0.1
ROWS = 256  # points whose distances are found at a time


@dataclass(frozen=True)
class RoundStop:
    """A round stop that lets as much light through as one of another shape, both in units of the latter's radius.

    Attributes
    ----------
    radius : float
    apart : float
        How far a point of either lies from the other, at most (the distance of Hausdorff).
    """

    radius: float = 1.0
    apart: float = 0.0


def round_stop(shape: StopShape | StopMask | None) -> RoundStop:
    """Return the round stop in place of a shape; None is round already."""
    if shape is None:
        return RoundStop()
    side = (np.arange(CELLS) + 0.5) * 2 / CELLS - 1
    x, y = (values.ravel() for values in np.meshgrid(side, side))
    distance = np.hypot(x, y)
    inside = np.asarray(shape.holds(x, y)) & (distance <= 1)
    if not inside.any():  # slits between the cells
        return RoundStop(0.0, 1.0)
    radius = float(np.sqrt(inside.sum() / np.pi) * 2 / CELLS)
    points = np.stack([x, y], axis=1)
    beyond = float(np.max(distance[inside] - radius, initial=0.0))
    left_out = points[(distance <= radius) & ~inside]
    return RoundStop(radius, max(beyond, _farthest(left_out, points[inside])) + 1 / CELLS)


def coverage(shape: StopShape | StopMask, points: Array) -> Array:
    """Return which share of the surroundings of points (..., 2) lies in a shape: of a square of side `BLURRED`.

    Integrals over the shape by points that far apart then are as smooth as those over the circle.
    """
    side = (np.arange(FINE_CELLS) + 0.5) * 2 * REACH / FINE_CELLS - REACH
    x, y = np.meshgrid(side, side)
    share: Array = np.asarray(shape.holds(x, y) & (np.hypot(x, y) <= 1), dtype=np.float64)
    width = round(BLURRED * FINE_CELLS / (2 * REACH))
    for axis in (0, 1):
        sums = np.insert(np.cumsum(share, axis=axis), 0, 0.0, axis=axis)
        ends, starts = np.arange(width, FINE_CELLS + 1), np.arange(FINE_CELLS + 1 - width)
        share = (np.take(sums, ends, axis) - np.take(sums, starts, axis)) / width
    first = -REACH + BLURRED / 2  # middle of the first square
    places = np.clip(np.rint((points - first) * FINE_CELLS / (2 * REACH)), 0, len(share) - 1).astype(np.intp)
    return np.asarray(share[places[..., 1], places[..., 0]])


def _farthest(points: Array, others: Array) -> float:
    """Return how far any of the points is from the nearest of the others; 0 without points."""
    found = 0.0
    for low in range(0, len(points), ROWS):
        apart = points[low : low + ROWS, None] - others
        found = max(found, float(np.sqrt(np.sum(apart**2, axis=-1).min(axis=1)).max()))
    return found
