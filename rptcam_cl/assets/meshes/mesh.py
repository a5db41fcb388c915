"""A triangle mesh as it is held in memory, and how it is made from what a file says."""

from __future__ import annotations

import hashlib
import math
from dataclasses import field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes.clean import CHUNK, Dropped, sound_faces, used_vertices
from rptcam_cl.assets.meshes.normals import smooth_normals, unit_normals
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError

NormalsMode = Literal["auto", "smooth", "flat"]

# Coordinates that a scene takes, and the smallest extent whose squares float32 holds (see the scene's quantities).
LARGEST_COORDINATE = 1e12
SMALLEST_EXTENT = 1e-12

# A mesh that lies farther than this many times its size from the zero of its coordinates is moved to its own origin.
FARTHEST_FROM_ZERO = 4


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles. Arrays are read-only and in C order.

    Attributes
    ----------
    origin : (3,) float64
        What `positions` are relative to; zero unless the mesh lies far from the zero of its coordinates.
    positions : (n, 3) float32
        Vertices, relative to the origin.
    faces : (m, 3) int32
        Vertices of each triangle, counter-clockwise seen from the front.
    normals : (n, 3) float32 or None
        Unit normals of the vertices; None for a mesh whose triangles are flat.
    uvs : (n, 2) float32 or None
        Texture coordinates of the vertices; v = 0 is the lower edge of a picture.
    content_hash : str
        SHA-256 of all of it.
    """

    origin: NDArray[np.float64]
    positions: NDArray[np.float32]
    faces: NDArray[np.int32]
    normals: NDArray[np.float32] | None
    uvs: NDArray[np.float32] | None
    content_hash: str = field(repr=False)

    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the lowest and highest corner."""
        return self._bounds

    @cached_property
    def _bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return self.origin + self.positions.min(axis=0), self.origin + self.positions.max(axis=0)

    def with_normals(self, mode: NormalsMode) -> Mesh:
        """Return the mesh with the normals of a mode, sharing all other arrays; `auto` leaves them."""
        if mode == "auto" or (mode == "flat" and self.normals is None):
            return self
        normals = smooth_normals(self.positions, self.faces) if mode == "smooth" else None
        return replace(self, normals=_frozen(normals), content_hash=_hash(self, normals))


@dataclass(frozen=True, eq=False)
class MeshSurface:
    """Triangles of one material as a file has them, not yet checked for what floating point cannot use.

    Attributes
    ----------
    positions : (n, 3) float32 or float64
    faces : (m, 3) integers
        Indices into the positions, inside their range.
    normals : (n, 3) or None
        Normals of the vertices, of any length.
    uvs : (n, 2) or None
        Texture coordinates of the vertices; v = 0 is the lower edge of a picture.
    material : int or None
        Index into the materials of the file.
    name : str or None
    """

    positions: NDArray[Any]
    faces: NDArray[Any]
    normals: NDArray[Any] | None = None
    uvs: NDArray[Any] | None = None
    material: int | None = None
    name: str | None = None


def make_mesh(surface: MeshSurface, place: str) -> tuple[Mesh | None, Dropped]:
    """Return the mesh of a surface, None when no triangle of it is sound, and how many triangles were dropped.

    Parameters
    ----------
    surface : MeshSurface
    place : str
        What errors begin with: the file.
    """
    origin, positions = _centred(surface.positions, place)
    faces, dropped = sound_faces(positions, surface.faces)
    if not len(faces):
        return None, dropped
    kept, faces = used_vertices(len(positions), faces)
    positions = positions if kept is None else positions[kept]
    normals, uvs = _rows(surface.normals, kept), _rows(surface.uvs, kept)
    _check_extent(positions, place)
    if normals is not None:
        _check_finite(normals, kept, f"{place}: normal")
        normals = unit_normals(normals, positions, faces)
    if uvs is not None:
        uvs = uvs.astype(np.float32)
        _check_finite(uvs, kept, f"{place}: texture coordinate")
    mesh = Mesh(
        _frozen(origin), _frozen(positions), _frozen(faces), _frozen(normals),
        _frozen(uvs), "",
    )  # fmt: skip
    return replace(mesh, content_hash=_hash(mesh, mesh.normals)), dropped


