"""Whether a point lies inside a mesh."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.mesh_files.clean import CHUNK


def winding_number(positions: NDArray[np.float32], faces: NDArray[np.int32], point: NDArray[np.float64]) -> float:
    """Return how often a mesh surrounds a point: 1 inside a solid that faces outwards, 0 outside, between when open.

    The solid angles of the triangles (van Oosterom and Strackee 1983) over 4π.
    """
    total = 0.0
    for start in range(0, len(faces), CHUNK):
        a, b, c = np.moveaxis(positions[faces[start : start + CHUNK]] - point, 1, 0)
        la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
        volume = np.einsum("ij,ij->i", a, np.cross(b, c))
        ab, bc, ca = (np.einsum("ij,ij->i", one, other) for one, other in ((a, b), (b, c), (c, a)))
        total += float(np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb).sum())
    return total / (2 * math.pi)
