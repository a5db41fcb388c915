"""Vertices of corners: where corners share a position but not a normal or texture coordinate, they are told apart."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.mesh_files.faces import Polygons


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
    """Return columns of whole numbers from -1 on as one that tells the same rows apart, where 63 bits hold it."""
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
