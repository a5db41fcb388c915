"""PLY files: text and binary, with all that they may carry."""

import struct

import numpy as np
import pytest

from .conftest import Read

POINTS = np.array([[0, 0, 0], [2, 0, 0], [2, 3, 0], [0, 3, 0.5]], np.float32)
BINARY = [("binary_little_endian", "<"), ("binary_big_endian", ">")]


def header(form: str, vertices: int, vertex: str, faces: int, face: str) -> str:
    lines = ["ply", f"format {form} 1.0", "comment made by hand", f"element vertex {vertices}"]
    lines += [f"property {item}" for item in vertex.split(", ")]
    lines += [f"element face {faces}"]
    return "\n".join([*lines, *(f"property {item}" for item in face.split(", ")), "end_header", ""])


XYZ = "float x, float y, float z"
CORNERS = "list uchar int vertex_indices"


@pytest.mark.parametrize(("form", "order"), BINARY)
def test_binary_triangles(read: Read, form: str, order: str) -> None:
    content = header(form, 4, XYZ, 2, CORNERS).encode() + POINTS.astype(order + "f4").tobytes()
    content += struct.pack(order + "BiiiBiii", 3, 0, 1, 2, 3, 0, 2, 3)
    (part,) = read("a.ply", content).parts
    assert np.array_equal(part.mesh.positions, POINTS)
    assert part.mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert part.mesh.normals is None and part.mesh.uvs is None and part.material is None


@pytest.mark.parametrize(("form", "order"), BINARY)
def test_binary_polygons_of_several_sizes_with_further_properties(read: Read, form: str, order: str) -> None:
    face = "uchar red, list ushort uint vertex_index, list uchar float extra, short flag"
    content = header(form, 4, "double x, double y, double z, uchar red", 2, face).encode()
    content += b"".join(struct.pack(order + "dddB", *point, 7) for point in POINTS.tolist())
    content += struct.pack(order + "BHIIIIBh", 9, 4, 0, 1, 2, 3, 0, -1)
    content += struct.pack(order + "BHIIIBfh", 9, 3, 0, 1, 3, 1, 0.5, -1)
    contents = read("a.ply", content)
    (part,) = contents.parts
    assert [note.partition("a.ply: ")[2] for note in contents.notes] == ["colours of each face are left out"]
    assert np.array_equal(part.mesh.positions, POINTS)
    assert sorted(part.mesh.faces.tolist()) == [[0, 1, 2], [0, 1, 3], [0, 2, 3]]


def test_strips_of_triangles_turn_as_their_first(read: Read) -> None:
    content = header("binary_little_endian", 4, XYZ, 2, "list int int vertex_indices").replace("face", "tristrips")
    content_bytes = content.encode() + POINTS.astype("<f4").tobytes()
    content_bytes += struct.pack("<i8i", 8, 0, 1, 2, 3, -1, 3, 0, 2) + struct.pack("<i2i", 2, 0, 1)
    (part,) = read("a.ply", content_bytes).parts
    assert part.mesh.faces.tolist() == [[0, 1, 2], [2, 1, 3], [3, 0, 2]]


def test_text_with_normals_and_texture_coordinates(read: Read) -> None:
    content = header("ascii", 4, f"{XYZ}, float nx, float ny, float nz, float s, float t", 1, CORNERS)
    content += "".join(f"{x} {y} {z} 0 0 2 {x / 2} {y / 3}\n" for x, y, z in POINTS.tolist()) + "4 0 1 2 3\n"
    mesh = read("a.ply", content).parts[0].mesh
    assert mesh.normals is not None and mesh.uvs is not None
    assert mesh.normals.tolist() == [[0, 0, 1]] * 4
    assert mesh.uvs.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]


def test_text_with_lines_of_windows_and_polygons_of_several_sizes(read: Read) -> None:
    content = header("ascii", 4, XYZ, 2, CORNERS)
    content += "".join(f"{x:g} {y:g} {z:g}\n" for x, y, z in POINTS.tolist()) + "3 0 1 2\n4 0 1 2 3\n"
    mesh = read("a.ply", content.replace("\n", "\r\n")).parts[0].mesh
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]  # the same triangle twice counts once


