"""Wavefront OBJ files: polygons with texture coordinates and normals, and the materials they name."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.errors import InputError
from rptcam_cl.mesh_files.contents import Draft
from rptcam_cl.mesh_files.find import Find
from rptcam_cl.mesh_files.looks import Look
from rptcam_cl.mesh_files.mesh import Surface
from rptcam_cl.mesh_files.mtl import read_mtl
from rptcam_cl.mesh_files.obj_faces import FaceLines, surface_of
from rptcam_cl.mesh_files.text_numbers import Line, numbers_of_lines

CHUNK_LINES = 1 << 14
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
        for word, lines in _runs(file):
            if word in COLUMNS:
                self._numbers(word, lines)
            elif word == b"f":
                faces = self.faces.setdefault(self.material, FaceLines(self.path))
                faces.add(lines, (self.counts[b"v"], self.counts[b"vt"], self.counts[b"vn"]))
            elif word == b"usemtl":
                self.material = _text(lines[-1][1]) or None
            elif word == b"mtllib":
                self.libraries += [(number, _text(line)) for number, line in lines]

    def _numbers(self, word: bytes, lines: list[Line]) -> None:
        each, what = COLUMNS[word]
        if word == b"vt":
            each = min(2, min(len(line.split()) for _, line in lines))
            each = max(each, 1)
        found = numbers_of_lines(lines, each, what, self.path)
        if word == b"vt" and each == 1:
            found = np.column_stack([found, np.zeros(len(found))])
        self.rows[word].append(found)
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
    with path.open("rb") as file:
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


def _runs(file: BinaryIO) -> Iterator[tuple[bytes, list[Line]]]:
    """Yield lines that follow each other and have the same keyword, without it."""
    for word, lines in groupby(_split(_whole_lines(file)), key=lambda item: item[0]):
        run: list[Line] = []
        for _, number, rest in lines:
            run.append((number, rest))
            if len(run) == CHUNK_LINES:
                yield word, run
                run = []
        if run:
            yield word, run


def _split(lines: Iterator[Line]) -> Iterator[tuple[bytes, int, bytes]]:
    for number, line in lines:
        parts = line.split(None, 1)
        if parts and not parts[0].startswith(b"#"):
            yield parts[0], number, parts[1] if len(parts) > 1 else b""


def _whole_lines(file: BinaryIO) -> Iterator[Line]:
    """Yield lines with their numbers; a backslash at the end joins the next one."""
    begun = b""
    for number, line in enumerate(file, start=1):
        if line.rstrip(b"\r\n").endswith(b"\\"):
            begun += line.rstrip(b"\r\n")[:-1] + b" "
            continue
        yield number, begun + line if begun else line
        begun = b""
    if begun:
        yield number, begun


def _text(line: bytes) -> str:
    return line.decode("utf-8", "replace").strip()
