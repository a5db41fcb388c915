"""Triangles of a scene as the device holds them: pools of vertices and triangles, and who uses them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass

VERTEX_FLOATS = 8  # position, normal (zero: none), texture coordinates


@dataclass(frozen=True, eq=False)
class TriangleGroup:
    """Triangles that share a tree.

    Attributes
    ----------
    key : str
        Hash of its corners in the frame of the group.
    first_triangle, triangles : int
        Where it lies in the pool of triangles.
    first_vertex, vertices : int
        Where it lies in the pool of vertices.
    shift : (3,) float64 array
        What takes the group's frame to that in which rays meet it [m]: zero for a mesh that instances share.
    """

    key: str
    first_triangle: int
    triangles: int
    first_vertex: int
    vertices: int
    shift: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PackedMeshes:
    """All meshes of a scene.

    Attributes
    ----------
    vertices : (n, 8) float32 array
        Position, normal, texture coordinates; positions in the frame of their group, not shifted.
    triangles : (m, 4) int32 array
        Corners in the pool of vertices, and the place of the triangle's primitive among those of its instance.
    groups : tuple of TriangleGroup
    instances : array of ``Instance`` records
        Their roots are not known yet.
    group_of_instance : (i,) int array
    instanced : bool
        Whether rays must be taken to the frames of instances: false where all triangles stand in the world.
    """

    vertices: NDArray[np.float32]
    triangles: NDArray[np.int32]
    groups: tuple[TriangleGroup, ...]
    instances: NDArray[np.void]
    group_of_instance: NDArray[np.int64]
    instanced: bool


def shifted(points: NDArray[np.float32], shift: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return points or box corners (..., 3) moved by ``shift``, rounded once.

    Rounding keeps order, so a box that held points before holds them afterwards.
    """
    return (points + shift).astype(np.float32)
