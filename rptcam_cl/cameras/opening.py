"""The irradiance behind a thin lens: what its opening lets through to the centre of the film."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.optics.stop_shape import StopMask, StopShape

Array = NDArray[np.float64]


def opening_irradiance(shape: StopShape | StopMask | None, radius: float, distance: float) -> float:
    """Return the irradiance on the axis for radiance 1 through a flat opening: integral of cos^4 / distance^2.

    Parameters
    ----------
    shape
        Outline in units of the radius; None for a circle.
    radius, distance
        Of the opening, and from it to the film, in the same unit.
    """
    if shape is None:
        return math.pi * radius**2 / (radius**2 + distance**2)
    if isinstance(shape, StopMask):
        return _through_cells(shape.cells, radius / distance)
    return sum(_through_polygon(triangle * (radius / distance)) for triangle in shape.triangles)


def _through_cells(cells: NDArray[np.bool_], radius: float) -> float:
    """Return the irradiance at unit distance, each cell being small."""
    side = 2.0 * radius / len(cells)
    row, column = np.nonzero(cells)
    middle = (len(cells) - 1) / 2
    square = ((row - middle) ** 2 + (column - middle) ** 2) * side**2
    return float(np.sum(side**2 / (1.0 + square) ** 2))


def _through_polygon(corners: Array) -> float:
    """Return the irradiance at unit distance from a polygon (n, 2), by the angles of its edges (Lambert 1760)."""
    here = np.column_stack([corners, np.ones(len(corners))])
    there = np.roll(here, -1, axis=0)
    normal = np.cross(here, there)
    sine, cosine = np.linalg.norm(normal, axis=1), np.sum(here * there, axis=1)
    angle_over_sine = np.divide(np.arctan2(sine, cosine), sine, out=1.0 / cosine, where=sine > 0)
    return abs(float(np.sum(angle_over_sine * normal[:, 2]))) / 2
