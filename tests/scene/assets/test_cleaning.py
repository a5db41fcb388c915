"""Triangles that cannot be used are dropped and counted; polygons become triangles that cover them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rptcam_cl.scene.assets.mesh import NO_AREA, NOT_FINITE, TWICE, Polygons, as_triangles, sound_faces, winding_number

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


@settings(max_examples=150)
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


def test_polygon_of_a_million_corners_is_a_fan() -> None:
    angles = 2 * np.pi * np.arange(1_000_000) / 1_000_000
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
