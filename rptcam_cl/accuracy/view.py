"""The part of the world that a camera may see, and what lies in it. Millimetres in the camera's frame, z ahead."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MOST_CUT = 200  # triangles that are cut to the view; of more, which then are small, all corners count


@dataclass(frozen=True)
class View:
    """What a camera may see: a pyramid about its axis, cut off where it starts.

    Attributes
    ----------
    start_mm : float
        Distance ahead of the camera's eye where it starts.
    half_mm : (2,) array
        Half its width and height there.
    slopes : (2,) array
        What they grow by per distance.
    """

    start_mm: float
    half_mm: Array
    slopes: Array

    def sides(self) -> tuple[Array, Array]:
        """Return normals (5, 3) and offsets (5,): points p of the camera's frame with n p + c >= 0 lie within."""
        normals, offsets = [(0.0, 0.0, 1.0)], [-self.start_mm]
        for axis in (0, 1):
            for sign in (1.0, -1.0):
                normals.append((sign * (axis == 0), sign * (axis == 1), float(self.slopes[axis])))
                offsets.append(float(self.half_mm[axis] - self.slopes[axis] * self.start_mm))
        return np.array(normals), np.array(offsets)

    def corners(self) -> tuple[Array, Array]:
        """Return where its edges and its axis start (5, 3), and their directions."""
        signs = np.array([(0, 0), (1, 1), (1, -1), (-1, -1), (-1, 1)], dtype=np.float64)
        starts = np.column_stack([signs * self.half_mm, np.full(5, self.start_mm)])
        return starts, np.column_stack([signs * self.slopes, np.ones(5)])


def within(polygon: Array, view: View) -> Array:
    """Return the part of a polygon (n, 3) that lies in the view (Sutherland and Hodgman 1974)."""
    for normal, offset in zip(*view.sides(), strict=True):
        side = polygon @ normal + offset
        following, after = np.roll(polygon, -1, axis=0), np.roll(side, -1)
        crossing = (side < 0) != (after < 0)
        share = np.where(crossing, side / np.where(crossing, side - after, 1.0), 0.0)[:, None]
        both = np.stack([polygon, polygon + share * (following - polygon)], axis=1)
        polygon = both[np.stack([side >= 0, crossing], axis=1)]
        if not len(polygon):
            break
    return np.asarray(polygon)


def triangle_depths(triangles: Array, view: View) -> list[float]:
    """Return the ends of the distances at which a view shows triangles (n, 3, 3); nothing where it does not."""
    normals, offsets = view.sides()
    inside = triangles @ normals.T + offsets >= 0
    whole = np.all(inside, axis=(1, 2))
    cut = triangles[np.all(np.any(inside, axis=1), axis=1) & ~whole]  # the others lie wholly beyond one side
    pieces = [within(triangle, view) for triangle in cut] if len(cut) <= MOST_CUT else [cut.reshape(-1, 3)]
    seen = np.concatenate([triangles[whole].reshape(-1, 3), *pieces])
    return [float(seen[:, 2].min()), float(seen[:, 2].max())] if len(seen) else []
