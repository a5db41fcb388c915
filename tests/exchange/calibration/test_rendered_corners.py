"""Camera models against rendered boards: OpenCV finds corners where it projects them by the exported model.

Through a fisheye squares are bent, and the corner search of OpenCV takes edges for straight: with a window of 9 pixels
it errs by up to 0.06 px on chief rays without noise or blur, at 480 pixels across 21 mm. So it searches in patches of
the picture that are made straight first, where it errs by 0.02 px.
"""

from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

import rptcam_cl
from rptcam_cl.exchange.camera_maps import vignetting_map
from rptcam_cl.exchange.camera_models import Calibration, CameraView, calibrate, view

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
    Case("fisheye-10mm", "kannala_brandt", (480, 360), (21.0, 15.75), 32, 8, 512),
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
    by = cv2.fisheye if found.model == "kannala_brandt" else cv2
    at, _ = by.projectPoints(points.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), matrix, np.array(found.coefficients))
    return np.asarray(at.reshape(-1, 2) + 0.5)


def boards_seen(seen: CameraView, image: rptcam_cl.Image) -> list[Array]:
    """The corners of each board by rows (rows, columns, 3), x right, y down, z ahead of the entrance pupil [m]."""
    pose = np.linalg.inv(seen.pose())
    return [
        np.reshape(np.array(board["corners"]) @ pose[:3, :3].T + pose[:3, 3], (board["rows"] - 1, -1, 3))
        for board in image.metadata["boards"]
    ]


def even_light(seen: CameraView, image: rptcam_cl.Image) -> Array:
    """The picture without the falloff of the light, which would draw corners to the middle."""
    falloff = vignetting_map(seen).astype(np.float64)
    even = np.where(falloff > 0.02, np.asarray(image)[..., 1] / np.maximum(falloff, 0.02), 0.0)
    return np.asarray(255 * even / even.max())


def found_by_opencv(cv2: Any, picture: Array, at: Array, half_window: int) -> Array:
    """Corners (n, 2) that OpenCV finds from places near them, from the corner of the picture."""
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    start = (at - 0.5).astype(np.float32).reshape(-1, 1, 2)
    found = cv2.cornerSubPix(picture.astype(np.float32), start, (half_window, half_window), (-1, -1), stop)
    return np.asarray(found.reshape(-1, 2) + 0.5)


def found_in_patches(
    cv2: Any, found: Calibration, picture: Array, board: Array, which: Array, half_window: int
) -> Array:
    """The same for some corners of a board (rows, columns), each in a patch in which the board's lines are straight.

    A patch shows the board's plane by the derivatives of the projection at its corner, as large as the picture does.
    """
    sides = board[0, 1] - board[0, 0], board[1, 0] - board[0, 0]
    reach = half_window + 3
    offset = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1.0)] * 2), axis=-1).reshape(-1, 2)
    places = []
    for corner in board[which]:
        beside = projected(cv2, found, np.array([corner + s * 1e-3 * side for side in sides for s in (1, -1)]))
        slopes = np.stack([beside[0] - beside[1], beside[2] - beside[3]], axis=1) / 2e-3
        there = np.linalg.solve(slopes, offset.T).T @ sides + corner
        at = projected(cv2, found, there)[:, ::-1].T - 0.5
        patch = map_coordinates(picture, at, order=3).reshape(2 * reach + 1, -1)
        corner_there = found_by_opencv(cv2, patch, np.array([[reach + 0.5, reach + 0.5]]), half_window)[0] - reach - 0.5
        places.append(projected(cv2, found, corner + np.linalg.solve(slopes, corner_there) @ sides)[0])
    return np.array(places)


def inside(seen: CameraView, at: Array, margin: int) -> Array:
    """Which places lie well in the picture and have light."""
    clear = ((at > margin) & (at < np.array(seen.size) - margin)).all(axis=1)
    clear[clear] = seen.directions(at[clear])[1]
    return clear


