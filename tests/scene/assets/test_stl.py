"""STL files, binary and text."""

import struct

import numpy as np
import pytest

from .conftest import Read

TRIANGLES = np.array([[[0, 0, 0], [1, 0, 0], [0, 2, 0]], [[0, 0, 0], [0, 2, 0], [0, 0, 3]]], np.float32)


def binary(triangles: np.ndarray, head: bytes = b"", count: int | None = None) -> bytes:
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *corners.ravel(), 0) for corners in triangles)
    return head.ljust(80, b"\0") + struct.pack("<I", len(triangles) if count is None else count) + rows


def text(triangles: np.ndarray) -> str:
    lines = ["solid made by hand"]
    for corners in triangles:
        lines += ["  facet normal 0 0 0", "\touter loop", *(f"    vertex {x:g} {y:e} {z:g}" for x, y, z in corners)]
        lines += ["  endloop", "  ENDFACET"]
    return "\n".join([*lines, "endsolid made by hand", ""])


@pytest.mark.parametrize(
    "content",
    [binary(TRIANGLES), binary(TRIANGLES, b"solid block"), text(TRIANGLES), text(TRIANGLES).replace("\n", "\r\n")],
)
def test_triangles_come_as_they_are(read: Read, content: str | bytes) -> None:
    (part,) = read("a.stl", content).parts
    assert np.array_equal(part.mesh.positions[part.mesh.faces], TRIANGLES)
    assert part.mesh.normals is None


def test_solids_of_one_file_are_one_mesh(read: Read) -> None:
    content = text(TRIANGLES[:1]) + text(TRIANGLES[1:])
    assert len(read("A.STL", content).parts[0].mesh.faces) == 2
