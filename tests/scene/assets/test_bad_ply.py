"""PLY files, and files of no known kind, that are refused: each with the place and the reason."""

import struct
from pathlib import Path

import pytest

from .conftest import Read
from .refusal import Row, check_refused
from .test_ply import CORNERS, POINTS, XYZ, header
from .test_stl import TRIANGLES, text

TEXT_PLY = header("ascii", 3, XYZ, 1, CORNERS) + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
FACE = struct.pack("<Biii", 3, 0, 1, 2)
BINARY_PLY = header("binary_little_endian", 4, XYZ, 1, CORNERS).encode() + POINTS.tobytes() + FACE
FACES_FIRST = (
    b"ply\nformat binary_little_endian 1.0\nelement face 1\nproperty list uchar int vertex_indices\n"
    b"element vertex 4\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
) + FACE + POINTS.tobytes()  # fmt: skip
CLAIM = header("binary_little_endian", 10**12, XYZ, 1, CORNERS)


def changed_ply(old: str, new: str) -> str:
    assert old in TEXT_PLY
    return TEXT_PLY.replace(old, new)


FILES: list[Row] = [
    ("no suffix", "a", TEXT_PLY, r": is not a mesh file \(got no suffix"),
    ("other suffix", "a.fbx", TEXT_PLY, r": is not a mesh file \(got \.fbx; allowed: \.ply, "),
    ("empty", "a.ply", "", r": is empty"),
    ("empty OBJ", "a.obj", "", r": is empty"),
    # PLY
    ("other format", "a.ply", text(TRIANGLES), r": is not a PLY file"),
    ("header only begun", "a.ply", "ply\nformat ascii 1.0\n", r": is not a PLY file .*end_header"),
    ("endless header", "a.ply", "ply\n" + "comment x\n" * 10_000, r": is not a PLY file"),
    ("no format", "a.ply", changed_ply("format ascii 1.0\n", ""), r": has no line 'format'"),
    ("unknown format", "a.ply", changed_ply("ascii 1.0", "ascii 2.0"), r":2: is not a line of a PLY header"),
    ("unknown type", "a.ply", changed_ply("float x", "real x"), r":5: is not a property \(got 'real x'"),
    ("list of floats long", "a.ply", changed_ply("uchar int", "float int"), r":9: is not a property"),
    ("property twice", "a.ply", changed_ply("float y", "float x"), r": names element vertex, or .* twice"),
    ("negative count", "a.ply", changed_ply("vertex 3", "vertex -3"), r":4: is not a line"),
    ("no faces", "a.ply", header("ascii", 0, XYZ, 0, CORNERS), r": has no faces"),
    ("points only", "a.ply", TEXT_PLY.replace("face 1", "edge 1"), r": has no faces"),
    ("no positions", "a.ply", changed_ply("float x", "float a"), r": its vertices have no position"),
    (
        "faces without corners",
        "a.ply",
        changed_ply("vertex_indices", "colours"),
        r": its faces have no list of vertices",
    ),
    ("10^12 vertices", "a.ply", CLAIM + "x" * 1000, r": claims 1000000000000 rows of vertex"),
    (
        "10^9 vertices",
        "a.ply",
        CLAIM.replace(str(10**12), str(10**9)) + "x" * 1000,
        r": is cut short: 1000000000 of vertex",
    ),
    ("10^9 rows of text", "a.ply", changed_ply("vertex 3", "vertex 1000000000"), r": is cut short"),
    ("text cut short", "a.ply", TEXT_PLY[:-9], r": is cut short"),
    ("binary cut short", "a.ply", BINARY_PLY[:-1], r": is cut short: ends inside face 0"),
    ("no faces in binary", "a.ply", header("binary_little_endian", 0, XYZ, 0, CORNERS), r": has no faces"),
    ("binary vertices after faces", "a.ply", FACES_FIRST[:-1], r": is cut short: ends inside vertex 3"),
    ("number of Python", "a.ply", changed_ply("1 0 0", "1_0 0 0"), r":11: holds rows of vertex that cannot be read"),
    (
        "rows missing in text",
        "a.ply",
        changed_ply("face 1", "face 3").replace("1 0 0", "1.000000 0 0"),
        r": is cut short: ends after 1 rows of face",
    ),
    (
        "not a number in binary",
        "a.ply",
        BINARY_PLY.replace(POINTS.tobytes(), b"\xff" * 48),
        r": has no triangle .*dropped: 1 with",
    ),
    ("binary vertices cut short", "a.ply", BINARY_PLY[:-30], r": is cut short"),
    (
        "list of 4 10^9 entries",
        "a.ply",
        BINARY_PLY.replace(b"uchar", b"uint")[:-13] + struct.pack("<Iiii", 2**32 - 1, 0, 1, 2),
        r": is cut short",
    ),
    (
        "list of -1 entries",
        "a.ply",
        BINARY_PLY.replace(b"uchar", b"int")[:-13] + struct.pack("<iiii", -1, 0, 1, 2),
        r": face 0 has a list of -1 entries",
    ),
    ("word in text", "a.ply", changed_ply("1 0 0", "1 O 0"), r":12: is not a row of vertex \(got '1 O 0'"),
    ("number missing in text", "a.ply", changed_ply("1 0 0", "1 0"), r":12: is not a row of vertex"),
    ("half a vertex", "a.ply", changed_ply("3 0 1 2", "3 0 1 1.5"), r":14: is not a row of face"),
    ("corner missing in text", "a.ply", changed_ply("3 0 1 2", "4 0 1 2"), r":14: is not a row of face"),
    (
        "face out of range",
        "a.ply",
        changed_ply("3 0 1 2", "3 0 1 3"),
        r": face 0 names a vertex that is not there \(got 3; allowed: 0 to 2",
    ),
    (
        "negative corner",
        "a.ply",
        changed_ply("3 0 1 2", "3 0 1 -1"),
        r": face 0 names a vertex that is not there \(got -1",
    ),
    ("two corners", "a.ply", changed_ply("3 0 1 2", "2 0 1"), r": face 0 has 2 corners"),
    (
        "all without area",
        "a.ply",
        changed_ply("1 0 0", "0 2 0"),
        r": has no triangle that can be shown \(dropped: 1 without area\)",
    ),
    (
        "all not finite",
        "a.ply",
        changed_ply("1 0 0", "nan 0 0"),
        r": has no triangle that can be shown \(dropped: 1 with a vertex",
    ),
    (
        "infinite normal",
        "a.ply",
        header("ascii", 3, f"{XYZ}, float nx, float ny, float nz", 1, CORNERS)
        + "0 0 0 0 0 1\n1 0 0 0 inf 1\n0 1 0 0 0 1\n3 0 1 2\n",
        r": normal 1 is not finite",
    ),
    (
        "coordinate of nan",
        "a.ply",
        header("ascii", 3, f"{XYZ}, float u, float v", 1, CORNERS) + "0 0 0 0 0\n1 0 0 0 0\n0 1 0 nan 1\n3 0 1 2\n",
        r": texture coordinate 2 is not finite",
    ),
    ("too far down", "a.ply", changed_ply("0 0 0", "-1e13 0 0"), r": reaches too far \(got 1e\+13"),
    ("too far", "a.ply", changed_ply("1 0 0", "1e13 0 0"), r": reaches too far"),
]


@pytest.mark.parametrize(("name", "content", "message"), [row[1:] for row in FILES], ids=[row[0] for row in FILES])
def test_unusable_file_is_refused(read: Read, tmp_path: Path, name: str, content: str | bytes, message: str) -> None:
    check_refused(read, tmp_path, name, content, message)
