"""Triangles that no renderer can use: they are dropped and counted."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

# Triangles looked at together, so that the float64 working arrays stay small.
CHUNK = 1 << 17


class Dropped(NamedTuple):
    """How many triangles were dropped, by reason."""

    not_finite: int = 0
    no_area: int = 0
    duplicate: int = 0

    def plus(self, other: Dropped) -> Dropped:
        """Return the sum by reason."""
        return Dropped(*(mine + its for mine, its in zip(self, other, strict=True)))

    def __str__(self) -> str:
        reasons = {"with a vertex that is not finite": self.not_finite, "without area": self.no_area}
        parts = [f"{count} {reason}" for reason, count in {**reasons, "given twice": self.duplicate}.items() if count]
        return ", ".join(parts) or "none"


NOTHING_DROPPED = Dropped()


def sound_faces(positions: NDArray[np.float32], faces: NDArray[Any]) -> tuple[NDArray[np.int32], Dropped]:
    """Return the faces (m, 3) that have finite vertices, an area and no earlier copy, and the count of the others.

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
    return faces, Dropped(not_finite, no_area, len(copies))


def _without_area(positions: NDArray[np.float32], faces: NDArray[np.int32]) -> NDArray[np.bool_]:
    flat = np.zeros(len(faces), bool)
    x, y, z = np.ascontiguousarray(positions.T, np.float64)
    for start in range(0, len(faces), CHUNK):
        a, b, c = np.ascontiguousarray(faces[start : start + CHUNK].T)
        ux, uy, uz = x[b] - x[a], y[b] - y[a], z[b] - z[a]
        vx, vy, vz = x[c] - x[a], y[c] - y[a], z[c] - z[a]
        flat[start : start + CHUNK] = (uy * vz == uz * vy) & (uz * vx == ux * vz) & (ux * vy == uy * vx)
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
        keys = _mixed(keys ^ bits)
    return keys


def _face_keys(vertex_keys: NDArray[np.uint64], faces: NDArray[np.int32]) -> NDArray[np.uint64]:
    """Return 64 bits for each face that do not depend on which corner comes first, but on the order round."""
    result = np.empty(len(faces), np.uint64)
    for start in range(0, len(faces), CHUNK):
        a, b, c = vertex_keys[faces[start : start + CHUNK]].T
        result[start : start + CHUNK] = (
            _mixed(a ^ (b << np.uint64(1))) + _mixed(b ^ (c << np.uint64(1))) + _mixed(c ^ (a << np.uint64(1)))
        )
    return result


def _mixed(keys: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return well mixed bits (the finaliser of SplitMix64; Steele, Lea and Flood 2014)."""
    keys = keys + np.uint64(0x9E3779B97F4A7C15)
    keys = (keys ^ (keys >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    keys = (keys ^ (keys >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(keys ^ (keys >> np.uint64(31)))


def used_vertices(count: int, faces: NDArray[np.int32]) -> tuple[NDArray[np.intp] | None, NDArray[np.int32]]:
    """Return the vertices that faces use, None when they use all, and the faces with indices into those."""
    used = np.zeros(count, bool)
    used[faces.ravel()] = True
    if used.all():
        return None, faces
    kept = np.flatnonzero(used)
    place = np.empty(count, np.int32)
    place[kept] = np.arange(len(kept), dtype=np.int32)
    return kept, place[faces]
