"""Triangles that cannot be used are dropped and counted; polygons become triangles that cover them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rptcam_cl.scene.assets import mesh
from rptcam_cl.scene.assets.mesh import (
    NO_AREA,
    NOT_FINITE,
    TWICE,
    Polygons,
    as_triangles,
    different_rows,
    sound_faces,
    winding_number,
)

from .conftest import Read

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [np.nan, 0, 0], [2, 0, 0], [1, 0, 0]], np.float32)


@pytest.mark.parametrize(
    ("faces", "kept", "dropped"),
    [
        ([[0, 1, 2]], [0], {}),
        ([[0, 1, 2], [0, 1, 4]], [0], {NOT_FINITE: 1}),
        ([[0, 1, 1], [0, 1, 5], [0, 1, 6], [0, 1, 2]], [3], {NO_AREA: 3}),
        ([[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 6, 2]], [0], {TWICE: 3}),
        ([[0, 1, 2], [0, 2, 1]], [0, 1], {}),
    ],
)
def test_unusable_triangles_are_dropped(faces: list[list[int]], kept: list[int], dropped: dict[str, int]) -> None:
    found, count = sound_faces(POINTS, np.array(faces))
    assert found.tolist() == [faces[index] for index in kept]
    assert {reason: number for reason, number in count.items() if number} == dropped


def test_thin_triangle_is_no_triangle_without_area() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1e-30, 0]], np.float32)
    assert len(sound_faces(points, np.array([[0, 1, 2]]))[0]) == 1


def test_dropped_triangles_are_told(read: Read) -> None:
    contents = read("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 2 3 1\nf 1 1 2\nf 1 3 2\n")
    assert len(contents.parts[0].mesh.faces) == 2
    assert contents.notes[0].endswith("a.obj: triangles dropped: 1 without area, 1 given twice")


def area(corners: np.ndarray) -> float:
    """Signed area seen from +z."""
    a, b, c = np.moveaxis(corners, -2, 0)
    return float(np.cross(b - a, c - a)[..., 2].sum()) / 2


def shoelace(corners: np.ndarray) -> float:
    x, y = corners[:, 0], corners[:, 1]
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


@pytest.mark.parametrize("first", range(4))
def test_bent_quad_is_cut_inside(first: int) -> None:
    arrow = np.roll([[0, 0, 0], [2, -1, 0], [0.5, 0, 0], [2, 1, 0]], first, axis=0).astype(float)
    triangles = arrow[as_triangles(arrow, [Polygons(np.array([0]), np.array([[0, 1, 2, 3]]))], "face")]
    assert [area(corners) > 0 for corners in triangles] == [True, True]


@settings(max_examples=75)
@given(st.lists(st.floats(0.2, 1), min_size=5, max_size=40), st.integers(0, 2), st.booleans())
def test_triangles_of_any_simple_polygon_cover_it_once(radii: list[float], axis: int, turned: bool) -> None:
    angles = 2 * np.pi * np.arange(len(radii)) / len(radii)
    flat = np.stack([radii * np.cos(angles), radii * np.sin(angles), np.zeros(len(radii))], axis=1)
    corners = np.arange(len(radii))[:: -1 if turned else 1]
    polygon = np.roll(flat, axis, axis=1)
    triangles = flat[as_triangles(polygon, [Polygons(np.array([0]), corners[None])], "face")]
    areas = np.array([area(triangle) for triangle in triangles]) * (-1 if turned else 1)
    assert len(triangles) == len(radii) - 2
    assert (areas > -1e-12).all()
    assert areas.sum() == pytest.approx(shoelace(flat))


def test_polygon_of_many_corners_is_a_fan() -> None:
    angles = 2 * np.pi * np.arange(200_000) / 200_000
    circle = np.stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))], axis=1)
    triangles = as_triangles(circle, [Polygons(np.array([0]), np.arange(len(circle))[None])], "face")
    assert area(circle[triangles]) == pytest.approx(np.pi)


def test_winding_number_tells_inside_from_outside() -> None:
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = as_triangles(corners, [Polygons(np.arange(6), np.array(quads))], "face")
    assert winding_number(corners, faces, np.array([0.2, 0.7, 0.9])) == pytest.approx(1)
    assert winding_number(corners, faces, np.array([0.2, 0.7, 1.1])) == pytest.approx(0, abs=1e-9)
    assert winding_number(corners, faces[:, ::-1], np.array([0.2, 0.7, 0.9])) == pytest.approx(-1)


@pytest.mark.parametrize("first", range(10))
@pytest.mark.parametrize("axis", range(3))
def test_square_with_a_hole_is_cut_along_its_bridge(first: int, axis: int) -> None:
    """Two corners of the polygon lie where two others do: a bridge leads to the hole and back."""
    outside, hole = [(0, 0), (6, 0), (6, 6), (0, 6), (0, 0)], [(2, 2), (2, 4), (4, 4), (4, 2), (2, 2)]
    flat = np.roll([(x, y, 0.0) for x, y in outside + hole], first, axis=0)
    polygon = Polygons(np.array([0]), np.arange(10)[None])
    triangles = flat[as_triangles(np.roll(flat, axis, axis=1), [polygon], "face")]
    areas = [area(corners) for corners in triangles]
    assert len(areas) == 8
    assert min(areas) > -1e-12
    assert sum(areas) == pytest.approx(36 - 4)
    for x, y in ((3, 3), (2.2, 3.7)):  # nothing lies in the hole
        spokes = triangles[:, :, :2] - (x, y)
        after = np.roll(spokes, -1, axis=1)
        assert not (spokes[..., 0] * after[..., 1] - spokes[..., 1] * after[..., 0] > 0).all(axis=1).any()


def test_polygons_on_a_grid_are_cut_into_triangles_that_face_one_way() -> None:
    """Skylines, as plans of houses are: corners lie on the lines between others, and go straight on."""
    rng = np.random.default_rng(6)
    for _ in range(60):
        heights = rng.integers(1, 4, rng.integers(2, 8)).tolist()
        steps = [(x + right, top) for x, top in reversed([*enumerate(heights)]) for right in (1, 0)]
        ring = [(0, 0), (len(heights), 0), *(step for k, step in enumerate(steps) if step != steps[k - 1])]
        flat = np.roll([(x, y, 0.0) for x, y in ring], rng.integers(0, 9), axis=0)
        triangles = flat[as_triangles(flat, [Polygons(np.array([0]), np.arange(len(flat))[None])], "face")]
        areas = [area(corners) for corners in triangles]
        assert min(areas) >= 0
        assert sum(areas) == sum(heights)


def test_mixed_bits_are_those_of_splitmix() -> None:
    """The first numbers of Vigna's splitmix64.c from the states 0 and 1234567."""
    mixed = mesh._mix_bits(np.array([0, 1234567], np.uint64))
    assert mixed.tolist() == [0xE220A8397B1DCDAF, 6457827717110365317]


