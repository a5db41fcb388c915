"""Camera models and maps against pictures that the renderer makes of boards, even light and edges."""

import numpy as np
import pytest

from rptcam_cl.api.job import render
from rptcam_cl.exchange.camera_maps import point_images, st_maps, vignetting_map
from rptcam_cl.exchange.camera_models import calibrate, view
from rptcam_cl.scene.load import load_scene
from tests.exchange.calibration.test_maps import places_of, sampled

pytestmark = pytest.mark.slow

LIT = {"kind": "emissive", "radiance": 1}
SQUARES, SQUARE_M, DISTANCE_M = (8, 5), 0.08, 1.2


def camera(**changes):
    return {
        "kind": "realistic", "lens": "dgauss-50mm", "eye": [0, 0, 0], "target": [0, 0, -1], "f_number": 11,
        "focus": {"distance_m": DISTANCE_M},
    } | changes  # fmt: skip


def board():
    """The bright squares of a chess board in the plane of focus, and the corners between four squares."""
    left, bottom = (-count * SQUARE_M / 2 for count in SQUARES)
    squares = [
        {"shape": "rectangle", "corner": [left + i * SQUARE_M, bottom + j * SQUARE_M, -DISTANCE_M],
         "edge_u": [SQUARE_M, 0, 0], "edge_v": [0, SQUARE_M, 0], "material": LIT}
        for i in range(SQUARES[0]) for j in range(SQUARES[1]) if (i + j) % 2 == 0
    ]  # fmt: skip
    inner = [(left + i * SQUARE_M, bottom + j * SQUARE_M) for j in range(1, SQUARES[1]) for i in range(1, SQUARES[0])]
    return squares, np.array([[x, y, -DISTANCE_M] for x, y in inner])


def rendered(scene, spp):
    return np.asarray(render(scene | {"render": {"max_depth": 1}}, spp=spp, seed=5).pixels[..., 1], np.float64)


@pytest.fixture(scope="module")
def seen_corners():
    """A view, the corners of a board in it (n, 3) by x right, y down, z ahead, and where OpenCV finds them."""
    cv2 = pytest.importorskip("cv2")
    squares, corners = board()
    # The detector takes the picture for a smooth one: a wide filter, and no edge along rows or columns.
    film = {"resolution": [480, 320], "size_mm": [36, 24], "filter": {"kind": "gaussian", "radius_px": 3}}
    scene = {"film": film, "camera": camera(up=[0.17, 1, 0]), "objects": squares}
    seen = view(load_scene(scene))
    pose = np.linalg.inv(seen.pose())
    points = corners @ pose[:3, :3].T + pose[:3, 3]
    guess = calibrate(seen, "brown_conrady").project(points)
    picture = np.clip(rendered(scene, 256) * 200, 0, 255).astype(np.float32)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    found = cv2.cornerSubPix(picture, (guess - 0.5).astype(np.float32).reshape(-1, 1, 2), (9, 9), (-1, -1), stop)
    return seen, points, found.reshape(-1, 2).astype(np.float64) + 0.5


def test_model_meets_rendered_corners(seen_corners):
    seen, points, found = seen_corners
    off = np.linalg.norm(calibrate(seen, "brown_conrady").project(points) - found, axis=1)
    assert off.max() <= 0.05


def test_st_map_meets_rendered_corners(seen_corners):
    seen, points, found = seen_corners
    maps = st_maps(seen)
    straight = places_of(sampled(maps.distort, found), maps.undistort.shape[1::-1])
    expected = points[:, :2] / points[:, 2:] * maps.focal_px + maps.centre_px
    assert np.linalg.norm(straight - expected, axis=1).max() <= 0.05


@pytest.mark.parametrize("lens", ["dgauss-50mm", "wide-22mm"])
def test_vignetting_map_meets_a_white_field(lens):
    scene = {
        "film": {"resolution": [48, 32], "size_mm": [36, 24]},
        "camera": camera(lens=lens, f_number=2.8),
        "environment": {"kind": "constant", "radiance": 1},
    }
    picture, expected = rendered(scene, 4096), vignetting_map(view(load_scene(scene))).astype(np.float64)
    blocks = [values.reshape(4, 8, 6, 8).mean(axis=(1, 3)) for values in (picture, expected)]
    assert blocks[0] == pytest.approx(blocks[1], rel=5e-3)


FINER = 5  # pixels of the fine picture to one


def edge_scene(finer):
    """An edge behind the plane of focus, away from the middle of the picture, slanted by 6 degrees."""
    up, along = np.array([np.sin(np.radians(6)), np.cos(np.radians(6)), 0.0]), np.array([0.3, 0.0, 0.0])
    middle = np.array([0.12, 0.06, -1.4])
    return {
        "film": {"resolution": [600 * finer, 400 * finer], "size_mm": [36, 24], "crop": [0.61, 0.77, 0.26, 0.5]},
        "camera": camera(f_number=4),
        "objects": [{"shape": "rectangle", "corner": (middle - 0.3 * up).tolist(), "edge_u": along.tolist(),
                     "edge_v": (0.6 * up).tolist(), "material": LIT}],
    }, middle, up  # fmt: skip


def mtf(picture, distance):
    """Transfer over frequency by the edge's profile at quarters of a pixel."""
    bins = np.floor(distance * 4 + 64).astype(int)
    inside = (bins >= 0) & (bins < 128)
    profile = np.bincount(bins[inside], picture[inside], 128) / np.bincount(bins[inside], minlength=128)
    response = np.abs(np.fft.rfft(np.gradient(profile) * np.hanning(128)))
    return response / response[0]


def test_kernels_blur_an_edge_as_the_renderer_does():
    from scipy.signal import fftconvolve

    scene, middle, up = edge_scene(1)
    fine = view(load_scene(edge_scene(FINER)[0]), 1.4 - view(load_scene(scene)).pupil_ahead_mm * 1e-3)
    kernel = point_images(fine, (1, 1), across=256).kernels[0, 0, 0, 0].astype(np.float64)
    columns, rows = fine.size
    places = np.stack(np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5), axis=-1).reshape(-1, 2)
    model = calibrate(fine, "brown_conrady")
    pose = np.linalg.inv(fine.pose())
    ends = (np.array([middle - 0.2 * up, middle + 0.2 * up])) @ pose[:3, :3].T + pose[:3, 3]
    low, high = model.project(ends)
    normal = np.array([high[1] - low[1], low[0] - high[0]]) / np.linalg.norm(high - low)
    away = (places - low) @ normal
    away *= np.sign(normal[0])  # the bright side lies to the right
    sharp = np.clip(away + 0.5, 0, 1).reshape(rows, columns)
    wide = np.pad(sharp, 80, mode="edge")
    blurred = fftconvolve(wide, kernel, mode="same")[80:-80, 80:-80]
    small = blurred.reshape(rows // FINER, FINER, columns // FINER, FINER).mean(axis=(1, 3))
    picture = rendered(scene, 1024)
    distance = away.reshape(rows // FINER, FINER, columns // FINER, FINER).mean(axis=(1, 3)) / FINER
    assert small.shape == picture.shape
    ours, theirs = mtf(small, distance), mtf(picture, distance)
    assert 0.1 < theirs[8] < 0.9  # at a quarter of a cycle per pixel: the blur counts
    assert np.abs(ours - theirs)[:17].max() <= 0.01
