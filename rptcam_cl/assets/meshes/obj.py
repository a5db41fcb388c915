"""Wavefront OBJ files: polygons with texture coordinates and normals, and the materials they name."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes.contents import Draft, Find, open_mesh
from rptcam_cl.assets.meshes.faces import Polygons, as_triangles, different_rows
from rptcam_cl.assets.meshes.file_material import FileMaterial
from rptcam_cl.assets.meshes.mesh import MeshSurface
from rptcam_cl.assets.meshes.mtl import read_mtl
from rptcam_cl.assets.meshes.obj_lines import Block, KeywordLines, begins_word, blocks, numbers_of_lines, parsed
from rptcam_cl.core.errors import InputError

Counts = tuple[int, int, int]

# Which indices a corner has, by its number of slashes and whether two of them follow each other.
FORMS = {(0, False): [0], (1, False): [0, 1], (2, True): [0, 2], (2, False): [0, 1, 2]}
KINDS = ("vertex", "texture coordinate", "normal")
MISSING = -1


class FaceLines:
    """The faces of one material.

    Corners are rows (n, 3) of indices that count from 0, `MISSING` where a corner has no texture coordinate or normal;
    sizes are the numbers of corners of the faces, and lines where it stands.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.corners: list[NDArray[np.int32]] = []
        self.sizes: list[NDArray[np.int32]] = []
        self.lines: list[NDArray[np.int32]] = []

    def add(self, lines: KeywordLines, before: NDArray[np.int64]) -> None:
        """Add lines.

        Parameters
        ----------
        lines : KeywordLines
        before : (n, 3) array
            How many positions, texture coordinates and normals the file has before each line.
        """
        sizes = lines.words
        corners = _alike(lines)
        if corners is None:
            single = [(number, line.split()) for number, line in lines.singly()]
            sizes = np.array([len(words) for _, words in single], np.int64)
            corners = np.array([self._corner(word, number) for number, words in single for word in words], np.int64)
        if (sizes < 3).any():
            small = int(np.argmax(sizes < 3))
            place = f"{self.path}:{lines.numbers[small]}"
            raise InputError(f"{place}: is a face of {sizes[small]} corners (allowed: at least 3)")
        self.corners.append(self._counted_from_0(corners, np.repeat(before, sizes, axis=0), lines.numbers, sizes))
        self.sizes.append(sizes.astype(np.int32))
        self.lines.append(lines.numbers.astype(np.int32))

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
        self,
        corners: NDArray[np.int64],
        before: NDArray[np.int64],
        numbers: NDArray[np.int64],
        sizes: NDArray[np.int64],
    ) -> NDArray[np.int32]:
        """Return indices that count from 0; negative ones count back from the last row before the face."""
        negative = corners < 0
        result = corners - 1
        if negative.any():
            result[negative] = (corners + before)[negative]
            wrong = negative & (result < 0)
            if wrong.any():
                row, kind = (int(place) for place in np.argwhere(wrong)[0])
                number = int(np.repeat(numbers, sizes)[row])
                raise self._not_there(number, kind, corners[row, kind], int(before[row, kind]))
        return np.minimum(result, np.iinfo(np.int32).max).astype(np.int32)

    def _not_there(self, number: int, kind: int, index: int, count: int) -> InputError:
        allowed = f"1 to {count}, or -1 to -{count}" if count else "none, there are no such lines"
        return InputError(
            f"{self.path}:{number}: names a {KINDS[kind]} that is not there (got {index}; allowed: {allowed})"
        )

    def checked(self, counts: Counts) -> NDArray[np.int32]:
        """Return all corners (n, 3), after checking that they name rows of the whole file."""
        corners = np.concatenate(self.corners)
        self.corners = [corners]
        for kind, count in enumerate(counts):
            wrong = corners[:, kind] >= count
            if wrong.any():
                row = int(np.argmax(wrong))
                numbers = np.repeat(np.concatenate(self.lines), np.concatenate(self.sizes))
                raise self._not_there(numbers[row], kind, corners[row, kind] + 1, count)
        return corners


