"""A triangle mesh in memory, made from what a file says: polygons, normals, colours of vertices."""

from __future__ import annotations

import hashlib
import io
import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import field, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, BinaryIO, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import name_errors, open_regular
from rptcam_cl.scene.assets.pictures import LARGEST_PIXELS
from rptcam_cl.scene.file_materials import FileMaterial, FileTexture
from rptcam_cl.scene.quantities import LARGEST_COORDINATE, SMALLEST_LENGTH

# Triangles that no renderer can use: they are dropped and counted.

# Triangles looked at together, so that the float64 working arrays stay small.
_CHUNK = 1 << 17


NOT_FINITE, NO_AREA, TWICE = "with a vertex that is not finite", "without area", "given twice"


def _count_text(dropped: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {reason}" for reason, count in dropped.items() if count) or "none"


def sound_faces(positions: NDArray[np.float32], faces: NDArray[Any]) -> tuple[NDArray[np.int32], dict[str, int]]:
    """The faces (m, 3) that have finite vertices, an area and no earlier copy, and how many others, by reason.

    An area is zero when the cross product of two edges is, in float64, which is exact for most float32 corners. A copy
    has the same corners in the same order round; the same corners the other way round are another face.
    """
    faces = np.ascontiguousarray(faces, np.int32)
    finite: NDArray[np.bool_] = np.all(np.isfinite(positions), axis=1)
    not_finite = 0
    if not finite.all():
        good: NDArray[np.bool_] = np.all(finite[faces], axis=1)
        not_finite = len(faces) - int(np.count_nonzero(good))
        faces = np.compress(good, faces, axis=0)
    flat = _without_area(positions, faces)
    no_area = int(np.count_nonzero(flat))
    if no_area:
        faces = faces[~flat]
    copies = _copies(positions, faces)
    if len(copies):
        faces = np.delete(faces, copies, axis=0)
    return faces, {NOT_FINITE: not_finite, NO_AREA: no_area, TWICE: len(copies)}


def _without_area(positions: NDArray[np.float32], faces: NDArray[np.int32]) -> NDArray[np.bool_]:
    flat = np.zeros(len(faces), bool)
    x, y, z = np.ascontiguousarray(positions.T, np.float64)
    for start in range(0, len(faces), _CHUNK):
        a, b, c = np.ascontiguousarray(faces[start : start + _CHUNK].T)
        ux, uy, uz = x[b] - x[a], y[b] - y[a], z[b] - z[a]
        vx, vy, vz = x[c] - x[a], y[c] - y[a], z[c] - z[a]
        flat[start : start + _CHUNK] = (uy * vz == uz * vy) & (uz * vx == ux * vz) & (ux * vy == uy * vx)
    return flat


def _copies(positions: NDArray[np.float32], faces: NDArray[np.int32]) -> NDArray[np.intp]:
    """Return the indices of faces whose corners, in their order round, are those of an earlier face."""
    keys = _face_keys(_vertex_keys(positions), faces)
    ordered = np.sort(keys)
    repeated = ordered[1:][ordered[1:] == ordered[:-1]]
    if not len(repeated):
        return np.empty(0, np.intp)
    suspects = np.flatnonzero(np.isin(keys, repeated))
    corners = positions[faces[suspects]] + np.float32(0)  # -0 becomes 0
    lowest = np.lexsort([corners[:, :, axis] for axis in (2, 1, 0)], axis=1)[:, 0]
    turned = corners[np.arange(len(corners))[:, None], (lowest[:, None] + np.arange(3)) % 3].reshape(-1, 9)
    _, first = np.unique(turned, axis=0, return_index=True)
    return np.delete(suspects, first)


def _vertex_keys(positions: NDArray[np.float32]) -> NDArray[np.uint64]:
    """Return a hash of 64 bits for each position."""
    keys = np.zeros(len(positions), np.uint64)
    for axis in range(3):
        bits = (positions[:, axis] + np.float32(0)).view(np.uint32)
        keys = _mix_bits(keys ^ bits)
    return keys


def distinct_rows(rows: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Find equal rows, by a hash of 64 bits.

    Returns
    -------
    first : (m,) array of int
        The first row of each content, in the order in which they come.
    numbers : (n,) array of int
        Which of them each row is.
    """
    keys = np.zeros(len(rows), np.uint64)
    for column in np.ascontiguousarray(rows.T):
        keys = _mix_bits(keys ^ (column + 0.0).view(np.uint64))
    _, first, numbers = np.unique(keys, return_index=True, return_inverse=True)
    order = np.argsort(first)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return first[order], place[numbers]


def _face_keys(vertex_keys: NDArray[np.uint64], faces: NDArray[np.int32]) -> NDArray[np.uint64]:
    """Return 64 bits for each face that do not depend on which corner comes first, but on the order round."""
    result = np.empty(len(faces), np.uint64)
    for start in range(0, len(faces), _CHUNK):
        a, b, c = vertex_keys[faces[start : start + _CHUNK]].T
        result[start : start + _CHUNK] = (
            _mix_bits(a ^ (b << np.uint64(1))) + _mix_bits(b ^ (c << np.uint64(1))) + _mix_bits(c ^ (a << np.uint64(1)))
        )
    return result


def _mix_bits(keys: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return well mixed bits (the finaliser of SplitMix64; Steele, Lea and Flood 2014)."""
    keys = keys + np.uint64(0x9E3779B97F4A7C15)
    keys = (keys ^ (keys >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    keys = (keys ^ (keys >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(keys ^ (keys >> np.uint64(31)))


def _used_vertices(count: int, faces: NDArray[np.int32]) -> tuple[NDArray[np.intp] | None, NDArray[np.int32]]:
    """Return the vertices that faces use, None when they use all, and the faces with indices into those."""
    used = np.zeros(count, bool)
    used[faces.ravel()] = True
    if used.all():
        return None, faces
    kept = np.flatnonzero(used)
    place = np.empty(count, np.int32)
    place[kept] = np.arange(len(kept), dtype=np.int32)
    return kept, place[faces]


# Normals of vertices: those of a file at unit length, or the mean of the triangles round each vertex.

Vectors = NDArray[np.float64]


def _smooth_normals(positions: NDArray[np.float32], faces: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return the unit normals (n, 3) of vertices: the mean of the triangles round each, weighted by their angles there.

    Vertices of equal position count as one, so seams of texture coordinates do not show (Thürmer and Wüthrich 1998).
    """
    _, corner = different_rows(list(positions.T))
    sums = np.zeros((3, int(corner.max()) + 1))
    anyone = np.zeros_like(sums)
    columns = np.ascontiguousarray(positions.T)
    for start in range(0, len(faces), _CHUNK):
        vertices = np.ascontiguousarray(faces[start : start + _CHUNK].T)
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


def _unit_normals(
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
        result[missing] = _smooth_normals(positions, faces)[missing]
    return result


def _angles_and_normal(a: Vectors, b: Vectors, c: Vectors) -> tuple[Vectors, Vectors]:
    """Return the angles [rad] at the three corners (3, m), and the unit normal (3, m), of triangles a, b, c (3, m)."""
    ab, bc, ca = b - a, c - b, a - c
    normal = np.stack([ab[1] * bc[2] - ab[2] * bc[1], ab[2] * bc[0] - ab[0] * bc[2], ab[0] * bc[1] - ab[1] * bc[0]])
    twice_area = np.sqrt((normal * normal).sum(axis=0))
    cosines = np.stack([-(ca * ab).sum(axis=0), -(ab * bc).sum(axis=0), -(bc * ca).sum(axis=0)])
    return np.arctan2(twice_area, cosines), normal / twice_area


#
# Polygons of mesh files: checked, cut into triangles, and their different corners as vertices.
#
# Convex polygons become fans, quads are cut along the diagonal inside, others by their ears.

# Corners of a polygon that is not convex; cutting ears takes time that grows with the square.
_MOST_CORNERS = 1000

Corners = NDArray[Any]


class Polygons(NamedTuple):
    """Polygons of one size, or other lists of one length.

    Attributes
    ----------
    number : (m,) int
        Their places among all faces of the file.
    corners : (m, k) int
        Vertex of each corner, or other entries.
    """

    number: NDArray[Any]
    corners: NDArray[Any]


def group_lists(lengths: NDArray[Any], starts: NDArray[np.intp], entries: NDArray[Any]) -> list[Polygons]:
    """Return lists by their length.

    Parameters
    ----------
    lengths : (n,) int
        Length of each list.
    starts : (n,) int
        Place of the first entry of each.
    entries : (e,) array
        All entries.
    """
    groups = []
    for length in np.unique(lengths):
        numbers = np.flatnonzero(lengths == length)
        groups.append(Polygons(numbers, entries[starts[numbers, None] + np.arange(length)]))
    return groups


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
    """Return the triangles (m, 3) of polygons that `check_corners` lets pass."""
    parts = []
    for polygon in polygons:
        corners = polygon.corners
        if corners.shape[1] == 3:
            parts.append(corners.astype(np.int32, copy=False))
        else:
            triangles = _triangulate(positions, polygon, face)
            rows = np.arange(len(corners))[:, None, None]
            parts.append(corners[rows, triangles].reshape(-1, 3).astype(np.int32))
    return np.concatenate(parts) if len(parts) != 1 else parts[0]


def _triangulate(positions: NDArray[Any], polygons: Polygons, face: str) -> Corners:
    """Return the triangles of polygons that have equally many corners, as places 0 to k - 1 in their polygon.

    Parameters
    ----------
    positions : (n, 3) array
    polygons : Polygons
        Their corners are indices into the positions, inside their range; they have 4 or more.
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
    bent = np.flatnonzero(~_fan_fits(positions, corners))
    if not len(bent):
        return triangles
    triangles = triangles.copy()
    if size == 4:
        triangles[bent] = [[1, 2, 3], [1, 3, 0]]
        return triangles
    if size > _MOST_CORNERS:
        raise InputError(
            f"{face} {numbers[bent[0]]} has {size} corners and is not convex (allowed: a convex one, or up to "
            f"{_MOST_CORNERS} corners)"
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
    flat = _flatten(corners)
    left = list(range(len(flat)))
    triangles: list[tuple[int, int, int]] = []
    while len(left) > 3:
        ear = _find_ear(flat[left])
        triangles.append((left[ear - 1], left[ear], left[(ear + 1) % len(left)]))
        del left[ear]
    return [*triangles, (left[0], left[1], left[2])]


def _flatten(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return corners (k, 2) seen along the axis that is nearest to the polygon's normal, counter-clockwise."""
    normal = np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)
    axis = int(np.argmax(np.abs(normal)))
    flat = corners[:, [(axis + 1) % 3, (axis + 2) % 3]]
    return flat if normal[axis] >= 0 else flat * (1, -1)


def _find_ear(ring: NDArray[np.float64]) -> int:
    """Return the place of a corner that turns left and whose triangle holds no corner that turns right.

    Others may touch its sides, as what follows them leads away. A polygon that crosses itself may have no such corner:
    then it is the one that turns least.
    """
    before, after = np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0)
    turns = _turn(before, ring, after)
    others = ring[turns < 0]
    for place in np.flatnonzero(turns > 0).tolist():
        a, b, c = before[place], ring[place], after[place]
        inside = (_turn(a, b, others) >= 0) & (_turn(b, c, others) >= 0) & (_turn(c, a, others) >= 0)
        same = (others == a).all(axis=1) | (others == b).all(axis=1) | (others == c).all(axis=1)
        if not (inside & ~same).any():
            return int(place)
    return int(np.argmin(np.abs(turns)))


def _turn(a: NDArray[np.float64], b: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return twice the signed area of the triangles a, b, point."""
    (ax, ay), (bx, by), (x, y) = (np.moveaxis(corner, -1, 0) for corner in (a, b, points))
    return np.asarray((bx - ax) * (y - ay) - (by - ay) * (x - ax))


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
    parts = np.split(vertices, np.cumsum([corners.size for _, corners in polygons])[:-1])
    groups = zip(polygons, parts, strict=True)
    return corners[kept], uvs[kept], [Polygons(numbers, part.reshape(old.shape)) for (numbers, old), part in groups]


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


# A triangle mesh as it is held in memory, and how it is made from what a file says.

NormalsMode = Literal["auto", "smooth", "flat"]

# A mesh that lies farther than this many times its size from the zero of its coordinates is moved to its own origin.
_FARTHEST_FROM_ZERO = 4


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
        normals = _freeze(_smooth_normals(self.positions, self.faces) if mode == "smooth" else None)
        content_hash = _hash(self.origin, self.positions, self.faces, normals, self.uvs)
        return replace(self, normals=normals, content_hash=content_hash)


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
    colours : (n, 3) or None
        Of the vertices, linear; they count where the surface is shown in its file's material.
    """

    positions: NDArray[Any]
    faces: NDArray[Any]
    normals: NDArray[Any] | None = None
    uvs: NDArray[Any] | None = None
    material: int | None = None
    name: str | None = None
    colours: NDArray[Any] | None = None


def _make_mesh(surface: MeshSurface, place: str) -> tuple[Mesh | None, dict[str, int]]:
    """The mesh of a surface, None when no triangle of it is sound; how many triangles were dropped, by reason.

    Parameters
    ----------
    surface : MeshSurface
    place : str
        What errors begin with: the file.
    """
    origin, positions = _centre(surface.positions, place)
    faces, dropped = sound_faces(positions, surface.faces)
    if not len(faces):
        return None, dropped
    kept, faces = _used_vertices(len(positions), faces)
    normals, uvs = surface.normals, surface.uvs
    if kept is not None:
        positions = positions[kept]
        normals, uvs = (None if rows is None else rows[kept] for rows in (normals, uvs))
    extent = float((positions.max(axis=0) - positions.min(axis=0)).max())
    if extent < SMALLEST_LENGTH:
        allowed = f"an extent of at least {SMALLEST_LENGTH:g}"
        raise InputError(f"{place}: is too small for float32 (got {extent:g}; allowed: {allowed})")
    if normals is not None:
        _check_finite(normals, kept, f"{place}: normal")
        normals = _unit_normals(normals, positions, faces)
    if uvs is not None:
        uvs = uvs.astype(np.float32)
        _check_finite(uvs, kept, f"{place}: texture coordinate")
    origin, positions, faces, normals, uvs = map(_freeze, (origin, positions, faces, normals, uvs))
    return Mesh(origin, positions, faces, normals, uvs, _hash(origin, positions, faces, normals, uvs)), dropped


def _centre(positions: NDArray[Any], place: str) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
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
    if extent == 0 or np.abs(lower + upper).max() / 2 <= _FARTHEST_FROM_ZERO * extent:
        return origin, np.ascontiguousarray(positions, np.float32)
    step = 2.0 ** np.floor(np.log2(extent))
    origin = np.round((lower + upper) / 2 / step) * step
    relative = np.empty(positions.shape, np.float32)
    for axis in range(3):
        relative[:, axis] = positions[:, axis] - origin[axis]
    return origin, relative


def _check_finite(rows: NDArray[Any], kept: NDArray[np.intp] | None, what: str) -> None:
    finite = np.isfinite(rows).all(axis=1)
    if not finite.all():
        index = int(np.argmin(finite))
        number = index if kept is None else int(kept[index])
        raise InputError(f"{what} {number} is not finite (got {rows[index].tolist()}; allowed: finite numbers)")


def _freeze(rows: NDArray[Any] | None) -> Any:
    """Return a read-only array that does not keep the data of a whole file alive."""
    if rows is not None:
        base = rows
        while isinstance(base.base, np.ndarray):
            base = base.base
        rows = rows.copy() if base.base is not None or base.nbytes > rows.nbytes else np.ascontiguousarray(rows)
        rows.setflags(write=False)
    return rows


def _hash(*arrays: NDArray[Any] | None) -> str:
    """Return the SHA-256 of arrays, some of which may be missing."""
    total = hashlib.sha256()
    for rows in arrays:
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
    for start in range(0, len(faces), _CHUNK):
        corners = np.ascontiguousarray(faces[start : start + _CHUNK].T)
        a, b, c = (seen[:, place] for place in corners)
        la, lb, lc = (distances[place] for place in corners)
        volume = a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2])
        volume += a[2] * (b[0] * c[1] - b[1] * c[0])
        ab, bc, ca = ((one * other).sum(axis=0) for one, other in ((a, b), (b, c), (c, a)))
        total += float(np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb).sum())
    return total / (2 * math.pi)


#
# Colours of vertices as a picture: two by two texels for each triangle.
#
# The corners of a triangle lie on the centres of three texels. With the fourth as the sum of two less the third,
# bilinear interpolation between them is the linear one over the triangle, so that no kernel has to know of such
# colours. Where all three fourths there could be lie outside 0 to 1, the triangle is split at the middles of its sides:
# the fourths of the parts, such as the mean of two corners, lie inside.

MOST_TRIANGLES = LARGEST_PIXELS // 4
_OUTSIDE = 1 / 1024  # of a fourth texel that counts as inside 0 to 1; codes are 1/255 apart
_WHITE = FileMaterial(base_color=(1.0, 1.0, 1.0), matte=True)  # of a file that has colours of vertices and no materials


def _paint_draft(draft: Draft, place: str) -> Draft:
    """Give a draft the colours of its vertices as pictures, each in a material of its own.

    What has a texture keeps that; so does a surface of too many triangles its one colour. Notes say so.
    """
    surfaces, materials, notes = [], list(draft.materials), list(draft.notes)
    for surface in draft.surfaces:
        material = _WHITE if surface.material is None else draft.materials[surface.material]
        what = f"{place}: " if surface.name is None else f"{place}: {surface.name}: "
        if surface.colours is None:
            pass
        elif material.has_textures and surface.uvs is not None:
            notes.append(f"{what}colours of vertices are left out beside a texture")
        elif 4 * len(surface.faces) > MOST_TRIANGLES:
            notes.append(f"{what}colours of more than {MOST_TRIANGLES // 4} triangles are left out")
        else:
            surface, texture = _paint_triangles(surface)
            surface = replace(surface, material=len(materials))
            materials.append(replace(material.without_textures(), base_texture=texture))
        surfaces.append(surface)
    return replace(draft, surfaces=surfaces, materials=materials, notes=notes)


def _paint_triangles(surface: MeshSurface) -> tuple[MeshSurface, FileTexture]:
    """Return a surface whose triangles share no vertices, and the picture that lies on it."""
    alone, texels = lay_out_colours(surface)
    return alone, FileTexture(_png(texels), "colours of vertices", wrap="clamp")


def lay_out_colours(surface: MeshSurface) -> tuple[MeshSurface, NDArray[np.float32]]:
    """Return a surface whose triangles share no vertices, and the linear texels (rows, columns, 3) that lie on it.

    The colours of its vertices are cut at 0 and 1.
    """
    surface = _split(replace(surface, colours=np.clip(np.asarray(surface.colours, np.float32), 0, 1)))
    faces = np.take_along_axis(surface.faces, (_fourths(surface)[0][:, None] + np.arange(3)) % 3, axis=1)
    assert surface.colours is not None
    corners, count = surface.colours[faces], len(faces)
    columns = math.ceil(math.sqrt(count))
    rows = math.ceil(count / columns)
    blocks = np.zeros((rows * columns, 2, 2, 3), np.float32)
    blocks[:count, 0, 0], blocks[:count, 0, 1], blocks[:count, 1, 0] = corners[:, 0], corners[:, 1], corners[:, 2]
    blocks[:count, 1, 1] = np.clip(corners[:, 1] + corners[:, 2] - corners[:, 0], 0, 1)
    texels = blocks.reshape(rows, columns, 2, 2, 3).swapaxes(1, 2).reshape(2 * rows, 2 * columns, 3)
    place = np.arange(count)
    left, top = 2 * (place % columns) + 0.5, 2 * (place // columns) + 0.5
    u = np.stack([left, left + 1, left], axis=1) / (2 * columns)
    v = 1 - np.stack([top, top, top + 1], axis=1) / (2 * rows)
    flat = faces.ravel()
    alone = replace(
        surface,
        positions=surface.positions[flat],
        faces=np.arange(3 * count).reshape(-1, 3),
        normals=None if surface.normals is None else surface.normals[flat],
        uvs=np.column_stack([u.ravel(), v.ravel()]),
        colours=None,
    )
    return alone, texels


def _fourths(surface: MeshSurface) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Return the corner of each triangle whose fourth texel lies least outside 0 to 1, and by how much."""
    assert surface.colours is not None
    corners = surface.colours[surface.faces]
    fourth = corners.sum(axis=1, keepdims=True) - 2 * corners
    outside = np.abs(fourth - np.clip(fourth, 0, 1)).max(axis=2)
    return np.argmin(outside, axis=1), outside.min(axis=1)


def _split(surface: MeshSurface) -> MeshSurface:
    """Return a surface whose triangles all have a fourth texel."""
    wide = _fourths(surface)[1] > _OUTSIDE
    if not wide.any():
        return surface
    a, b, c = np.asarray(surface.faces)[wide].T
    sides = np.sort(np.stack([np.concatenate([a, b, c]), np.concatenate([b, c, a])], axis=1), axis=1)
    ends, of = np.unique(sides, axis=0, return_inverse=True)
    ab, bc, ca = of.reshape(3, -1) + len(surface.positions)
    parts = np.concatenate([np.stack(part, axis=1) for part in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])

    def with_middles(rows: NDArray[Any] | None) -> NDArray[Any] | None:
        return None if rows is None else np.concatenate([rows, (rows[ends[:, 0]] + rows[ends[:, 1]]) / 2])

    return replace(
        surface,
        positions=np.concatenate([surface.positions, surface.positions[ends].mean(axis=1, dtype=np.float64)]),
        faces=np.concatenate([np.asarray(surface.faces)[~wide], parts]),
        normals=with_middles(surface.normals),
        colours=with_middles(surface.colours),
    )


def _png(linear: NDArray[np.float32]) -> bytes:
    import PIL.Image

    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    stream = io.BytesIO()
    PIL.Image.fromarray(np.round(255 * encoded).astype(np.uint8)).save(stream, "PNG", compress_level=1)
    return stream.getvalue()


# What a mesh file holds: surfaces, their materials, where each is placed, and the further files it names.


@dataclass(frozen=True, eq=False)
class MeshPlacement:
    """A mesh at its place in the file, or in a scene.

    Attributes
    ----------
    mesh : Mesh
    placement : (4, 4) float64
        From the mesh's coordinates, its origin included, to the file's, or to the world.
    material : FileMaterial or None
        None where the file does not say; in a scene its material.
    name : str or None
    """

    mesh: Mesh
    placement: NDArray[np.float64]
    material: Any = None  # FileMaterial, or Material
    name: str | None = None

    def corners(self) -> NDArray[np.float64]:
        """Return the eight corners (8, 3) of the mesh's bounds, placed."""
        corners = np.array(list(product(*zip(*self.mesh.bounds(), strict=True))))
        return np.asarray(corners @ self.placement[:3, :3].T + self.placement[:3, 3])


@dataclass(frozen=True, eq=False)
class MeshContents:
    """Everything that a mesh file holds.

    Attributes
    ----------
    parts : tuple of MeshPlacement
    notes : tuple of str
        What of the file is left out, triangles included.
    """

    parts: tuple[MeshPlacement, ...]
    notes: tuple[str, ...] = ()

    def with_normals(self, mode: NormalsMode) -> MeshContents:
        """Return the contents with the normals of a mode; parts that shared a mesh still do."""
        if mode == "auto":
            return self
        return self.with_meshes({mesh: mesh.with_normals(mode) for mesh in {part.mesh for part in self.parts}})

    def sharing(self, known: dict[str, Mesh]) -> MeshContents:
        """Return the contents with meshes that are known by their hash in place of equal ones; others become known."""
        meshes = {part.mesh for part in self.parts}
        return self.with_meshes({mesh: known.setdefault(mesh.content_hash, mesh) for mesh in meshes})

    def with_meshes(self, changed: dict[Mesh, Mesh]) -> MeshContents:
        """Return the contents with other meshes in place of theirs."""
        return replace(self, parts=tuple(replace(part, mesh=changed[part.mesh]) for part in self.parts))


LAMPS_LEFT_OUT = "lamps are left out of an object; `rptcam new` makes a scene with them"  # a note of a file


Node = tuple[int, NDArray[np.float64], str | None]
"""The number of a surface, where it is in the file, and its name."""


@dataclass(frozen=True, eq=False)
class Draft:
    """What a reader finds in a file.

    Attributes
    ----------
    surfaces : list of Surface
    materials : list of FileMaterial
        What `MeshSurface.material` counts.
    nodes : list of Node
        Where the surfaces are; each at its own coordinates when empty.
    notes : list of str
        What of the file is left out.
    """

    surfaces: list[MeshSurface]
    materials: list[FileMaterial] = field(default_factory=list)
    nodes: list[Node] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def make_contents(draft: Draft, place: str, *, painted: bool = True) -> MeshContents:
    """Return the contents of a file from what its reader found.

    Parameters
    ----------
    painted
        Whether it is shown in its own materials, and so in the colours of its vertices.

    Raises
    ------
    InputError
        When no triangle is left.
    """
    if painted and any(surface.colours is not None for surface in draft.surfaces):
        draft = _paint_draft(draft, place)
    nodes = draft.nodes or [(index, np.eye(4), surface.name) for index, surface in enumerate(draft.surfaces)]
    dropped: Counter[str] = Counter()
    meshes: dict[int, Mesh | None] = {}
    for index in dict.fromkeys(index for index, _, _ in nodes):
        meshes[index], lost = _make_mesh(draft.surfaces[index], place)
        dropped.update(lost)
    parts = []
    for index, placement, name in nodes:
        if (mesh := meshes[index]) is not None:
            number = draft.surfaces[index].material
            material = None if number is None else draft.materials[number]
            if material is not None and mesh.uvs is None:
                material = material.without_textures()
            parts.append(MeshPlacement(mesh, placement, material, name))
    if not parts:
        raise InputError(f"{place}: has no triangle that can be shown (dropped: {_count_text(dropped)})")
    notes = (
        [*draft.notes, f"{place}: triangles dropped: {_count_text(dropped)}"] if any(dropped.values()) else draft.notes
    )
    return MeshContents(tuple(parts), tuple(notes))


_LARGEST_MESH = 16 << 30  # bytes

# Returns the checked path of a file given relative to the mesh file.
Find = Callable[[Path], Path]


def open_mesh(path: Path) -> BinaryIO:
    """Return a mesh file opened for reading.

    Raises
    ------
    InputError
        When it is not a regular file of bearable size.
    StateError
        When it cannot be opened.
    """
    with name_errors(path):
        return open_regular(path, _LARGEST_MESH)
