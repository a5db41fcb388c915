"""STL files that are refused: each with the place and the reason."""

from pathlib import Path

import pytest

from .conftest import Read
from .refusal import Row, check_refused
from .test_stl import TRIANGLES, binary, text

FILES: list[Row] = [
    (
        "STL cut short",
        "a.stl",
        binary(TRIANGLES)[:-1],
        r": says that it has 2 triangles, in 184 bytes \(got 183 bytes\)",
    ),
    ("STL of too few", "a.stl", binary(TRIANGLES, count=1), r": says that it has 1 triangles"),
    ("STL of 4 10^9", "a.stl", binary(TRIANGLES, count=2**32 - 1), r": says that it has 4294967295 triangles"),
    ("STL without triangles", "a.stl", binary(TRIANGLES[:0]), r": has no faces"),
    ("short garbage as STL", "a.stl", b"\x01\x02", r": is not an STL file"),
    ("text STL cut short", "a.stl", text(TRIANGLES).rpartition("endsolid")[0], r": is cut short"),
    (
        "text STL with two vertices",
        "a.stl",
        text(TRIANGLES).replace("    vertex 1 0", "# 1 0"),
        r":5: does not belong here",
    ),
    (
        "text STL with four vertices",
        "a.stl",
        text(TRIANGLES).replace("  endloop", "  vertex 0 0 0\n  endloop"),
        r":7: does not",
    ),
    ("text STL with a word", "a.stl", text(TRIANGLES).replace("vertex 1", "vertex one"), r":5: is not a vertex"),
    ("empty solid", "a.stl", "solid a\nendsolid a\n", r": has no faces"),
]


@pytest.mark.parametrize(("name", "content", "message"), [row[1:] for row in FILES], ids=[row[0] for row in FILES])
def test_unusable_file_is_refused(read: Read, tmp_path: Path, name: str, content: str | bytes, message: str) -> None:
    check_refused(read, tmp_path, name, content, message)
