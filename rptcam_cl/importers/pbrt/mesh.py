"""Triangle meshes on their way from pbrt to a scene of ours."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.importers.pbrt.transforms import Matrix, apply, apply_to_normals, reflects, tidy

Array = NDArray[np.float64]
Faces = NDArray[np.int64]

# Corners of two triangles of a parallelogram agree to this, relative to its size: files carry six digits or so.
PARALLELOGRAM_TOLERANCE = 1e-5
CORNERS_UV = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float64)


@dataclass(frozen=True, eq=False)
class MeshData:
    """A mesh; the front side is that from which a face runs counter-clockwise.

    Attributes
    ----------
    vertices : (n, 3) array
    faces : (m, 3) array of int
    normals : (n, 3) array or None
    uvs : (n, 2) array or None
    """

    vertices: Array
    faces: Faces
    normals: Array | None = None
    uvs: Array | None = None

    def transformed(self, matrix: Matrix) -> MeshData:
        """Return the mesh in another place; its front side is carried along, also by a reflection."""
        normals = None if self.normals is None else apply_to_normals(matrix, self.normals)
        faces = self.faces[:, ::-1] if reflects(matrix) else self.faces
        return replace(self, vertices=apply(matrix, self.vertices), faces=faces, normals=normals)

    def reversed(self) -> MeshData:
        """Return the mesh with front and back exchanged."""
        return replace(self, faces=self.faces[:, ::-1], normals=None if self.normals is None else -self.normals)

    def facing_its_normals(self) -> MeshData:
        """Return the mesh with the front of each face on the side of its vertex normals, as pbrt takes it."""
        if self.normals is None:
            return self
        behind = (self.crosses() * self.normals[self.faces].sum(axis=1)).sum(axis=1) < 0
        return replace(self, faces=np.where(behind[:, None], self.faces[:, ::-1], self.faces))

    def crosses(self) -> Array:
        """Return the cross product of two edges of each face (m, 3): its normal, twice its area long."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return np.cross(b - a, c - a)

    def areas(self) -> Array:
        """Return the area of each face (m,)."""
        return np.asarray(np.linalg.norm(self.crosses(), axis=1) / 2)

    def keys(self) -> dict[str, Any]:
        """Return the keys of a mesh that is written out."""
        found: dict[str, Any] = {"vertices": tidy(self.vertices), "faces": self.faces.tolist()}
        if self.normals is not None:
            found["normals"] = tidy(self.normals)
        if self.uvs is not None:
            found["uvs"] = self.uvs.tolist()
        return found

    def ply(self) -> bytes:
        """Return the mesh as a binary PLY file."""
        columns = [self.vertices]
        names = ["x", "y", "z"]
        if self.normals is not None:
            columns.append(self.normals)
            names += ["nx", "ny", "nz"]
        if self.uvs is not None:
            columns.append(self.uvs)
            names += ["u", "v"]
        rows = np.zeros(len(self.faces), np.dtype([("count", "u1"), ("vertices", "<i4", 3)]))
        rows["count"], rows["vertices"] = 3, self.faces
        header = [
            "ply", "format binary_little_endian 1.0", f"element vertex {len(self.vertices)}",
            *(f"property float {name}" for name in names),
            f"element face {len(self.faces)}", "property list uchar int vertex_indices", "end_header\n",
        ]  # fmt: skip
        return "\n".join(header).encode() + np.concatenate(columns, axis=1).astype("<f4").tobytes() + rows.tobytes()

    def write_ply(self, path: Path) -> None:
        """Write the mesh as a binary PLY file."""
        path.write_bytes(self.ply())


def rectangle_of(mesh: MeshData, *, textured: bool, oriented: bool) -> dict[str, Any] | None:
    """Return the keys of a rectangle for a mesh of two triangles that are one; None when they are not.

    Parameters
    ----------
    textured
        Whether the texture coordinates must be those of a rectangle, from (0, 0) to (1, 1).
    oriented
        Whether the front must stay the front.
    """
    ring = _ring(mesh)
    if ring is None:
        return None
    a, b, c, d = corners = mesh.vertices[ring]
    size = np.ptp(corners, axis=0).max()
    if np.abs(a + c - b - d).max() > PARALLELOGRAM_TOLERANCE * size or not _is_flat(mesh, ring):
        return None
    if textured:
        if mesh.uvs is None:
            return None
        turns = [ring] if oriented else [ring, ring[::-1]]
        fits = [turn for way in turns for turn in _turns(way) if np.allclose(mesh.uvs[turn], CORNERS_UV, atol=1e-6)]
        if not fits:
            return None
        ring = fits[0]
    a, b, _, d = mesh.vertices[ring]
    if np.linalg.norm(np.cross(b - a, d - a)) < 1e-9 * size * size:
        return None
    return {"shape": "rectangle", "corner": tidy(a), "edge_u": tidy(b - a), "edge_v": tidy(d - a)}


def _ring(mesh: MeshData) -> list[int] | None:
    """Return the four corners of two triangles that share an edge, from the first corner on, in its order."""
    if len(mesh.faces) != 2 or len(set(mesh.faces.reshape(-1).tolist())) != 4:
        return None
    first, second = mesh.faces.tolist()
    for k in range(3):
        apex, p, q = first[k], first[(k + 1) % 3], first[(k + 2) % 3]
        for j in range(3):
            if (second[j], second[(j + 1) % 3]) == (q, p):
                ring = [apex, p, second[(j + 2) % 3], q]
                start = ring.index(first[0])
                return ring[start:] + ring[:start]
    return None


def _turns(ring: list[int]) -> list[list[int]]:
    return [ring[k:] + ring[:k] for k in range(4)]


def _is_flat(mesh: MeshData, ring: list[int]) -> bool:
    """Return whether the vertex normals, if any, are the normal of the plane."""
    if mesh.normals is None:
        return True
    normal = mesh.crosses()[0]
    length = np.linalg.norm(normal)
    lengths = np.linalg.norm(mesh.normals[ring], axis=1)
    return bool(np.all(mesh.normals[ring] @ normal > (1 - 1e-6) * length * lengths))