def _rows(rows: NDArray[Any] | None, kept: NDArray[np.intp] | None) -> NDArray[Any] | None:
    return rows if rows is None or kept is None else rows[kept]


def _centred(positions: NDArray[Any], place: str) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Return the origin and float32 positions relative to it; both exact where the file has float32.

    The origin is a multiple of the power of two next to the extent, so the difference has no more bits than a
    coordinate.
    """
    finite = np.isfinite(positions).all(axis=1)
    sound = positions if finite.all() else positions[finite]
    origin = np.zeros(3)
    if not len(sound):
        return origin, positions.astype(np.float32)
    lower, upper = (np.asarray(corner, np.float64) for corner in (sound.min(axis=0), sound.max(axis=0)))
    if (reach := float(max(np.abs(lower).max(), np.abs(upper).max()))) > LARGEST_COORDINATE:
        raise InputError(f"{place}: reaches too far (got {reach:g}; allowed: coordinates up to {LARGEST_COORDINATE:g})")
    extent = float((upper - lower).max())
    if extent == 0 or np.abs(lower + upper).max() / 2 <= FARTHEST_FROM_ZERO * extent:
        return origin, np.ascontiguousarray(positions, np.float32)
    step = 2.0 ** np.floor(np.log2(extent))
    origin = np.round((lower + upper) / 2 / step) * step
    relative = np.empty(positions.shape, np.float32)
    for axis in range(3):
        relative[:, axis] = positions[:, axis] - origin[axis]
    return origin, relative


def _check_extent(positions: NDArray[np.float32], place: str) -> None:
    extent = float((positions.max(axis=0) - positions.min(axis=0)).max())
    if extent < SMALLEST_EXTENT:
        allowed = f"an extent of at least {SMALLEST_EXTENT:g}"
        raise InputError(f"{place}: is too small for float32 (got {extent:g}; allowed: {allowed})")


def _check_finite(rows: NDArray[Any], kept: NDArray[np.intp] | None, what: str) -> None:
    finite = np.isfinite(rows).all(axis=1)
    if not finite.all():
        index = int(np.argmin(finite))
        number = index if kept is None else int(kept[index])
        raise InputError(f"{what} {number} is not finite (got {rows[index].tolist()}; allowed: finite numbers)")


def _frozen(rows: NDArray[Any] | None) -> Any:
    """Return a read-only array that does not keep the data of a whole file alive."""
    if rows is not None:
        base = rows
        while isinstance(base.base, np.ndarray):
            base = base.base
        rows = rows.copy() if base.base is not None or base.nbytes > rows.nbytes else np.ascontiguousarray(rows)
        rows.setflags(write=False)
    return rows


def _hash(mesh: Mesh, normals: NDArray[np.float32] | None) -> str:
    """Return the SHA-256 of a mesh with the given normals."""
    total = hashlib.sha256()
    for rows in (mesh.origin, mesh.positions, mesh.faces, normals, mesh.uvs):
        total.update(repr(None if rows is None else rows.shape).encode())
        if rows is not None:
            total.update(np.ascontiguousarray(rows).data)
    return total.hexdigest()


def winding_number(positions: NDArray[np.float32], faces: NDArray[np.int32], point: NDArray[np.float64]) -> float:
    """Return how often a mesh surrounds a point: 1 inside a solid that faces outwards, 0 outside, between when open.

    The solid angles of the triangles (van Oosterom and Strackee 1983) over 4π.
    """
    total = 0.0
    seen = positions.T - point[:, None]
    distances = np.sqrt((seen * seen).sum(axis=0))
    for start in range(0, len(faces), CHUNK):
        corners = np.ascontiguousarray(faces[start : start + CHUNK].T)
        a, b, c = (seen[:, place] for place in corners)
        la, lb, lc = (distances[place] for place in corners)
        volume = a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2])
        volume += a[2] * (b[0] * c[1] - b[1] * c[0])
        ab, bc, ca = ((one * other).sum(axis=0) for one, other in ((a, b), (b, c), (c, a)))
        total += float(np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb).sum())
    return total / (2 * math.pi)
