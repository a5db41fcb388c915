"""Round stops in place of shaped ones: of the same area, and how far from their place they bring light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.optics.stop_shape import StopMask, StopShape

Array = NDArray[np.float64]

CELLS = 64  # along the side of the square round a stop
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


def _farthest(points: Array, others: Array) -> float:
    """Return how far any of the points is from the nearest of the others; 0 without points."""
    found = 0.0
    for low in range(0, len(points), ROWS):
        apart = points[low : low + ROWS, None] - others
        found = max(found, float(np.sqrt(np.sum(apart**2, axis=-1).min(axis=1)).max()))
    return found