def test_text_of_many_rows_is_read_in_pieces(read: Read) -> None:
    count = 70_000
    points = np.stack([np.arange(count) % 300, np.arange(count) // 300, np.zeros(count)], axis=1)
    lines = "".join(f"{x:g} {y:g} 0\n" for x, y, _ in points)
    faces = "".join(
        f"3 {i} {i + 1} {i + 300}\n" if i % 2 else f"4 {i} {i + 1} {i + 301} {i + 300}\n" for i in range(40_000)
    )
    mesh = read("a.ply", header("ascii", count, XYZ, 40_000, CORNERS) + lines + faces).parts[0].mesh
    assert len(mesh.faces) == 20_000 * 3
    assert mesh.positions[mesh.faces].max(axis=(0, 1)).tolist() == [299, 134, 0]


def test_texture_coordinates_of_corners_tell_vertices_apart(read: Read) -> None:
    content = header("ascii", 4, XYZ, 2, f"{CORNERS}, list uchar float texcoord")
    content += "".join(f"{x:g} {y:g} {z:g}\n" for x, y, z in POINTS.tolist())
    content += "3 0 1 2 6 0 0 1 0 1 1\n3 0 2 3 6 0 0 0.5 0.5 0 1\n"
    mesh = read("a.ply", content).parts[0].mesh
    assert mesh.uvs is not None
    assert len(mesh.positions) == 5  # vertex 2 has two texture coordinates, vertex 0 has one
    assert np.array_equal(mesh.positions[mesh.faces], POINTS[[[0, 1, 2], [0, 2, 3]]])
    assert mesh.uvs[mesh.faces].tolist() == [[[0, 0], [1, 0], [1, 1]], [[0, 0], [0.5, 0.5], [0, 1]]]


def test_binary_faces_may_stand_before_vertices(read: Read) -> None:
    content = header("binary_little_endian", 4, XYZ, 2, CORNERS).encode()
    start, vertex, face = content.split(b"element ")
    content = b"element ".join([start, face.replace(b"end_header\n", b""), vertex + b"end_header\n"])
    content += struct.pack("<BiiiBiiii", 3, 0, 1, 3, 4, 0, 1, 2, 3) + POINTS.tobytes()
    mesh = read("a.ply", content).parts[0].mesh
    assert np.array_equal(mesh.positions, POINTS)
    assert sorted(mesh.faces.tolist()) == [[0, 1, 2], [0, 1, 3], [0, 2, 3]]


def test_text_faces_with_further_properties(read: Read) -> None:
    content = header("ascii", 4, XYZ, 2, f"uchar red, {CORNERS}, float quality")
    content += "".join(f"{x:g} {y:g} {z:g}\n" for x, y, z in POINTS.tolist()) + "9 3 0 1 3 0.5\n8 4 0 1 2 3 0.25\n"
    contents = read("a.ply", content)
    assert sorted(contents.parts[0].mesh.faces.tolist()) == [[0, 1, 2], [0, 1, 3], [0, 2, 3]]
    assert contents.notes[0].endswith("a.ply: colours of each face are left out")


def test_texture_coordinates_that_do_not_fit_the_corners_are_none(read: Read) -> None:
    content = header("ascii", 4, XYZ, 2, f"{CORNERS}, list uchar float texcoord")
    content += "".join(f"{x:g} {y:g} {z:g}\n" for x, y, z in POINTS.tolist())
    for rows in ("3 0 1 2 6 0 0 1 0 1 1\n3 0 2 3 0\n", "3 0 1 2 8 0 0 1 0 1 1 0 1\n4 0 1 2 3 6 0 0 1 0 1 1\n"):
        assert read("a.ply", content + rows).parts[0].mesh.uvs is None


def test_texture_coordinates_of_polygons_of_several_sizes(read: Read) -> None:
    content = header("ascii", 4, f"{XYZ}, float nx, float ny, float nz", 2, f"{CORNERS}, list uchar float texcoord")
    content += "".join(f"{x:g} {y:g} {z:g} {k} 1 0\n" for k, (x, y, z) in enumerate(POINTS.tolist()))
    content += "4 0 1 2 3 8 0 0 1 0 1 1 0 1\n3 3 1 0 6 0.5 1 0.5 0 0 0\n"
    mesh = read("a.ply", content).parts[0].mesh
    rows = np.hstack([mesh.positions, mesh.uvs])[mesh.faces].tolist()
    texts = [[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 1], [0.5, 0]]
    corners = [(*POINTS[at].tolist(), *texts[uv]) for at, uv in ((0, 0), (1, 1), (2, 2), (3, 3), (3, 4), (1, 5))]
    expected = [[corners[k] for k in face] for face in ([4, 5, 0], [0, 1, 2], [0, 2, 3])]
    assert [[tuple(row) for row in face] for face in rows] == expected
    steepness = np.hypot(1, np.arange(4))
    along = [np.abs(POINTS - row).sum(axis=1).argmin() for row in mesh.positions]
    np.testing.assert_allclose(
        mesh.normals, np.stack([along, np.ones(6), np.zeros(6)], 1) / steepness[along, None], atol=1e-6
    )


@pytest.mark.parametrize(("form", "order"), BINARY)
def test_vertices_with_lists_of_several_lengths(read: Read, form: str, order: str) -> None:
    content = header(form, 4, "double x, list char short bones, float y, short z", 1, CORNERS).encode()
    for k, (x, y, z) in enumerate([(1e7, 0.5, 0), (1e7 + 0.125, 0.5, 0), (1e7 + 0.125, 1.5, 300), (1e7, 1.5, -2)]):
        content += struct.pack(f"{order}db{k}hfh", x, k, *range(k), y, z)
    mesh = read("a.ply", content + struct.pack(order + "Biiii", 4, 0, 1, 2, 3)).parts[0].mesh
    found = mesh.positions + mesh.origin
    assert found.tolist() == [[1e7, 0.5, 0], [1e7 + 0.125, 0.5, 0], [1e7 + 0.125, 1.5, 300], [1e7, 1.5, -2]]