def _alike(lines: KeywordLines) -> NDArray[np.int64] | None:
    """Return the indices as written when all corners of some lines have the same form, None otherwise."""
    octets = np.frombuffer(lines.text, np.uint8)
    begins = np.flatnonzero(begins_word(octets))
    count = len(begins)
    slashes = np.bincount(np.searchsorted(begins, np.flatnonzero(octets == ord("/")), "right"), minlength=count + 1)[1:]
    doubles = lines.text.count(b"//")
    if not count or (slashes != slashes[0]).any() or doubles not in (0, count):
        return None
    columns = FORMS.get((int(slashes[0]), doubles > 0))
    if columns is None:
        return None
    numbers = parsed(lines.text.replace(b"/", b" "))
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
) -> MeshSurface:
    """Return the surface of some faces, with a vertex for each different corner."""
    corners = faces.checked((len(positions), len(uvs), len(normals)))
    has_uvs, has_normals = (bool((corners[:, kind] != MISSING).any()) for kind in (1, 2))
    own, vertices = _different(corners, (len(positions), len(uvs), len(normals)))
    polygons = _polygons(vertices, np.concatenate(faces.sizes), np.concatenate(faces.lines))
    places = positions[own[:, 0]]
    return MeshSurface(
        places,
        as_triangles(places, polygons, f"{faces.path}: the face of line"),
        _rows(normals, own[:, 2]) if has_normals else None,
        _rows(uvs, own[:, 1]) if has_uvs else None,
        material,
        name,
    )


def _different(corners: NDArray[np.int32], counts: Counts) -> tuple[NDArray[np.int32], NDArray[Any]]:
    """Return the corners (n, 3) that differ, and for each corner its place among them."""
    first = corners[:, 0]
    aligned = [bool((column == first).all()) for column in corners[:, 1:].T]
    missing = [bool((column == MISSING).all()) for column in corners[:, 1:].T]
    if len(corners) < counts[0] or not all(same or none for same, none in zip(aligned, missing, strict=True)):
        kept, vertices = different_rows([corners[:, kind] for kind in range(3)])
        return corners[kept], vertices
    # Nothing to tell apart: the usual file of a single piece, which names everything by the same number.
    own = np.full((counts[0], 3), MISSING, np.int32)
    own[:, 0] = np.arange(counts[0])
    for kind in (1, 2):
        if aligned[kind - 1]:
            both = min(counts[0], counts[kind])
            own[:both, kind] = own[:both, 0]
    return own, first


