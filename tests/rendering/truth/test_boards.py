"""OpenCV finds the points of boards in a rendered picture where the metadata say that they are."""

import json
from typing import Any

import cv2
import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.rendering.cameras.chief_rays import seen_places
from rptcam_cl.rendering.cameras.kinds import camera_of
from rptcam_cl.scene.load import load_scene

BOARDS: dict[str, dict[str, Any]] = {
    "checker": {"kind": "checker", "columns": 7, "rows": 5},
    "charuco": {"kind": "charuco", "columns": 7, "rows": 5, "margin": 0.2},
    "aruco": {"kind": "aruco", "columns": 4, "rows": 3, "pitch": 0.045},
    "circles": {"kind": "circles", "columns": 7, "rows": 5, "fill": 0.5},
}
HALF = (240, 180)  # of the picture [pixels]


@pytest.fixture(scope="module")
def picture(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], np.ndarray, dict[str, np.ndarray]]:
    """The metadata of four boards through a lens, the picture in 8 bits, and where their points are to be seen."""
    objects = [
        {"shape": "board", "name": name, "transform": [
            {"rotate": {"axis": [1, 2, 0], "degrees": 8}},
            {"translate": [0.13 * (2 * (k % 2) - 1), 0.098 * (1 - k // 2 * 2), 0]},
        ]} | keys
        for k, (name, keys) in enumerate(BOARDS.items())
    ]  # fmt: skip
    camera = {"kind": "realistic", "lens": "dgauss-50mm", "f_number": 8, "eye": [0, 0, 0.83], "target": [0, 0, 0]}
    scene = {
        "film": {"resolution": [480, 360], "width_mm": 34}, "camera": camera | {"focus": {"distance_m": 0.83}},
        "objects": objects, "environment": {"kind": "constant", "radiance": 1.0}, "render": {"max_depth": 2},
    }  # fmt: skip
    image = rptcam_cl.render(scene, spp=36)
    path = tmp_path_factory.mktemp("boards") / "picture.npz"
    image.save(path)
    metadata = json.loads(str(np.load(path)["metadata"]))
    loaded = load_scene(scene)
    back, chief = np.linalg.inv(np.array(metadata["world_from_camera"])), camera_of(loaded).chief_rays()
    seen = {}
    for board in metadata["boards"]:
        points = np.hstack([board["corners"], np.ones((len(board["corners"]), 1))]) @ back.T
        seen[board["name"]] = seen_places(chief, points)
    codes = np.clip(np.asarray(image)[..., 1] / 0.9 * 255, 0, 255).astype(np.uint8)
    return metadata, codes, seen


def quarter(codes: np.ndarray, index: int) -> tuple[np.ndarray, np.ndarray]:
    """A quarter of the picture, and where it begins."""
    column, row = index % 2 * HALF[0], index // 2 * HALF[1]
    return np.ascontiguousarray(codes[row : row + HALF[1], column : column + HALF[0]]), np.array([column, row])


@pytest.mark.slow
def test_checker_corners_are_found_where_metadata_say(picture: Any) -> None:
    part, start = quarter(picture[1], 0)
    found, corners = cv2.findChessboardCorners(part, (6, 4))
    assert found
    corners = cv2.cornerSubPix(part, corners, (4, 4), (-1, -1), (3, 100, 1e-5)).reshape(-1, 2) + 0.5 + start
    expected = picture[2]["checker"]
    if np.linalg.norm(corners[0] - expected[0]) > 10:  # OpenCV may begin at the other end
        expected = expected[::-1]
    beside = corners - expected
    assert np.abs(beside.mean(axis=0)).max() < 0.04
    assert np.sqrt((beside**2).sum(axis=1).mean()) < 0.12  # OpenCV's scatter, whose window is nine pixels wide


def test_charuco_corners_are_found_with_their_ids_where_metadata_say(picture: Any) -> None:
    part, start = quarter(picture[1], 1)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.CharucoBoard((7, 5), 0.03, 0.0225, dictionary)
    corners, ids, _, markers = cv2.aruco.CharucoDetector(board).detectBoard(cv2.resize(part, None, fx=2, fy=2))
    assert len(ids) >= 20
    assert len(markers) >= 14
    places = (corners.reshape(-1, 2) + 0.5) / 2 + start
    assert np.abs(places - picture[2]["charuco"][ids.ravel()]).max() < 0.2


def test_markers_are_found_with_their_ids_where_metadata_say(picture: Any) -> None:
    part, start = quarter(picture[1], 2)
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    detector_settings = detector.getDetectorParameters()
    detector_settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector_settings.cornerRefinementWinSize = 3
    detector.setDetectorParameters(detector_settings)
    corners, ids, _ = detector.detectMarkers(part)
    expected = picture[2]["aruco"].reshape(-1, 4, 2)
    assert sorted(ids.ravel().tolist()) == list(range(12))
    for number, found in zip(ids.ravel().tolist(), corners, strict=True):
        assert np.abs(found.reshape(4, 2) + 0.5 + start - expected[number]).max() < 0.5


def test_circles_are_found_where_metadata_say(picture: Any) -> None:
    part, start = quarter(picture[1], 3)
    found, middles = cv2.findCirclesGrid(part, (7, 5))
    assert found
    away = np.linalg.norm(middles.reshape(-1, 1, 2) + 0.5 + start - picture[2]["circles"][None], axis=2)
    assert sorted(np.argmin(away, axis=1).tolist()) == list(range(35))
    assert away.min(axis=1).max() < 0.25  # by the pixels of a blob, as OpenCV counts
