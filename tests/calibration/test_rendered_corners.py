"""Camera models against rendered boards: OpenCV finds corners where it projects them by the exported model."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

import rptcam_cl
from rptcam_cl.calibration import Calibration, View, calibrate, view, vignetting_map

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]
ALLOWED_PX = 0.05
HALF_WINDOW = 9  # of OpenCV's search [pixels]


class Case(NamedTuple):
    """A lens, the model that stands for it, the picture [pixels], the film [mm], and how it is taken."""

    lens: str
    model: str
    size: tuple[int, int]
    film_mm: tuple[float, float]
    f_number: float  # so high that coma and vignetting move no light away from chief rays
    squares: int  # across the picture
    spp: int


CASES = [
    Case("dgauss-50mm", "brown_conrady", (480, 320), (36.0, 24.0), 32, 8, 256),
    Case("wide-22mm", "brown_conrady", (480, 320), (36.0, 24.0), 32, 8, 256),
    Case("retrofocus-28mm", "brown_conrady", (480, 320), (36.0, 24.0), 32, 8, 256),
    Case("zoom-35-51mm", "brown_conrady", (480, 320), (36.0, 24.0), 32, 8, 256),
    Case("phone-5.6mm", "rational", (144, 108), (5.6, 4.2), 8, 5, 1024),
]
DISTANCE_M = 2.0


def content(case: Case, objects: list[dict[str, Any]]) -> dict[str, Any]:
    """A scene; the detector takes pictures for smooth ones, so that the filter is wide."""
    return {
        "film": {"resolution": case.size, "size_mm": case.film_mm, "filter": {"kind": "gaussian", "radius_px": 3}},
        "camera": {
            "kind": "realistic", "lens": case.lens, "f_number": case.f_number, "eye": [0, 0, 0], "target": [0, 0, -1],
            "focus": {"distance_m": DISTANCE_M},
        },
        "objects": objects,
        "environment": {"kind": "constant", "radiance": 1},
        "render": {"max_depth": 2, "spp": case.spp, "seed": 5},
    }  # fmt: skip


def scene_of(case: Case) -> rptcam_cl.Scene:
    """A checker board in the plane of focus that fills the picture, turned so that no edge lies along rows."""
    bare = view(rptcam_cl.load_scene(content(case, [])))
    (left, *_), _ = bare.directions([[0.0, case.size[1] / 2]])
    half_m = abs(left[0] / left[2]) * bare.distance_m
    turned = {"rotate": {"axis": [0, 0, 1], "degrees": 10}}
    board = {
        "shape": "board", "kind": "checker", "columns": case.squares + 4, "rows": case.squares + 4,
        "pitch": 2 * half_m / case.squares, "transform": [turned, {"translate": [0, 0, -DISTANCE_M]}],
    }  # fmt: skip
    return rptcam_cl.load_scene(content(case, [board]))


def projected(cv2: Any, found: Calibration, points: Array) -> Array:
    """Places of points [m] by OpenCV, from the corner of the picture."""
    fx, fy, cx, cy = found.parameters[:4]
    matrix = np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]])
    at, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, np.array(found.coefficients))
    return np.asarray(at.reshape(-1, 2) + 0.5)


def corners_seen(seen: View, image: rptcam_cl.Image) -> Array:
    """The corners of the board, x right, y down, z ahead of the entrance pupil [m]."""
    pose = np.linalg.inv(seen.pose())
    (board,) = image.metadata["boards"]
    return np.asarray(np.array(board["corners"]) @ pose[:3, :3].T + pose[:3, 3])


@pytest.mark.parametrize("case", CASES, ids=[case.lens for case in CASES])
def test_opencv_finds_rendered_corners_where_the_model_says(case: Case) -> None:
    cv2 = pytest.importorskip("cv2")
    scene = scene_of(case)
    seen, image = view(scene), rptcam_cl.render(scene)
    at = projected(cv2, calibrate(seen, case.model), corners_seen(seen, image))
    margin = HALF_WINDOW + 3
    at = at[((at > margin) & (at < np.array(case.size) - margin)).all(axis=1)]
    at = at[seen.directions(at)[1]]
    assert len(at) >= 12
    # The falloff of the light would draw corners to the middle.
    falloff = vignetting_map(seen).astype(np.float64)
    even = np.where(falloff > 0.02, np.asarray(image)[..., 1] / np.maximum(falloff, 0.02), 0.0)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    start, window = (at - 0.5).astype(np.float32).reshape(-1, 1, 2), (HALF_WINDOW, HALF_WINDOW)
    found = cv2.cornerSubPix((255 * even / even.max()).astype(np.float32), start, window, (-1, -1), stop)
    off = np.linalg.norm(found.reshape(-1, 2) + 0.5 - at, axis=1)
    assert off.max() <= ALLOWED_PX
    assert off.max() > 1e-4  # the search has moved