@pytest.mark.parametrize("largest", [9, 2**30])
def test_rows_that_differ_are_found_in_their_order(largest: int) -> None:
    rows = (np.random.default_rng(5).integers(-1, 3, (200, 3)) * (largest // 3)).tolist()
    known: dict[tuple[int, ...], int] = {}
    numbers = [known.setdefault(tuple(row), len(known)) for row in rows]
    first, found = different_rows(list(np.array(rows).T))
    assert found.tolist() == numbers
    assert [rows[place] for place in first] == [list(row) for row in known]


CUBE = "".join(f"v {x} {y} {z}\n" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1))
SIDES = ("1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4")


def test_smooth_normals_of_a_cube_point_along_its_diagonals_however_its_sides_are_cut(read: Read) -> None:
    """Their weights are the angles (Thürmer and Wüthrich 1998); corners at one place count as one."""
    seams = "".join(f"vt {k} 0\n" for k in range(6))
    faces = "".join("f " + " ".join(f"{v}/{k + 1}" for v in side.split()) + "\n" for k, side in enumerate(SIDES))
    flat = read("a.obj", CUBE + seams + faces)
    smooth = flat.with_normals("smooth")
    (cube,) = (part.mesh for part in smooth.parts)
    assert len(cube.positions) == 24
    np.testing.assert_allclose(cube.normals, cube.positions / np.sqrt(3), atol=1e-6)
    assert flat.with_normals("auto") is flat
    assert flat.with_normals("flat").parts[0].mesh is flat.parts[0].mesh
    again = smooth.with_normals("flat").parts[0].mesh
    assert again.normals is None
    assert (again.content_hash == flat.parts[0].mesh.content_hash) != (cube.content_hash == again.content_hash)


def test_normals_of_a_sheet_with_two_sides_are_those_of_one_of_them(read: Read) -> None:
    sheet = read("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 3 2\n").with_normals("smooth").parts[0].mesh
    assert np.abs(sheet.normals).tolist() == [[0, 0, 1]] * 3


def test_zero_normals_of_a_file_become_smooth_ones_and_others_unit_ones(read: Read) -> None:
    faces = "".join("f " + " ".join(f"{v}//{v}" for v in side.split()) + "\n" for side in SIDES)
    rows = "".join("vn 0 0 0\n" if k % 2 else "vn 3e-30 0 -4e-30\n" for k in range(8))
    cube = read("a.obj", CUBE + rows + faces).parts[0].mesh
    diagonals = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / np.sqrt(3)
    diagonals[::2] = 0.6, 0, -0.8
    places = (np.sign(cube.positions) + 1) / 2 @ [4, 2, 1]
    np.testing.assert_allclose(cube.normals, diagonals[places.astype(int)], atol=1e-6)
