"""Blender's meshes as arrays: triangles whose corners have normals and texture coordinates of their own."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.scene.assets.mesh import MOST_TRIANGLES, MeshSurface, lay_out_colours


@dataclass(frozen=True, eq=False)
class BlenderMesh:
    """An evaluated mesh.

    Attributes
    ----------
    points : (n, 3) float32 array
        Of the vertices, in the object's frame.
    vertex_of_loop : (loops,) int array
        The vertex at each corner of a polygon.
    triangles : (m, 3) int array
        Corners (loops) of each triangle.
    slot : (m,) int array
        Material slot of each triangle.
    normals : (loops, 3) float32 array
        At each corner.
    uvs : dict
        Texture coordinates of each corner, (loops, 2) float32, by name; the first is the active one.
    is_flat : bool
        Whether all faces are flat, so that corners have the normals of their triangles.
    colors : dict
        Color attributes at each corner, (loops, 3) float32, linear, by name; the first is the one that is rendered.
    """

    points: NDArray[np.float32]
    vertex_of_loop: NDArray[np.int32]
    triangles: NDArray[np.int32]
    slot: NDArray[np.int32]
    normals: NDArray[np.float32]
    uvs: dict[str, NDArray[np.float32]]
    is_flat: bool = False
    colors: dict[str, NDArray[np.float32]] = field(default_factory=dict)

    @cached_property
    def corners(self) -> NDArray[np.float64]:
        """The corners (8, 3) of the box round it."""
        ends = np.stack([self.points.min(axis=0), self.points.max(axis=0)]).astype(np.float64)
        return np.array([[ends[i][0], ends[j][1], ends[k][2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])

    @cached_property
    def uv_size(self) -> float:
        """Length that a unit of the active texture coordinates has on the mesh [units]; 1 where there are none."""
        return _uv_size(self)


@dataclass(frozen=True, eq=False)
class Strands:
    """Hair: points (n, 3) of all strands in the object's frame, their widths (n,), and the number of points of each."""

    points: NDArray[np.float32]
    widths: NDArray[np.float32]
    counts: NDArray[np.int32]

    def keys(self) -> dict[str, Any] | None:
        """The shape of a scene; None without strands."""
        enough = self.counts >= 2
        of_point = np.repeat(enough, self.counts)
        if not enough.any():
            return None
        rows = np.concatenate([self.points, self.widths[:, None]], axis=1)[of_point]
        return {"shape": "curves", "points": rows, "counts": self.counts[enough].tolist(), "basis": "catmull_rom"}


def widths_of_particles(count: int, root: float, tip: float, shape: float, *, is_closed: bool) -> NDArray[np.float32]:
    """Widths along a strand of a particle system with these widths at its ends; `shape` bends their course."""
    left = 1 - np.linspace(0, 1, count)
    course = left ** (1 + shape) if shape < 0 else left ** (1 / max(1 - shape, 1e-6))
    widths = tip + (root - tip) * course
    if is_closed:
        widths[-1] = 0
    return widths.astype(np.float32)


def part(mesh: BlenderMesh, slot: int, coordinates: str) -> dict[str, Any] | None:
    """The triangles of a material slot as a scene's mesh; None where it has none.

    ``coordinates`` are ``uv``, ``uv:NAME``, ``generated``, ``object``, or ``color:NAME`` for those of `painted`.
    """
    if coordinates.startswith("color:"):
        found = painted(mesh, slot, coordinates[6:])
        return part(mesh, slot, "uv") if found is None else found[0]
    chosen = _corners(mesh, slot, coordinates)
    if chosen is None:
        return None
    corners, faces = chosen
    uvs = _coordinates(mesh, coordinates)
    return {"faces": faces} | _rows(mesh, corners) | ({} if uvs is None else {"uvs": uvs[corners]})


def deformed(mesh: BlenderMesh, end: BlenderMesh, slot: int, coordinates: str) -> dict[str, Any] | None:
    """The vertices and normals that a `part` has in another shape of the same mesh; None where it is another mesh."""
    chosen = _corners(mesh, slot, coordinates)
    if chosen is None or not has_corners_of(mesh, end):
        return None
    return _rows(end, chosen[0])


def has_corners_of(mesh: BlenderMesh, other: BlenderMesh) -> bool:
    """Whether two meshes are of the same triangles, but for the places of their vertices."""
    pairs = ((mesh.vertex_of_loop, other.vertex_of_loop), (mesh.triangles, other.triangles), (mesh.slot, other.slot))
    return len(mesh.points) == len(other.points) and all(np.array_equal(*pair) for pair in pairs)


def _corners(mesh: BlenderMesh, slot: int, coordinates: str) -> tuple[NDArray[np.int64], NDArray[np.int32]] | None:
    """A corner for each vertex that a slot's triangles need, normal and coordinates its own, and the triangles."""
    loops = mesh.triangles[mesh.slot == slot]
    if not len(loops):
        return None
    corners = loops.ravel()
    uvs = _coordinates(mesh, coordinates)
    columns = [mesh.vertex_of_loop[corners].astype(np.uint32)[:, None]]
    if not mesh.is_flat:
        columns.append(np.ascontiguousarray(mesh.normals[corners]).view(np.uint32))
    if uvs is not None:
        columns.append(np.ascontiguousarray(uvs[corners]).view(np.uint32))
    first, number = _distinct(np.concatenate(columns, axis=1))
    return corners[first], number.reshape(-1, 3).astype(np.int32)


