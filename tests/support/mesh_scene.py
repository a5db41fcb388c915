"""The two meshes of the reference scene C, made by formula: a torus knot and a bumpy ball, 303,104 triangles in all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Triangles = tuple[NDArray[np.float64], NDArray[np.int64]]


def torus_knot(along: int = 2048, around: int = 54) -> Triangles:
    """Return points and faces of a tube of radius 0.26 round a (2, 3) torus knot, facing outwards."""
    scale, tube, center = 0.40, 0.26, np.array([-1.05, 0.0, 1.45])

    def curve(t: NDArray[np.float64], core: float = 0.0) -> NDArray[np.float64]:
        reach = 2 + (1 - core) * np.cos(3 * t)
        return scale * np.stack([reach * np.cos(2 * t), -(1 - core) * np.sin(3 * t), reach * np.sin(2 * t)], axis=1)

    t = 2 * np.pi * np.arange(along) / along
    tangent = curve(t + 1e-4) - curve(t - 1e-4)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    out = curve(t) - curve(t, core=1.0)  # from the circle within the torus
    out -= (out * tangent).sum(axis=1, keepdims=True) * tangent
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    side = np.cross(tangent, out)
    turn = 2 * np.pi * np.arange(around) / around
    ring = np.cos(turn)[None, :, None] * out[:, None] + np.sin(turn)[None, :, None] * side[:, None]
    points = center + curve(t)[:, None] + tube * ring
    i, j = np.meshgrid(np.arange(along), np.arange(around), indexing="ij")
    a, b = i * around + j, (i + 1) % along * around + j
    c, d = (i + 1) % along * around + (j + 1) % around, i * around + (j + 1) % around
    faces = np.stack([a, c, b, a, d, c], axis=-1).reshape(-1, 3)
    return points.reshape(-1, 3), faces


def icosphere(levels: int) -> Triangles:
    """Return an icosahedron whose triangles are divided in four ``levels`` times, on the unit sphere."""
    g = (1 + 5**0.5) / 2
    corners = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g), (0, -1, -g), (0, 1, -g)]
    corners += [(g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    points = np.array(corners) / np.hypot(1, g)
    distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
    near = np.abs(distance - np.sort(distance[0])[1]) < 1e-9
    faces = np.array(
        [(a, b, c) for a in range(12) for b in range(a) for c in range(b) if near[a, b] & near[b, c] & near[c, a]]
    )
    for _ in range(levels):
        edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        unique, index = np.unique(edges, axis=0, return_inverse=True)
        middle = points[unique].sum(axis=1)
        m = len(points) + index.reshape(-1, 3)
        points = np.concatenate([points, middle / np.linalg.norm(middle, axis=1, keepdims=True)])
        (a, b, c), (ab, bc, ca) = faces.T, m.T
        faces = np.concatenate([np.stack(x, 1) for x in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
    corner = points[faces]
    inwards = (np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]) * corner[:, 0]).sum(axis=1) < 0
    faces[inwards] = faces[inwards][:, [0, 2, 1]]
    return points, faces


def bumpy_ball(levels: int = 6) -> Triangles:
    """Return points and faces of a sphere of radius about 1 with bumps of two sizes."""
    points, faces = icosphere(levels)
    x, y, z = points.T
    bumps = 0.10 * np.sin(5 * x + 1) * np.sin(6 * y + 2) * np.sin(7 * z + 3)
    bumps += 0.04 * np.sin(17 * x) * np.sin(19 * y) * np.sin(23 * z)
    return points * (1 + bumps)[:, None] + np.array([1.55, 0.6, 1.20]), faces


def write_ply(path: Path, points: NDArray[np.float64], faces: NDArray[np.int64]) -> None:
    """Write a binary PLY file."""
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz")
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = np.zeros(len(faces), np.dtype([("count", "u1"), ("corner", "<i4", 3)]))
    rows["count"], rows["corner"] = 3, faces
    path.write_bytes(header.encode() + np.ascontiguousarray(points, "<f4").tobytes() + rows.tobytes())


def write_meshes(folder: Path) -> Path:
    """Write knot.ply and ball.ply, where they are not there yet; return the folder."""
    for name, make in (("knot.ply", torus_knot), ("ball.ply", bumpy_ball)):
        if not (folder / name).exists():
            write_ply(folder / name, *make())
    return folder
