"""Whatever is in a file, reading it ends in a mesh or in an input error."""

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.meshes import SUFFIXES, read_mesh_file

from .gltf_writer import triangle
from .test_bad_obj import SQUARE
from .test_bad_ply import BINARY_PLY, TEXT_PLY
from .test_stl import TRIANGLES, binary, text

VALID: list[tuple[str, bytes]] = [
    (".ply", TEXT_PLY.encode()),
    (".ply", BINARY_PLY),
    (".stl", binary(TRIANGLES)),
    (".stl", text(TRIANGLES).encode()),
    (".obj", f"{SQUARE}vt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf -4 -3 -1\nusemtl a\nf 1//1 2//1 3//1 4//1\n".encode()),
    (".glb", triangle(material=0).glb()),
    (".gltf", triangle().gltf().encode()),
]

STARTS = [b"", b"ply\n", b"solid", b"glTF", b"v ", b"{"]
INSERTS = [b"0", b"-1", b"9" * 12, b" ", b"\n", b"nan", b"{}", b"/"]
NUMBERS = [b"\xff" * 4, *(struct.pack("<f", value) for value in (np.nan, np.inf, 1e30, -1e-40))]
SETTINGS = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


def check(path: Path) -> None:
    """Read a file; what comes out is sound."""
    try:
        contents = read_mesh_file(path, lambda reference: path.parent / reference)
    except InputError as problem:
        assert str(problem)
        return
    for part in contents.parts:
        mesh = part.mesh
        assert np.isfinite(mesh.positions).all() and np.isfinite(part.placement).all()
        assert len(mesh.faces) and mesh.faces.min() >= 0 and mesh.faces.max() < len(mesh.positions)
        assert mesh.normals is None or np.allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-3)
        assert mesh.uvs is None or np.isfinite(mesh.uvs).all()


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sampled_from(SUFFIXES),
    st.binary(max_size=300),
    st.sampled_from([b"", b"ply\n", b"solid", b"glTF", b"v ", b"{"]),
)
def test_any_bytes_are_read_or_refused(tmp_path: Path, suffix: str, content: bytes, start: bytes) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(start + content)
    check(path)


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(VALID), st.data())
def test_mutated_file_is_read_or_refused(tmp_path: Path, valid: tuple[str, bytes], data: st.DataObject) -> None:
    suffix, content = valid
    changed = bytearray(content)
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(changed)))
        match data.draw(st.sampled_from(["replace", "cut", "insert", "number", "swap"])):
            case "replace" if place < len(changed):
                changed[place] = data.draw(st.integers(0, 255))
            case "cut":
                del changed[place : place + data.draw(st.integers(1, 30))]
            case "insert":
                changed[place:place] = data.draw(st.sampled_from(INSERTS))
            case "number":
                changed[place : place + 4] = data.draw(st.sampled_from(NUMBERS))
            case "swap":
                changed[place:] = content[data.draw(st.integers(0, len(content))) :]
            case _:
                pass
    path = tmp_path / f"a{suffix}"
    path.write_bytes(bytes(changed))
    check(path)


@pytest.mark.parametrize(("suffix", "content"), VALID)
def test_valid_files_of_these_tests_are_valid(tmp_path: Path, suffix: str, content: bytes) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(content if suffix != ".glb" else triangle().glb())
    assert read_mesh_file(path, lambda reference: path).parts