def _rows(mesh: BlenderMesh, corners: NDArray[np.int64]) -> dict[str, Any]:
    """Vertices of corners, and their normals where they are not flat."""
    rows = {"vertices": mesh.points[mesh.vertex_of_loop[corners]]}
    return rows if mesh.is_flat else rows | {"normals": mesh.normals[corners]}


def painted(mesh: BlenderMesh, slot: int, name: str) -> tuple[dict[str, Any], NDArray[np.float32]] | None:
    """The triangles of a slot with the texels of a color attribute, ``""`` for the one that is rendered.

    None where it has no such colours, or too many triangles for them.
    """
    colors = mesh.colors.get(name or next(iter(mesh.colors), ""))
    corners = mesh.triangles[mesh.slot == slot].ravel()
    if colors is None or not len(corners) or len(corners) // 3 > MOST_TRIANGLES // 4:  # a split makes four of one
        return None
    surface, texels = lay_out_colours(
        MeshSurface(
            mesh.points[mesh.vertex_of_loop[corners]],
            np.arange(len(corners)).reshape(-1, 3),
            None if mesh.is_flat else mesh.normals[corners],
            colours=colors[corners],
        )
    )
    rows = {"vertices": surface.positions, "normals": surface.normals, "uvs": surface.uvs}
    keys = {key: np.asarray(value, np.float32) for key, value in rows.items() if value is not None}
    return keys | {"faces": surface.faces.astype(np.int32)}, texels


def _distinct(rows: NDArray[np.uint32]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where each distinct row stands first, and the number of each row among them, in the order of the rows."""
    whole = np.ascontiguousarray(rows).view(np.dtype((np.void, rows.shape[1] * 4))).ravel()
    _, first, number = np.unique(whole, return_index=True, return_inverse=True)
    order = np.argsort(first)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return first[order], place[number.ravel()]


def _coordinates(mesh: BlenderMesh, kind: str) -> NDArray[np.float32] | None:
    """Texture coordinates of each corner."""
    if kind == "generated":
        least, most = mesh.points.min(axis=0), mesh.points.max(axis=0)
        size = np.where(most > least, most - least, 1)
        generated: NDArray[np.float32] = ((mesh.points - least) / size)[mesh.vertex_of_loop, :2].astype(np.float32)
        return generated
    if kind == "object":
        return mesh.points[mesh.vertex_of_loop, :2]
    if kind.startswith("uv:") and kind[3:] in mesh.uvs:
        return mesh.uvs[kind[3:]]
    return next(iter(mesh.uvs.values()), None)


def _uv_size(mesh: BlenderMesh) -> float:
    uvs = _coordinates(mesh, "uv")
    if uvs is None or not len(mesh.triangles):
        return 1.0
    corners = mesh.points[mesh.vertex_of_loop[mesh.triangles]].astype(np.float64)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    flat = uvs[mesh.triangles].astype(np.float64)
    first, second = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    covered = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]).sum()
    return float(np.sqrt(area / covered)) if covered > 0 and area > 0 else 1.0


def is_rigid(turn: NDArray[np.float64]) -> bool:
    """Whether a matrix turns and shifts without any stretch."""
    linear = turn[:3, :3]
    return bool(np.allclose(linear @ linear.T, np.eye(3), atol=1e-4) and np.linalg.det(linear) > 0)


def movement(
    start: NDArray[np.float64], end: NDArray[np.float64], times: tuple[float, float]
) -> tuple[list[dict[str, Any]], bool]:
    """Keyframes of an object that is at `start` and at `end` at two times, and whether they have all of its motion.

    An object whose stretch changes is shifted alone.
    """
    if np.array_equal(start, end):
        return [], True
    turn = end @ np.linalg.inv(start)
    whole = is_rigid(turn)
    if not whole:
        turn = np.eye(4)
        turn[:3, 3] = end[:3, 3] - start[:3, 3]
    else:  # float32 matrices of Blender are orthogonal to six digits, and the scene wants exact turns
        u, _, v = np.linalg.svd(turn[:3, :3])
        turn[:3, :3] = u @ v
        turn[:3, 3] = end[:3, 3] - turn[:3, :3] @ start[:3, 3]
    rows = [np.eye(4)[:3].tolist(), turn[:3].tolist()]
    return [{"time_s": time, "matrix": matrix} for time, matrix in zip(times, rows, strict=True)], whole


def can_be_inverted(matrix: NDArray[np.float64]) -> bool:
    """Whether a scene takes the matrix: its smallest stretch is at least 1e-6 of the largest."""
    stretches = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    return bool(np.isfinite(matrix).all() and stretches[-1] > 2e-6 * stretches[0] > 0)
