"""Wavefront OBJ files: polygons with texture coordinates and normals, and the materials they name."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.errors import InputError
from rptcam_cl.mesh_files.contents import Draft
from rptcam_cl.mesh_files.find import Find, open_mesh
from rptcam_cl.mesh_files.looks import Look
from rptcam_cl.mesh_files.mesh import Surface
from rptcam_cl.mesh_files.mtl import read_mtl
from rptcam_cl.mesh_files.obj_blocks import Block, KeywordLines, blocks
from rptcam_cl.mesh_files.obj_faces import FaceLines, surface_of
from rptcam_cl.mesh_files.text_numbers import numbers_of_lines, parsed

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
    looks: dict[str, Look] = {}
    notes: list[str] = []
    for number, name in reader.libraries:
        try:
            library = find(Path(name))
        except InputError as problem:
            notes.append(f"{path}:{number}: mtllib {name} is left out: {problem}")
        else:
            looks |= read_mtl(library)
    positions, uvs, normals = (reader.table(word) for word in (b"v", b"vt", b"vn"))
    surfaces: list[Surface] = []
    used: list[Look] = []
    for name_, faces in reader.faces.items():
        place = None
        if looks:
            place = len(used)
            used.append(_look(looks, name_, path))
        surfaces.append(surface_of(faces, positions, uvs, normals, place, name_))
    return Draft(surfaces, used, notes=notes)


def _look(looks: dict[str, Look], name: str | None, path: Path) -> Look:
    """Return a material by its name; faces without one are grey."""
    if name is None:
        return Look(matte=True)
    if name not in looks:
        raise InputError(f"{path}: usemtl {name}: names no material (allowed: {', '.join(list(looks)[:24])})")
    return looks[name]


def _text(line: bytes) -> str:
    return line.decode("utf-8", "replace").strip()


def _narrow(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rows that do not keep a wider table alive."""
    return np.ascontiguousarray(rows)
