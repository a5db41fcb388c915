"""Emissive meshes as emitters: one per triangle, so that light sampling spreads over them by power."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.geometry import Mesh
from rptcam_cl.kinds import EmitterKind
from rptcam_cl.records import EMITTER


def triangle_emitters(
    mesh: Mesh, placement: NDArray[np.float64], eye: NDArray[np.float64]
) -> tuple[NDArray[np.void], NDArray[np.float64]]:
    """Return emitter records of a mesh's triangles, without radiance and indices, and their areas [m²].

    Parameters
    ----------
    mesh
        The triangles.
    placement
        (4, 4), the scene in metres from the mesh's frame.
    eye
        What becomes the origin [m].
    """
    linear = placement[:3, :3]
    points = (mesh.positions + mesh.origin) @ linear.T + (placement[:3, 3] - eye)
    a, b, c = (points[mesh.faces[:, corner]] for corner in range(3))
    u, v = b - a, c - a
    normal = np.cross(u, v) * np.sign(np.linalg.det(linear))
    if mesh.normals is not None:  # they say which side is out
        shown = mesh.normals[mesh.faces].sum(axis=1) @ np.linalg.inv(linear)
        normal *= np.where((normal * shown).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    double_area = np.linalg.norm(normal, axis=1)
    records = EMITTER.zeros(len(mesh.faces))
    records["kind"] = EmitterKind.TRIANGLE
    records["a"][:, :3], records["a"][:, 3] = a, double_area / 2
    records["u"][:, :3], records["v"][:, :3] = u, v
    if mesh.uvs is not None:
        corner, first, second = (mesh.uvs[mesh.faces[:, index]] for index in range(3))
        records["uv"][:, :2], records["uv_x"][:, :2], records["uv_y"][:, :2] = corner, first - corner, second - corner
    records["normal"][:, :3] = normal / np.maximum(double_area, np.finfo(np.float64).tiny)[:, None]
    return records, double_area / 2
