"""Colours of vertices: of PLY files and of written-out meshes, linear over each triangle."""

import struct

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.load import load_scene

from .conftest import Read
from .test_ply import CORNERS, XYZ, header

# A square of four triangles round its middle, seen square on: pure colours, which no one picture of 2 x 2 texels holds.
VERTICES = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [0.2, -0.1, 0]], float)
FACES = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
COLOURS = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0.1, 0.5, 0.9]])
SIDE = 32
FIELD = float(np.degrees(2 * np.arctan(0.01)))


def scene(**mesh):
    """Seen by a pinhole that sees just the square, in even light: each pixel is the reflectance at its place."""
    return {
        "film": {"resolution": [SIDE, SIDE], "filter": {"kind": "box"}},
        "camera": {"kind": "pinhole", "eye": [0, 0, 100], "target": [0, 0, 0], "fov_degrees": FIELD},
        "environment": {"kind": "constant", "radiance": [1, 1, 1]},
        "objects": [{"shape": "mesh"} | mesh],
    }  # fmt: skip


def expected():
    """Mean over each pixel of the colour that barycentric weights give, by 8 x 8 places in it."""
    fine = 8 * SIDE
    x = (np.arange(fine) + 0.5) / fine * 2 - 1
    points = np.stack(np.broadcast_arrays(x[None, :], -x[:, None]), axis=-1).reshape(-1, 2)
    shown = np.zeros((len(points), 3))
    for face in FACES:
        a, b, c = VERTICES[face, :2]
        second, third = np.linalg.solve(np.column_stack([b - a, c - a]), (points - a).T)
        inside = (second >= 0) & (third >= 0) & (second + third <= 1)
        weights = np.stack([1 - second - third, second, third], axis=1)[inside]
        shown[inside] = weights @ COLOURS[face]
    return shown.reshape(SIDE, 8, SIDE, 8, 3).mean(axis=(1, 3))


def assert_shows_the_colours(picture):
    """Within 8 bits of sRGB, and the places of 64 samples in a pixel."""
    apart = np.abs(np.asarray(picture) - expected())
    assert apart.max() < 0.02
    assert apart.mean() < 0.003


def test_written_out_colours_are_linear_over_each_triangle():
    mesh = {"vertices": VERTICES.tolist(), "faces": FACES, "colors": COLOURS.tolist()}
    assert_shows_the_colours(rptcam_cl.render(scene(**mesh), spp=64))
    named = scene(mesh="square") | {"meshes": {"square": mesh}}
    arrays = scene(vertices=VERTICES, faces=np.array(FACES), colors=COLOURS)
    reference = rptcam_cl.render(scene(**mesh), spp=4)
    for other in (named, arrays):
        np.testing.assert_array_equal(rptcam_cl.render(other, spp=4).pixels, reference.pixels)


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian"])
def test_colours_of_a_ply_file_are_codes_as_srgb_has_them(tmp_path, kind):
    encoded = np.where(COLOURS <= 0.0031308, 12.92 * COLOURS, 1.055 * COLOURS ** (1 / 2.4) - 0.055)
    codes = np.round(255 * encoded).astype(int)
    content = header(kind, 5, XYZ + ", uchar red, uchar green, uchar blue", 4, CORNERS).encode()
    for point, code in zip(VERTICES.tolist(), codes.tolist(), strict=True):
        text = " ".join(map(str, [*point, *code])) + "\n"
        content += text.encode() if kind == "ascii" else struct.pack("<fffBBB", *point, *code)
    for face in FACES:
        content += f"3 {face[0]} {face[1]} {face[2]}\n".encode() if kind == "ascii" else struct.pack("<Biii", 3, *face)
    (tmp_path / "square.ply").write_bytes(content)
    shown = load_scene(scene(file="square.ply"), base_dir=tmp_path)
    assert_shows_the_colours(rptcam_cl.render(shown, spp=64))
    grey = {"kind": "matte", "reflectance": [0.5, 0.5, 0.5]}
    own = load_scene(scene(file="square.ply", material=grey), base_dir=tmp_path)
    assert len(own.solids()[0].contents.parts[0].mesh.positions) == 5  # an object's own material is not painted


def test_colours_of_floats_are_linear_and_smooth_normals_stay_smooth(read: Read):
    content = header("ascii", 5, XYZ + ", float red, float green, float blue", 4, CORNERS)
    rows = np.hstack([VERTICES + [0, 0, 0.3] * (np.arange(5) == 4)[:, None], COLOURS])
    content += "\n".join(" ".join(map(str, row)) for row in rows.tolist()) + "\n"
    content += "\n".join(f"3 {a} {b} {c}" for a, b, c in FACES) + "\n"
    contents = read("a.ply", content.encode())
    mesh = contents.with_normals("smooth").parts[0].mesh
    assert mesh.normals is not None
    for place in np.unique(mesh.positions, axis=0):
        at = (mesh.positions == place).all(axis=1)
        assert np.ptp(mesh.normals[at], axis=0).max() < 1e-6


def test_colours_that_cannot_be_are_refused():
    mesh = {"vertices": VERTICES.tolist(), "faces": FACES}
    with pytest.raises(InputError, match=r"colors\.1\.2|colors\[1\]\[2\].*0 to 1"):
        load_scene(scene(**mesh, colors=[[0, 0, 0], [0, 0, 1.5], *[[1, 1, 1]] * 3]))
    with pytest.raises(InputError, match=r"colors.*one for each of the 5 vertices"):
        load_scene(scene(**mesh, colors=[[0, 0, 0]] * 4))
    with pytest.raises(InputError, match=r"colors.*belongs to vertices"):
        load_scene(scene(file="a.ply", colors=[[0, 0, 0]] * 4))
