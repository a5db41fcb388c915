"""Faces of OBJ files: corners that name a position, a texture coordinate and a normal each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.errors import InputError
from rptcam_cl.mesh_files.faces import Polygons, as_triangles
from rptcam_cl.mesh_files.mesh import Surface
from rptcam_cl.mesh_files.text_numbers import Line, parsed
from rptcam_cl.mesh_files.welding import different_rows

Counts = tuple[int, int, int]
# Which indices a corner has, by its number of slashes and whether two of them follow each other.
FORMS = {(0, False): [0], (1, False): [0, 1], (2, True): [0, 2], (2, False): [0, 1, 2]}
KINDS = ("vertex", "texture coordinate", "normal")
MISSING = -1


class FaceLines:
    """The faces of one material.

    Corners are rows (n, 3) of indices that count from 0, `MISSING` where a corner has no texture coordinate or normal;
    sizes tell how many corners each face has, and lines where it stands.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.corners: list[NDArray[np.int32]] = []
        self.sizes: list[NDArray[np.int64]] = []
        self.lines: list[NDArray[np.int64]] = []

    def add(self, lines: list[Line], counts: Counts) -> None:
        """Add lines without their keyword; counts of positions, texture coordinates and normals before them."""
        corners = _alike(lines)
        if corners is None:
            corners = np.array(
                [self._corner(word, number) for number, text in lines for word in text.split()], np.int64
            ).reshape(-1, 3)
        sizes = np.array([len(text.split()) for _, text in lines], np.int64)
        numbers = np.array([number for number, _ in lines], np.int64)
        if (small := int(np.argmin(sizes))) >= 0 and sizes[small] < 3:
            raise InputError(f"{self.path}:{numbers[small]}: is a face of {sizes[small]} corners (allowed: at least 3)")
        self.corners.append(self._counted_from_0(corners, counts, np.repeat(numbers, sizes)))
        self.sizes.append(sizes)
        self.lines.append(numbers)

    def _corner(self, word: bytes, number: int) -> list[int]:
        """Return the three indices of a corner as written, 0 for those that are left out."""
        parts = word.split(b"/")
        try:
            if not 1 <= len(parts) <= 3 or (len(parts) > 1 and not parts[-1]):
                raise ValueError
            found = [int(part) if part else 0 for part in parts]
            zeros = (part and not index for part, index in zip(parts, found, strict=True))
            if not parts[0] or any(zeros) or max(map(abs, found)) > 2**31:
                raise ValueError
        except ValueError:
            got = word.decode("latin-1")[:40]
            allowed = "v, v/vt, v//vn or v/vt/vn, of whole numbers that count from 1, or from -1 backwards"
            place = f"{self.path}:{number}"
            raise InputError(f"{place}: is not a corner of a face (got {got!r}; allowed: {allowed})") from None
        return found + [0] * (3 - len(found))

    def _counted_from_0(
        self, corners: NDArray[np.int64], counts: Counts, numbers: NDArray[np.int64]
    ) -> NDArray[np.int32]:
        """Return indices that count from 0; negative ones count back from the last row before the face."""
        result = np.where(corners < 0, corners + np.array(counts), corners - 1)
        wrong = (corners < 0) & (result < 0)
        if wrong.any():
            row, kind = (int(place) for place in np.argwhere(wrong)[0])
            raise self._not_there(numbers[row], kind, corners[row, kind], counts[kind])
        return np.minimum(result, np.iinfo(np.int32).max).astype(np.int32)

    def _not_there(self, number: int, kind: int, index: int, count: int) -> InputError:
        allowed = f"1 to {count}, or -1 to -{count}" if count else "none, there are no such lines"
        return InputError(
            f"{self.path}:{number}: names a {KINDS[kind]} that is not there (got {index}; allowed: {allowed})"
        )

    def checked(self, counts: Counts) -> NDArray[np.int32]:
        """Return all corners (n, 3), after checking that they name rows of the whole file."""
        corners = np.concatenate(self.corners)
        for kind, count in enumerate(counts):
            wrong = corners[:, kind] >= count
            if wrong.any():
                row = int(np.argmax(wrong))
                numbers = np.repeat(np.concatenate(self.lines), np.concatenate(self.sizes))
                raise self._not_there(numbers[row], kind, corners[row, kind] + 1, count)
        return corners


def _alike(lines: list[Line]) -> NDArray[np.int64] | None:
    """Return the indices as written when all corners of some lines have the same form, None otherwise."""
    text = b" ".join(line for _, line in lines)
    words = text.split()
    count = len(words)
    slashes = {word.count(b"/") for word in words}
    doubles = text.count(b"//")
    if len(slashes) != 1 or doubles not in (0, count):
        return None
    columns = FORMS.get((slashes.pop(), doubles > 0))
    if columns is None:
        return None
    numbers = parsed(text.replace(b"/", b" "))
    if numbers is None or len(numbers) != count * len(columns):
        return None
    if not (np.abs(numbers) <= 2**31).all() or (numbers != np.floor(numbers)).any() or (numbers == 0).any():
        return None
    corners = np.zeros((count, 3), np.int64)
    corners[:, columns] = numbers.reshape(-1, len(columns))
    return corners


def surface_of(
    faces: FaceLines,
    positions: NDArray[np.float64],
    uvs: NDArray[np.float64],
    normals: NDArray[np.float64],
    material: int | None,
    name: str | None,
) -> Surface:
    """Return the surface of some faces, with a vertex for each different corner."""
    corners = faces.checked((len(positions), len(uvs), len(normals)))
    has_uvs, has_normals = (bool((corners[:, kind] != MISSING).any()) for kind in (1, 2))
    kept, vertices = different_rows([corners[:, kind] for kind in range(3)])
    polygons = _polygons(vertices, np.concatenate(faces.sizes), np.concatenate(faces.lines))
    own = corners[kept]
    places = positions[own[:, 0]]
    return Surface(
        places,
        as_triangles(places, polygons, f"{faces.path}: the face of line"),
        _rows(normals, own[:, 2]) if has_normals else None,
        _rows(uvs, own[:, 1]) if has_uvs else None,
        material,
        name,
    )


def _rows(table: NDArray[np.float64], indices: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return rows of a table, zeros where a corner has none."""
    found = table[np.maximum(indices, 0)]
    found[indices == MISSING] = 0
    return found


def _polygons(vertices: NDArray[np.intp], sizes: NDArray[np.int64], lines: NDArray[np.int64]) -> list[Polygons]:
    starts = np.cumsum(sizes) - sizes
    found = []
    for size in np.unique(sizes):
        rows = np.flatnonzero(sizes == size)
        found.append(Polygons(lines[rows], vertices[starts[rows, None] + np.arange(size)]))
    return found
