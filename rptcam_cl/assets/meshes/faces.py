"""Polygons of mesh files: checked, cut into triangles, and their different corners as vertices.

Convex polygons become fans, quads are cut along the diagonal inside, others by their ears.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError

# Corners of a polygon that is not convex; cutting ears takes time that grows with the square.
MOST_CORNERS = 1000

Corners = NDArray[Any]


class Polygons(NamedTuple):
    """Polygons of one size.

    Attributes
    ----------
    number : (m,) int
        Their places among all faces of the file.
    corners : (m, k) int
        Vertex of each corner.
    """

    number: NDArray[Any]
    corners: NDArray[Any]


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


def triangulate(positions: NDArray[Any], polygons: Polygons, face: str) -> Corners:
    """Return the triangles of polygons that have equally many corners, as places 0 to k - 1 in their polygon.

    Parameters
    ----------
    positions : (n, 3) array
    polygons : Polygons
        Their corners are indices into the positions, inside their range; they have 3 or more.
    face : str
        What an error calls a polygon, before its number.

    Returns
    -------
    triangles : (m, k - 2, 3) array
    """
    numbers, corners = polygons
    count, size = corners.shape
    fan = np.stack([np.zeros(size - 2, np.int64), np.arange(1, size - 1), np.arange(2, size)], axis=1)
    triangles = np.broadcast_to(fan, (count, size - 2, 3))
    if size == 3:
        return triangles
    bent = np.flatnonzero(~_fan_fits(positions, corners))
    if not len(bent):
        return triangles
    triangles = triangles.copy()
    if size == 4:
        triangles[bent] = [[1, 2, 3], [1, 3, 0]]
        return triangles
    if size > MOST_CORNERS:
        raise InputError(
            f"{face} {numbers[bent[0]]} has {size} corners and is not convex (allowed: a convex one, or up to "
            f"{MOST_CORNERS} corners)"
        )
    for index in bent:
        triangles[index] = _ears(np.asarray(positions[corners[index]], np.float64))
    return triangles


def _fan_fits(positions: NDArray[Any], polygons: NDArray[Any]) -> NDArray[np.bool_]:
    """Return for each polygon whether the triangles from its first corner all face the same way."""
    fits = np.ones(len(polygons), bool)
    rows = max(1, (1 << 19) // polygons.shape[1])
    for start in range(0, len(polygons), rows):
        corners = positions[polygons[start : start + rows]].astype(np.float64)
        spokes = corners[:, 1:] - corners[:, :1]
        normals = np.cross(spokes[:, :-1], spokes[:, 1:])
        with np.errstate(invalid="ignore", over="ignore"):
            along = np.einsum("ijk,ik->ij", normals, normals.sum(axis=1))
        fits[start : start + rows] = ~(along < 0).any(axis=1)
    return fits


def _ears(corners: NDArray[np.float64]) -> list[tuple[int, int, int]]:
    """Return the triangles of one polygon (k, 3), by cutting off ears in the plane it lies in best (Meisters 1975)."""
    flat = _flattened(corners)
    left = list(range(len(flat)))
    found: list[tuple[int, int, int]] = []
    while len(left) > 3:
        ear = next((place for place in range(len(left)) if _is_ear(flat, left, place)), 0)
        found.append((left[ear - 1], left[ear], left[(ear + 1) % len(left)]))
        del left[ear]
    return [*found, (left[0], left[1], left[2])]


def _flattened(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return corners (k, 2) seen along the axis that is nearest to the polygon's normal, counter-clockwise."""
    normal = np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)
    axis = int(np.argmax(np.abs(normal)))
    flat = corners[:, [(axis + 1) % 3, (axis + 2) % 3]]
    return flat if normal[axis] >= 0 else flat * (1, -1)


def _is_ear(flat: NDArray[np.float64], left: list[int], place: int) -> bool:
    """Return whether a corner turns inwards and no other corner that is left lies in its triangle."""
    around = [left[place - 1], left[place], left[(place + 1) % len(left)]]
    a, b, c = flat[around]
    if _turn(a, b, c) <= 0:
        return False
    others = flat[[index for index in left if index not in around]]
    inside = (_turn(a, b, others) >= 0) & (_turn(b, c, others) >= 0) & (_turn(c, a, others) >= 0)
    same = ((others == a) | (others == b) | (others == c)).all(axis=1)
    return not bool((inside & ~same).any())


def _turn(a: NDArray[np.float64], b: NDArray[np.float64], points: NDArray[np.float64]) -> Any:
    """Return twice the signed area of the triangles a, b, point."""
    return (b[0] - a[0]) * (points[..., 1] - a[1]) - (b[1] - a[1]) * (points[..., 0] - a[0])


def weld(
    polygons: list[Polygons], corner_uvs: list[NDArray[Any]]
) -> tuple[NDArray[np.intp], NDArray[Any], list[Polygons]]:
    """Return one vertex for each different pair of position and texture coordinate of a corner.

    Parameters
    ----------
    polygons : list of Polygons
        Their corners are indices of positions.
    corner_uvs : list of (m, k, 2) arrays
        Texture coordinates of the corners.

    Returns
    -------
    positions : (n,) array
        Index of the position of each vertex.
    uvs : (n, 2) array
        Texture coordinates of each vertex.
    polygons : list of Polygons
        The same with indices of vertices.
    """
    uvs = np.concatenate([part.reshape(-1, 2) for part in corner_uvs])
    corners = np.concatenate([corners.ravel() for _, corners in polygons])
    kept, vertices = different_rows([corners, uvs[:, 0], uvs[:, 1]])
    return corners[kept], uvs[kept], _with_corners(polygons, vertices)


def different_rows(columns: list[NDArray[Any]]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the first place of each different row, in the order of the first places, and each row's number in it."""
    keys = _one_column(columns)
    order = np.lexsort(keys)
    new = np.zeros(len(order), bool)
    new[:1] = True
    for column in keys:
        ordered = column[order]
        new[1:] |= ordered[1:] != ordered[:-1]
    group = np.cumsum(new) - 1
    first = order[new]  # the sort is stable
    ranked = np.argsort(first)
    number = np.empty(len(first), np.intp)
    number[ranked] = np.arange(len(first))
    vertices = np.empty(len(order), np.intp)
    vertices[order] = number[group]
    return first[ranked], vertices


def _one_column(columns: list[NDArray[Any]]) -> list[NDArray[Any]]:
    """Return columns of whole numbers from -1 on as one that distinguishes the same rows, where 63 bits hold it."""
    if any(column.dtype.kind != "i" for column in columns) or not len(columns[0]):
        return columns
    spans = [int(column.max()) + 2 for column in columns]
    if math.prod(spans) >= 2**63:
        return columns
    key = np.zeros(len(columns[0]), np.int64)
    for column, span in zip(columns, spans, strict=True):
        key *= span
        key += column
        key += 1
    return [key]


def _with_corners(polygons: list[Polygons], vertices: NDArray[np.intp]) -> list[Polygons]:
    ends = np.cumsum([corners.size for _, corners in polygons])
    parts = np.split(vertices, ends[:-1])
    return [Polygons(numbers, part.reshape(old.shape)) for (numbers, old), part in zip(polygons, parts, strict=True)]
