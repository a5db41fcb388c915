"""Faces of a file, polygons of any size, as triangles."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.errors import InputError
from rptcam_cl.mesh_files.polygons import Polygons, triangulate

__all__ = ["Polygons", "as_triangles", "check_corners"]


def check_corners(polygons: Polygons, vertices: int, face: str) -> None:
    """Refuse polygons that have fewer than three corners, or name vertices that are not there.

    `face` is what errors call a face, before its number: ``bunny.ply: face``.
    """
    numbers, corners = polygons
    if len(corners) and corners.shape[1] < 3:
        raise InputError(f"{face} {numbers[0]} has {corners.shape[1]} corners (allowed: at least 3)")
    if not corners.size or (corners.min() >= 0 and corners.max() < vertices):
        return
    wrong = (corners < 0) | (corners >= vertices)
    row = int(np.argmax(wrong.any(axis=1)))
    index = corners[row][wrong[row]][0]
    allowed = f"0 to {vertices - 1}" if vertices else "none, there are no vertices"
    raise InputError(f"{face} {numbers[row]} names a vertex that is not there (got {index}; allowed: {allowed})")


def as_triangles(positions: NDArray[Any], polygons: list[Polygons], face: str) -> NDArray[np.int32]:
    """Return the triangles (m, 3) of checked polygons."""
    found = []
    for numbers, corners in polygons:
        check_corners(Polygons(numbers, corners), len(positions), face)
        if corners.shape[1] == 3:
            found.append(corners.astype(np.int32, copy=False))
        else:
            triangles = triangulate(positions, Polygons(numbers, corners), face)
            rows = np.arange(len(corners))[:, None, None]
            found.append(corners[rows, triangles].reshape(-1, 3).astype(np.int32))
    return np.concatenate(found) if len(found) != 1 else found[0]
