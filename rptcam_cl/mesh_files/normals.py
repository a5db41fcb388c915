"""Normals of vertices: made from the triangles round them, or given and brought to unit length."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.mesh_files.clean import CHUNK


def smooth_normals(positions: NDArray[np.float32], faces: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return the unit normals (n, 3) of vertices: the mean of the triangles round each, weighted by their angles there.

    Vertices of equal position count as one, so seams of texture coordinates do not show (Thürmer and Wüthrich 1998).
    """
    corner = _same_position(positions)
    sums = np.zeros((int(corner.max()) + 1, 3))
    anyone = np.zeros_like(sums)
    for start in range(0, len(faces), CHUNK):
        part = faces[start : start + CHUNK]
        angles, normals = _angles_and_normals(positions[part].astype(np.float64))
        for place in range(3):
            vertices = corner[part[:, place]]
            np.add.at(sums, vertices, angles[:, place, None] * normals)
            anyone[vertices] = normals
    # Triangles cancel where both sides of a sheet share its vertices: one of the two sides is as good as the other.
    cancelled = np.linalg.norm(sums, axis=1) < 1e-9
    sums[cancelled] = anyone[cancelled]
    unit: NDArray[np.float32] = (sums / np.linalg.norm(sums, axis=1)[:, None]).astype(np.float32)
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


def _angles_and_normals(corners: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the angle [rad] at each corner (m, 3) and the unit normal (m, 3) of triangles (m, 3, 3)."""
    edges = np.roll(corners, -1, axis=1) - corners
    normals = np.cross(edges[:, 0], edges[:, 1])
    twice_area = np.linalg.norm(normals, axis=1)
    cosines = -np.einsum("ijk,ijk->ij", edges, np.roll(edges, 1, axis=1))
    return np.arctan2(twice_area[:, None], cosines), normals / twice_area[:, None]
