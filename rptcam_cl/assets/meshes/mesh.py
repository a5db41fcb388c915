"""A triangle mesh as it is held in memory, and how it is made from what a file says."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes.clean import CHUNK, Dropped, sound_faces, used_vertices
from rptcam_cl.assets.meshes.faces import Polygons
from rptcam_cl.core.errors import InputError

Vectors = NDArray[np.float64]


def smooth_normals(positions: NDArray[np.float32], faces: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return the unit normals (n, 3) of vertices: the mean of the triangles round each, weighted by their angles there.

    Vertices of equal position count as one, so seams of texture coordinates do not show (Thürmer and Wüthrich 1998).
    """
    corner = _same_position(positions)
    sums = np.zeros((3, int(corner.max()) + 1))
    anyone = np.zeros_like(sums)
    columns = np.ascontiguousarray(positions.T)
    for start in range(0, len(faces), CHUNK):
        vertices = np.ascontiguousarray(faces[start : start + CHUNK].T)
        angles, normal = _angles_and_normal(*(columns[:, place].astype(np.float64) for place in vertices))
        for place, angle in zip(corner[vertices], angles, strict=True):
            anyone[:, place] = normal
            for axis in range(3):
                np.add.at(sums[axis], place, angle * normal[axis])
    # Triangles cancel where both sides of a sheet share its vertices: one of the two sides is as good as the other.
    cancelled = (sums * sums).sum(axis=0) < 1e-18
    sums[:, cancelled] = anyone[:, cancelled]
    unit: NDArray[np.float32] = (sums / np.sqrt((sums * sums).sum(axis=0))).T.astype(np.float32)
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


def _angles_and_normal(a: Vectors, b: Vectors, c: Vectors) -> tuple[Vectors, Vectors]:
    """Return the angles [rad] at the three corners (3, m), and the unit normal (3, m), of triangles a, b, c (3, m)."""
    ab, bc, ca = b - a, c - b, a - c
    normal = np.stack([ab[1] * bc[2] - ab[2] * bc[1], ab[2] * bc[0] - ab[0] * bc[2], ab[0] * bc[1] - ab[1] * bc[0]])
    twice_area = np.sqrt((normal * normal).sum(axis=0))
    cosines = np.stack([-(ca * ab).sum(axis=0), -(ab * bc).sum(axis=0), -(bc * ca).sum(axis=0)])
    return np.arctan2(twice_area, cosines), normal / twice_area


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
        """Return the mesh with the normals that a mode asks for, sharing all other arrays; `auto` leaves them."""
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