@pytest.mark.parametrize("case", CASES, ids=[case.lens for case in CASES])
def test_opencv_finds_rendered_corners_where_the_model_says(case: Case) -> None:
    cv2 = pytest.importorskip("cv2")
    scene = scene_of(case)
    seen, image = view(scene), rptcam_cl.render(scene)
    model = calibrate(seen, case.model)
    (board,) = boards_seen(seen, image)
    at = projected(cv2, model, board.reshape(-1, 3))
    known = inside(seen, at, HALF_WINDOW + 3)
    assert known.sum() >= 12
    picture = even_light(seen, image)
    if case.model == "kannala_brandt":
        found = found_in_patches(cv2, model, picture, board, known.reshape(board.shape[:2]), HALF_WINDOW)
    else:
        found = found_by_opencv(cv2, picture, at[known], HALF_WINDOW)
    off = np.linalg.norm(found - at[known], axis=1)
    assert off.max() <= ALLOWED_PX
    assert off.max() > 1e-4  # the search has moved


# Of the boards that face the fisheye: angles from the axis, and round it from the left upwards [degrees].
AROUND = [(12, 45), (38, 15), (38, 65), (64, 0), (64, 34)]


def boards_around() -> rptcam_cl.Scene:
    """Boards as far away as the focus, each facing the camera, in the upper left quarter of its image circle."""
    case = Case("fisheye-10mm", "kannala_brandt", (960, 711), (27.0, 20.0), 32, 0, 1024)
    bare = view(rptcam_cl.load_scene(content(case, [])))
    board = {"shape": "board", "kind": "checker", "columns": 5, "rows": 5, "pitch": 0.078 * bare.distance_m}
    boards = []
    for off_axis, upwards in AROUND:
        axes_and_angles = [([0, 0, 1], 15), ([0, 1, 0], off_axis), ([0, 0, 1], -upwards)]
        turned, aside, round_axis = ({"rotate": {"axis": axis, "degrees": angle}} for axis, angle in axes_and_angles)
        away = {"translate": [0, 0, -bare.distance_m]}
        pupil = {"translate": [0, 0, -bare.pupil_ahead_mm * 1e-3]}
        boards.append(board | {"transform": [turned, away, aside, round_axis, pupil]})
    scene = content(case, boards)
    scene["film"]["crop"] = [0, 0.5, 0, 0.5]
    return rptcam_cl.load_scene(scene)


def from_drifting_pupil(seen: CameraView, points: Array) -> Array:
    """Points (n, 3) as the pupil sees them that lies where the chief rays of their angle cross the axis."""
    drift = seen.drift_by_angle()
    assert drift is not None
    there = points
    for _ in range(3):
        angle = np.degrees(np.arctan2(np.hypot(there[:, 0], there[:, 1]), there[:, 2]))
        there = points - np.interp(angle, drift[0], drift[1])[:, None] * [0.0, 0.0, 1e-3]
    return there


def test_fisheye_meets_boards_that_face_it_to_the_edge_of_its_circle() -> None:
    cv2 = pytest.importorskip("cv2")
    scene = boards_around()
    image = rptcam_cl.render(scene)
    sphere, plane, far = (view(scene, None, "sphere"), view(scene, None, "plane"), view(scene, np.inf))
    by_sphere, by_plane, by_far = (calibrate(seen, "kannala_brandt") for seen in (sphere, plane, far))
    picture = even_light(sphere, image)
    off: list[Array] = []
    widest = 0.0
    for board in boards_seen(sphere, image):
        points = board.reshape(-1, 3)
        at = projected(cv2, by_sphere, points)
        known = inside(sphere, at, HALF_WINDOW + 3)
        found = found_in_patches(cv2, by_sphere, picture, board, known.reshape(board.shape[:2]), HALF_WINDOW)
        drifting = projected(cv2, by_far, from_drifting_pupil(far, points))
        places = at, drifting, projected(cv2, by_plane, points), projected(cv2, by_far, points)
        off.append(np.stack([np.linalg.norm(place[known] - found, axis=1) for place in places]))
        widest = max(widest, *np.degrees(np.arctan2(np.hypot(*points[known, :2].T), points[known, 2])))
    worst = np.concatenate(off, axis=1).max(axis=1)
    assert widest > 70.0
    assert worst[:2].max() <= ALLOWED_PX  # the model of the distance, and that of far objects with the drift
    assert worst[2] > 0.2  # the model of a plane as far on the axis
