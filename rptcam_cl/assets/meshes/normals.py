"""Normals of vertices: those of a file at unit length, or the mean of the triangles round each vertex."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes.clean import CHUNK

Vectors = NDArray[np.float64]


def smooth_normals(positions: NDArray[np.float32], faces: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return the unit normals (n, 3) of vertices: the mean of the triangles round each, weighted by their angles there.

    Vertices of equal position count as one, so seams of texture coordinates do not show (Thürmer and Wüthrich 1998).
    """
    corner = _same_position(positions)
    sums = np.zeros((3, int(corner.max()) + 1))
    anyone = np.zeros_like(sums)
    columns = np.ascontiguousarray(positions.T)
    for start in range(0, len(faces), CHUNK):
        vertices = np.ascontiguousarray(faces[start : start + CHUNK].T)
        angles, normal = _angles_and_normal(*(columns[:, place].astype(np.float64) for place in vertices))
        for place, angle in zip(corner[vertices], angles, strict=True):
            anyone[:, place] = normal
            for axis in range(3):
                np.add.at(sums[axis], place, angle * normal[axis])
    # Triangles cancel where both sides of a sheet share its vertices: one of the two sides is as good as the other.
    cancelled = (sums * sums).sum(axis=0) < 1e-18
    sums[:, cancelled] = anyone[:, cancelled]
    unit: NDArray[np.float32] = (sums / np.sqrt((sums * sums).sum(axis=0))).T.astype(np.float32)
    return unit[corner]


def unit_normals(
    normals: NDArray[Any], positions: NDArray[np.float32], faces: NDArray[np.int32]
) -> NDArray[np.float32]:
    """Return given normals (n, 3) at unit length; where a file has a zero vector, the smooth normal stands in."""
    wide = np.asarray(normals)
    largest = np.abs(wide).max(axis=1)
    missing = largest == 0
    scaled = wide / np.where(missing, 1, largest).astype(wide.dtype)[:, None]
    scaled /= np.sqrt(np.maximum(np.einsum("ij,ij->i", scaled, scaled), 0.5))[:, None]
    result: NDArray[np.float32] = scaled.astype(np.float32)
    if missing.any():
        result[missing] = smooth_normals(positions, faces)[missing]
    return result


def _same_position(positions: NDArray[np.float32]) -> NDArray[np.intp]:
    """Return, for each vertex, the number of its position among the different ones."""
    order = np.lexsort(tuple(positions.T))
    ordered = positions[order]
    new = np.ones(len(order), bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    number = np.empty(len(order), np.intp)
    number[order] = np.cumsum(new) - 1
    return number


def _angles_and_normal(a: Vectors, b: Vectors, c: Vectors) -> tuple[Vectors, Vectors]:
    """Return the angles [rad] at the three corners (3, m), and the unit normal (3, m), of triangles a, b, c (3, m)."""
    ab, bc, ca = b - a, c - b, a - c
    normal = np.stack([ab[1] * bc[2] - ab[2] * bc[1], ab[2] * bc[0] - ab[0] * bc[2], ab[0] * bc[1] - ab[1] * bc[0]])
    twice_area = np.sqrt((normal * normal).sum(axis=0))
    cosines = np.stack([-(ca * ab).sum(axis=0), -(ab * bc).sum(axis=0), -(bc * ca).sum(axis=0)])
    return np.arctan2(twice_area, cosines), normal / twice_area
