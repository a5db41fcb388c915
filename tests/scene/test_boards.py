"""Boards: their keys, the bits of their markers against OpenCV, and patterns that cover the board once."""

import re
from typing import Any

import cv2
import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.shapes import DICTIONARIES, Board, marker_bits

KINDS = ("checker", "charuco", "aruco", "circles", "siemens", "slanted_edge")


def board(kind: str, **keys: Any) -> Board:
    scene = {
        "camera": {"kind": "pinhole", "eye": [0, 0, 1], "target": [0, 0, 0], "fov_degrees": 40},
        "objects": [{"shape": "board", "kind": kind} | keys],
    }  # fmt: skip
    found = load_scene(scene).objects[0]
    assert isinstance(found, Board)
    return found


@pytest.mark.parametrize(
    "name", ["DICT_4X4_1000", "DICT_5X5_1000", "DICT_6X6_250", "DICT_7X7_1000", "DICT_APRILTAG_36h11"]
)
def test_bits_of_markers_are_those_of_opencv(name: str) -> None:
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    count = DICTIONARIES[name][1]
    assert count == len(known.bytesList)
    for number in (0, 1, count // 2, count - 1):
        bits = cv2.aruco.Dictionary_getBitsFromByteList(known.bytesList[number : number + 1], known.markerSize)
        np.testing.assert_array_equal(marker_bits(name, number), np.asarray(bits).reshape(2 * (known.markerSize,)) > 0)
    with pytest.raises(InputError, match=f"has no marker {count}"):
        marker_bits(name, count)


@pytest.mark.parametrize("kind", KINDS)
def test_dark_and_light_cover_the_board_once(kind: str) -> None:
    item = board(kind)
    areas = []
    for surface in item.pattern.surfaces():
        a, b, c = (surface.positions[surface.faces[:, k], :2] for k in range(3))
        twice = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
        assert twice.min() > 0  # fronts face +z
        areas.append(twice.sum() / 2)
    whole = item.pattern.width * item.pattern.height
    assert sum(areas) == pytest.approx(whole, rel=1e-9)
    if kind == "circles":
        assert areas[0] == pytest.approx(35 * np.pi * (0.75 * 0.03 / 2) ** 2, rel=1e-9)
    if kind == "siemens":
        assert areas[0] == pytest.approx(np.pi * (0.75 * 0.03 / 2) ** 2 / 2, rel=1e-9)
    low, high = item.bounds()
    np.testing.assert_allclose(high - low, [item.pattern.width, item.pattern.height, 0])


def is_dark(item: Board, points: np.ndarray) -> np.ndarray:
    """Whether points (n, 2) of a board lie on its dark part."""
    dark = item.pattern.surfaces()[0]
    a, b, c = (dark.positions[dark.faces[:, k], None, :2] for k in range(3))
    left = [
        (q - p)[..., 0] * (points - p)[..., 1] >= (q - p)[..., 1] * (points - p)[..., 0]
        for p, q in ((a, b), (b, c), (c, a))
    ]
    return np.asarray(np.all(left, axis=0).any(axis=0))


def picture_of_opencv(kind: str) -> np.ndarray:
    """A board of 5 x 3 squares, 40 pixels each, whose markers fill three quarters of them."""
    known, numbers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), np.arange(6, 6 + 15)
    if kind == "charuco":
        return np.asarray(cv2.aruco.CharucoBoard((5, 3), 0.04, 0.03, known, numbers[:7]).generateImage((200, 120)))
    markers = cv2.aruco.GridBoard((5, 3), 0.03, 0.01, known, numbers)
    return np.asarray(markers.generateImage((200, 120), marginSize=5))


