"""OBJ files that are refused: each with the line and the reason."""

from pathlib import Path

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError

from .conftest import Read
from .refusal import Row, check_refused

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
ANGLES = np.arange(1200) / 600 * np.pi
STAR = "".join(f"v {(1 + i % 2) * np.cos(angle)} {(1 + i % 2) * np.sin(angle)} 0\n" for i, angle in enumerate(ANGLES))

FILES: list[Row] = [
    ("OBJ without faces", "a.obj", SQUARE, r": has no faces"),
    ("f 1//", "a.obj", SQUARE + "f 1// 2// 3//\n", r":5: is not a corner of a face \(got '1//'"),
    ("one f 1//", "a.obj", SQUARE + "f 1 2 3\nf 1// 2 3\n", r":6: is not a corner of a face \(got '1//'"),
    ("f 0", "a.obj", SQUARE + "f 0 1 2\n", r":5: is not a corner of a face \(got '0'"),
    ("f 2/0", "a.obj", SQUARE + "vt 0 0\nf 1/1 2/0 3/1\n", r":6: is not a corner of a face \(got '2/0'"),
    ("f 2/0 and 3", "a.obj", SQUARE + "vt 0 0\nf 1/1 2/0 3\n", r":6: is not a corner of a face \(got '2/0'"),
    ("f 1.5", "a.obj", SQUARE + "f 1.5 1 2\n", r":5: is not a corner"),
    ("f word", "a.obj", SQUARE + "f a b c\n", r":5: is not a corner"),
    ("f 1/2/3/4", "a.obj", SQUARE + "f 1/2/3/4 1 2\n", r":5: is not a corner"),
    ("two corners in OBJ", "a.obj", SQUARE + "f 1 2\n", r":5: is a face of 2 corners"),
    ("two corners after three", "a.obj", SQUARE + "f 1 2 3\nf 1 2\n", r":6: is a face of 2 corners"),
    ("no corners in OBJ", "a.obj", SQUARE + "f\n", r":5: is a face of 0 corners"),
    (
        "too far back",
        "a.obj",
        SQUARE + "f -1 -2 -5\n",
        r":5: names a vertex that is not there \(got -5; allowed: 1 to 4",
    ),
    ("too far on", "a.obj", SQUARE + "f 1 2 5\n", r":5: names a vertex that is not there \(got 5; allowed: 1 to 4"),
    ("long corner", "a.obj", SQUARE + f"f {'x' * 50} 1 2\n", rf":5: is not a corner of a face \(got '{'x' * 40}'"),
    ("huge second index", "a.obj", SQUARE + "vt 0 0\nf 1/99999999999999999999 2/1 3\n", r":6: is not a corner"),
    ("huge index", "a.obj", SQUARE + "f 1 2 99999999999999999999\n", r":5: is not a corner"),
    (
        "no such normal",
        "a.obj",
        SQUARE + "f 1//1 2//1 3//1\n",
        r":5: names a normal that is not there \(got 1; allowed: none",
    ),
    ("vertex of two numbers", "a.obj", "v 0 0\n" + SQUARE, r":1: is not a vertex \(got '0 0'"),
    ("vertex of a word", "a.obj", SQUARE + "v 0 0 x\nf 1 2 3\n", r":5: is not a vertex"),
    ("coordinate without numbers", "a.obj", SQUARE + "vt\nf 1 2 3\n", r":5: is not a texture coordinate"),
    (
        "huge bent polygon",
        "a.obj",
        STAR + "f " + " ".join(map(str, range(1, 1201))) + "\n",
        r": the face of line 1201 has 1200 corners and is not convex \(allowed: a convex one, or up to 1000",
    ),
    ("library of other lines", "a.obj", "mtllib a.obj\n" + SQUARE + "f 1 2 3\n", r":1: is not in a material"),
    (
        "mesh of no size",
        "a.obj",
        "v 0 0 0\nv 1e-31 0 0\nv 0 1e-31 0\nf 1 2 3\n",
        r": is too small for float32 \(got 1e-31",
    ),
    (
        "coordinate beyond float32",
        "a.obj",
        SQUARE + "vt 0 1e300\nf 1/1 2/1 3/1\n",
        r": texture coordinate 0 is not finite \(got \[0.0, inf\]",
    ),
    ("binary as OBJ", "a.obj", bytes(range(256)) * 4, r": has no faces"),
]


@pytest.mark.parametrize(("name", "content", "message"), [row[1:] for row in FILES], ids=[row[0] for row in FILES])
def test_unusable_file_is_refused(read: Read, tmp_path: Path, name: str, content: str | bytes, message: str) -> None:
    check_refused(read, tmp_path, name, content, message)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("newmtl w\nKd red\n", "a.mtl:2: is not a value .got 'kd red'; allowed: finite numbers."),
        ("newmtl w\nNs\n", "a.mtl:2: is not a value .got 'ns'"),
        ("newmtl w\nd -halo\n", "a.mtl:2: is not a value .got 'd'"),
        ("newmtl w\n\nNi inf\n", "a.mtl:3: is not a value .got 'ni inf'"),
    ],
)
def test_wrong_materials_are_refused(read: Read, tmp_path: Path, lines: str, message: str) -> None:
    (tmp_path / "a.mtl").write_text(lines)
    with pytest.raises(InputError, match=message):
        read("a.obj", f"mtllib a.mtl\nusemtl w\n{SQUARE}f 1 2 3\n")
