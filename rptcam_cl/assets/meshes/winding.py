"""Whether a point lies inside a mesh."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes.clean import CHUNK


def winding_number(positions: NDArray[np.float32], faces: NDArray[np.int32], point: NDArray[np.float64]) -> float:
    """Return how often a mesh surrounds a point: 1 inside a solid that faces outwards, 0 outside, between when open.

    The solid angles of the triangles (van Oosterom and Strackee 1983) over 4π.
    """
    total = 0.0
    seen = positions.T - point[:, None]
    distances = np.sqrt((seen * seen).sum(axis=0))
    for start in range(0, len(faces), CHUNK):
        corners = np.ascontiguousarray(faces[start : start + CHUNK].T)
        a, b, c = (seen[:, place] for place in corners)
        la, lb, lc = (distances[place] for place in corners)
        volume = a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2])
        volume += a[2] * (b[0] * c[1] - b[1] * c[0])
        ab, bc, ca = ((one * other).sum(axis=0) for one, other in ((a, b), (b, c), (c, a)))
        total += float(np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb).sum())
    return total / (2 * math.pi)