@pytest.mark.parametrize("kind", KINDS)
def test_each_point_is_dark_or_light_as_it_should_be(kind: str) -> None:
    """Against pictures of OpenCV for markers, and against a formula for other kinds."""
    grid = kind not in ("siemens", "slanted_edge")
    keys = ({"columns": 5, "rows": 3} if grid else {}) | ({"first_id": 6} if kind.endswith("aruco") else {})
    item = board(kind, pitch=0.04, margin=0.25, **keys)
    sides = np.array([5, 3] if grid else [1, 1])
    np.testing.assert_allclose([item.pattern.width, item.pattern.height], (sides + 0.5) * 0.04)
    right, down = np.random.default_rng(3).uniform(-0.25, sides + 0.25, (3000, 2)).T  # in squares, from the upper left
    inside = (right > 0) & (right < sides[0]) & (down > 0) & (down < sides[1])
    radius, clear = np.hypot(right % 1 - 0.5, down % 1 - 0.5), np.ones(3000, bool)
    match kind:
        case "charuco" | "aruco":
            picture = picture_of_opencv(kind)
            rows, columns = (at.clip(0, side - 1).astype(int) for at, side in ((down * 40, 120), (right * 40, 200)))
            expected = picture[rows, columns] == 0
            clear = np.abs(np.array([right, down]) * 8 % 1 - 0.5).max(axis=0) < 0.49  # off the edges of cells
        case "checker":
            expected = (right.astype(int) + down.astype(int)) % 2 == 0
        case "circles":
            expected, clear = radius < 0.375, np.abs(radius - 0.375) > 1e-3  # a rim of 96 corners
        case "siemens":
            sector = np.arctan2(0.5 - down, right - 0.5) / np.pi * item.sectors
            expected, clear = (np.floor(sector) % 2 == 0) & (radius < 0.375), np.abs(radius - 0.375) > 1e-3
        case _:
            expected = right - 0.5 < (0.5 - down) * np.tan(np.radians(item.angle_degrees))
    found = is_dark(item, np.stack([right - sides[0] / 2, sides[1] / 2 - down], axis=1) * 0.04)
    np.testing.assert_array_equal(found[clear], (expected & inside)[clear])
    assert clear.mean() > 0.9
    assert 0.1 < found[inside].mean() < 0.9


def test_points_of_a_charuco_board_are_those_of_opencv() -> None:
    item = board("charuco", columns=7, rows=5, pitch=0.04)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    known = cv2.aruco.CharucoBoard((7, 5), 0.04, 0.03, dictionary)
    flip, shift = np.array([1, -1]), np.array([-0.14, 0.1])  # OpenCV counts from the upper left corner, y down
    np.testing.assert_allclose(item.pattern.corners, known.getChessboardCorners()[:, :2] * flip + shift, atol=1e-6)
    ours = [corners for _, corners in item.pattern.markers]
    np.testing.assert_allclose(ours, np.array(known.getObjPoints())[..., :2] * flip + shift, atol=1e-6)
    assert [number for number, _ in item.pattern.markers] == known.getIds().ravel().tolist()


def test_metadata_take_points_to_the_world() -> None:
    step = [{"rotate": {"axis": [0, 1, 0], "degrees": 90}}, {"translate": [1, 2, 3]}]
    said = board("checker", columns=2, rows=2, transform=step).described(0, 0.0, 10.0)
    np.testing.assert_allclose(said["corners"], [[10, 20, 30]], atol=1e-12)
    assert said | {"corners": 0} == {
        "object": 0, "name": "objects.0", "kind": "checker", "pitch_m": 0.3, "columns": 2, "rows": 2, "corners": 0,
        "ids": [0],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "keys", "message"),
    [
        ("checker", {"fill": 0.5}, "objects[0].fill: means nothing on a board of kind checker"),
        ("siemens", {"rows": 3}, "objects[0].rows: means nothing on a board of kind siemens"),
        ("checker", {"columns": 1}, "objects[0].columns: leaves no corner where squares meet"),
        ("aruco", {"dictionary": "DICT_4X4_5"}, "objects[0].dictionary: is no known dictionary"),
        (
            "aruco",
            {"columns": 10, "rows": 6},
            "objects[0].dictionary: has fewer markers than the board needs, up to number 59",
        ),
        ("charuco", {"first_id": 40}, "objects[0].dictionary: has fewer markers"),
        ("stripes", {}, "objects[0].kind: is not a known choice"),
        ("checker", {"pitch": 0}, "objects[0].pitch: "),
        ("slanted_edge", {"angle_degrees": 60}, "objects[0].angle_degrees: "),
    ],
)
def test_wrong_boards_are_refused(kind: str, keys: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        board(kind, **keys)
