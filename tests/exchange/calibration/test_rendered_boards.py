"""OpenCV calibrates a lens from rendered views of a board, and finds what the float64 chief rays of the lens say."""

from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.exchange.camera_models import calibrate, view

SIZE = (768, 576)
# Tilts, swings and turns [degrees]: steep ones part the focal length from the distance.
VIEWS = [
    (0, 0, 0), (38, 0, 10), (-38, 5, -20), (0, 40, 40), (5, -40, 70), (28, 28, -50), (-28, 30, 15), (26, -32, 95),
    (-25, -25, 130), (35, 15, -100), (-15, 38, 170), (15, -38, -150), (40, -12, 60), (-40, -10, -70),
]  # fmt: skip


def scene(number: int) -> rptcam_cl.Scene:
    """Return a view of a board 0.8 m wide, 1.9 m away: nearer ones see the drift of the entrance pupil (0.05 %)."""
    axes = zip(([1, 0, 0], [0, 1, 0], [0, 0, 1]), VIEWS[number], strict=True)
    tilt, swing, turn = ({"rotate": {"axis": axis, "degrees": degrees}} for axis, degrees in axes)
    aside = {"translate": [0.12 * np.cos(2.1 * number), 0.09 * np.sin(1.7 * number), 0]}
    board: dict[str, Any] = {"kind": "charuco", "columns": 13, "rows": 9, "pitch": 0.063, "dictionary": "DICT_4X4_100"}
    content = {
        "film": {"resolution": SIZE, "width_mm": 30},
        "camera": {
            "kind": "realistic", "lens": "dgauss-50mm", "f_number": 11, "focus": {"distance_m": 1.86},
            "eye": [0, 0, 1.86], "target": [0, 0, 0],
        },
        "objects": [board | {"shape": "board", "transform": [turn, tilt, swing, aside]}],
        "environment": {"kind": "constant", "radiance": 1},
        "render": {"max_depth": 2, "spp": 36},
    }  # fmt: skip
    return rptcam_cl.load_scene(content)


@pytest.mark.slow
def test_focal_length_of_rendered_boards_is_that_of_the_lens() -> None:
    cv2 = pytest.importorskip("cv2")
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_100)
    board = cv2.aruco.CharucoBoard((13, 9), 0.063, 0.04725, dictionary)
    detector = cv2.aruco.CharucoDetector(board)
    points, places = [], []
    for number in range(len(VIEWS)):
        film = np.asarray(rptcam_cl.render(scene(number)))[..., 1]
        codes = np.clip(film / np.percentile(film, 99.5) * 230, 0, 255).astype(np.uint8)
        corners, ids, _, _ = detector.detectBoard(codes)
        points.append(board.getChessboardCorners()[ids.ravel()].astype(np.float32))
        places.append((corners.reshape(-1, 2) + 0.5).astype(np.float32))
    assert sum(map(len, places)) > 1000
    rms, matrix, *_ = cv2.calibrateCamera(points, places, SIZE, None, None)
    exact = calibrate(view(scene(0)), "brown_conrady").named
    assert rms <= 0.15
    assert abs(matrix[0, 0] / exact["fx"] - 1) <= 3e-4