def _rows(table: NDArray[np.float64], indices: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return rows of a table, zeros where a corner has none."""
    found = table[np.maximum(indices, 0)]
    found[indices == MISSING] = 0
    return found


def _polygons(vertices: NDArray[Any], sizes: NDArray[np.int32], lines: NDArray[np.int32]) -> list[Polygons]:
    if (sizes == sizes[0]).all():
        return [Polygons(lines, vertices.reshape(len(sizes), -1))]
    starts = np.cumsum(sizes, dtype=np.int64) - sizes
    found = []
    for size in np.unique(sizes):
        rows = np.flatnonzero(sizes == size)
        found.append(Polygons(lines[rows], vertices[starts[rows, None] + np.arange(size)]))
    return found


COLUMNS = {b"v": (3, "a vertex"), b"vt": (1, "a texture coordinate"), b"vn": (3, "a normal")}


class ObjReader:
    """Collects what the lines of an OBJ file say."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: dict[bytes, list[NDArray[np.float64]]] = {key: [] for key in COLUMNS}
        self.counts = dict.fromkeys(COLUMNS, 0)
        self.libraries: list[tuple[int, str]] = []
        self.faces: dict[str | None, FaceLines] = {}
        self.material: str | None = None

    def read(self, file: BinaryIO) -> None:
        """Read all lines."""
        for block in blocks(file):
            self._faces(block)
            for word in COLUMNS:
                self._numbers(word, block.of(word))

    def _faces(self, block: Block) -> None:
        """Add the faces of a block, those between two changes of material together."""
        faces = block.of(b"f")
        before = [self.counts[word] + block.before(word, faces.numbers) for word in COLUMNS]
        done = 0
        for number, name in self._changes(block):
            end = int(np.searchsorted(faces.numbers, number))
            self._add(faces.part(done, end), np.stack(before, axis=1)[done:end])
            self.material, done = name, end
        self._add(faces.part(done, len(faces.numbers)), np.stack(before, axis=1)[done:])

    def _add(self, lines: KeywordLines, before: NDArray[np.int64]) -> None:
        if len(lines.numbers):
            self.faces.setdefault(self.material, FaceLines(self.path)).add(lines, before)

    def _changes(self, block: Block) -> Iterator[tuple[int, str | None]]:
        """Yield the places where the material changes, and its names; note libraries on the way."""
        for number, line in block.others():
            word, rest = (*line.split(None, 1), b"", b"")[:2]
            if word == b"usemtl":
                yield number, _text(rest) or None
            elif word == b"mtllib":
                self.libraries.append((number, _text(rest)))

    def _numbers(self, word: bytes, lines: KeywordLines) -> None:
        if not len(lines.numbers):
            return
        each, what = COLUMNS[word]
        if word == b"vt":
            each = max(1, min(2, int(lines.words.min())))
        width = int(lines.words[0])
        found = parsed(lines.text) if (lines.words == width).all() and width >= each else None
        if found is not None and len(found) == width * len(lines.numbers):
            found = found.reshape(-1, width)[:, :each]
        else:
            found = numbers_of_lines(lines.singly(), each, what, self.path)
        if each == 1:
            found = np.column_stack([found, np.zeros(len(found))])
        self.rows[word].append(_narrow(found))
        self.counts[word] += len(found)

    def table(self, word: bytes) -> NDArray[np.float64]:
        """Return all rows of a keyword."""
        width = 2 if word == b"vt" else 3
        return np.concatenate(self.rows[word]) if self.rows[word] else np.empty((0, width))


def read_obj(path: Path, find: Find) -> Draft:
    """Return the surfaces of an OBJ file, one for each material, and the materials of its libraries.

    Raises
    ------
    InputError
        When a line cannot be read, a face names what is not there, or there are no faces.
    """
    reader = ObjReader(path)
    with open_mesh(path) as file:
        reader.read(file)
    if not reader.faces:
        raise InputError(f"{path}: has no faces (allowed: lines such as 'f 1 2 3')")
    materials: dict[str, FileMaterial] = {}
    notes: list[str] = []
    grey = False  # stands for materials of a library that is missing
    for number, name in reader.libraries:
        try:
            library = find(Path(name))
        except InputError as problem:
            grey = True
            notes.append(f"{path}:{number}: mtllib {name} is left out: {problem}; grey stands for its materials")
        else:
            materials |= read_mtl(library)
    positions, uvs, normals = (reader.table(word) for word in (b"v", b"vt", b"vn"))
    surfaces: list[MeshSurface] = []
    used: list[FileMaterial] = []
    for name_, faces in reader.faces.items():
        place = None
        if materials or grey:
            place = len(used)
            used.append(_named(materials, name_, path, grey=grey))
        surfaces.append(surface_of(faces, positions, uvs, normals, place, name_))
    return Draft(surfaces, used, notes=notes)


def _named(materials: dict[str, FileMaterial], name: str | None, path: Path, *, grey: bool) -> FileMaterial:
    """Return a material by its name; faces without one are grey, and where a library is missing those of others."""
    if name is None or (grey and name not in materials):
        return FileMaterial(matte=True)
    if name not in materials:
        raise InputError(f"{path}: usemtl {name}: names no material (allowed: {', '.join(list(materials)[:24])})")
    return materials[name]


def _text(line: bytes) -> str:
    return line.decode("utf-8", "replace").strip()


def _narrow(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rows that do not keep a wider table alive."""
    return np.ascontiguousarray(rows)
