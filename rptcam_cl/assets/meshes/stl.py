"""STL files, binary or text: triangles without anything else."""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes.contents import open_mesh
from rptcam_cl.assets.meshes.mesh import MeshSurface
from rptcam_cl.assets.meshes.obj_lines import numbers_of_lines
from rptcam_cl.core.errors import InputError

HEAD_BYTES = 84
ROW = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
CHUNK_ROWS = 1 << 17
CHUNK_LINES = 7 << 13

# What each line of a text file begins with, and what may come before it.
AFTER = {
    b"facet": (b"solid", b"endfacet"), b"outer": (b"facet",), b"vertex": (b"outer", b"vertex"),
    b"endloop": (b"vertex",), b"endfacet": (b"endloop",), b"endsolid": (b"endfacet", b"solid"),
    b"solid": (b"", b"endsolid"),
}  # fmt: skip


def read_stl(path: Path) -> MeshSurface:
    """Return the surface of an STL file; its triangles share no vertices.

    Raises
    ------
    InputError
        When it is not STL, or holds more or fewer triangles than it says.
    """
    size = path.stat().st_size
    with open_mesh(path) as file:
        head = file.read(HEAD_BYTES)
        count = int.from_bytes(head[80:84], "little")
        binary_size = HEAD_BYTES + count * ROW.itemsize
        if len(head) == HEAD_BYTES and size == binary_size:
            corners = _binary(file, count)
        elif head.lstrip().startswith(b"solid") and b"\0" not in head:
            file.seek(0)
            corners = _text(file, path)
        elif len(head) == HEAD_BYTES:
            raise InputError(f"{path}: says that it has {count} triangles, in {binary_size} bytes (got {size} bytes)")
        else:
            allowed = f"text that begins with 'solid', or a head of {HEAD_BYTES} bytes"
            raise InputError(f"{path}: is not an STL file (allowed: {allowed})")
    if not len(corners):
        raise InputError(f"{path}: has no faces")
    return MeshSurface(corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3))


def _binary(file: BinaryIO, count: int) -> NDArray[np.float32]:
    corners = np.empty((count, 3, 3), np.float32)
    for start in range(0, count, CHUNK_ROWS):
        rows = np.fromfile(file, ROW, min(CHUNK_ROWS, count - start))
        corners[start : start + len(rows)] = rows["corners"]
    return corners.reshape(-1, 3)


def _text(file: BinaryIO, path: Path) -> NDArray[np.float32]:
    parts: list[NDArray[np.float32]] = []
    before, run, done = b"", 0, 0
    while lines := list(islice(file, CHUNK_LINES)):
        vertices: list[tuple[int, bytes]] = []
        for number, line in enumerate(lines, start=done + 1):
            word, rest = (*line.split(None, 1), b"", b"")[:2]
            word = word.lower()
            if not word:
                continue
            run = run + 1 if word == b"vertex" else run
            if before not in AFTER.get(word, ()) or run > 3 or (word == b"endloop" and run != 3):
                raise _wrong_line(path, number, line, before)
            if word == b"vertex":
                vertices.append((number, rest))
            elif word == b"endloop":
                run = 0
            before = word
        parts.append(numbers_of_lines(vertices, 3, "a vertex", path).astype(np.float32))
        done += len(lines)
    if before != b"endsolid":
        raise InputError(f"{path}: is cut short: ends without 'endsolid'")
    return np.concatenate(parts).reshape(-1, 3)


def _wrong_line(path: Path, number: int, line: bytes, before: bytes) -> InputError:
    fitting = sorted(word.decode() for word, earlier in AFTER.items() if before in earlier)
    got = line.decode("latin-1").strip()[:60]
    return InputError(
        f"{path}:{number}: does not belong here (got {got!r}; allowed: {', '.join(fitting)}, three vertices a triangle)"
    )
