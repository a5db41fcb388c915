"""Scenes for the tests of layers, and the float64 geometry that they are compared with."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

import rptcam_cl
from rptcam_cl.scene.load import load_scene

EYE, TARGET, UP = [1.0, 2.0, 6.0], [0.5, 0.3, 0.0], [0.1, 1.0, 0.0]
POSE = {"eye": EYE, "target": TARGET, "up": UP}
BALL = {"shape": "sphere", "center": [0.4, 0.5, 0.2], "radius": 1.2, "name": "ball"}
FLOOR = {"shape": "rectangle", "corner": [-9, -1, -9], "edge_u": [18, 0, 3], "edge_v": [0, 0, 18], "name": "floor"}
RED = {"kind": "matte", "reflectance": [0.6, 0.2, 0.1]}
GREY = {"kind": "matte", "reflectance": 0.5}

CAMERAS: dict[str, dict[str, Any]] = {
    "pinhole": {"kind": "pinhole", "fov_degrees": 50},
    "environment": {"kind": "environment"},
    "thin_lens": {"kind": "thin_lens", "fov_degrees": 40, "aperture_radius_m": 0.2, "focus_distance_m": 4},
    "thick_lens": {"kind": "thick_lens", "lens": "dgauss-50mm", "focus": {"distance_m": 4}},
    "double_gauss": {"kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 4}},
    "fisheye": {"kind": "realistic", "lens": "fisheye-10mm", "focus": {"distance_m": 4}},
}


def world(camera: str, **rest: Any) -> dict[str, Any]:
    """Return a ball over a floor, under an empty sky, as a mapping."""
    return {
        "film": {"resolution": [48, 24]},
        "camera": CAMERAS[camera] | POSE,
        "objects": [BALL | {"material": "red"}, FLOOR | {"material": GREY}],
        "materials": {"unused": GREY, "red": RED},
        "environment": {"kind": "constant", "radiance": 1.0},
    } | rest


def one_sample(scene: dict[str, Any], layers: list[str], **options: Any) -> rptcam_cl.Image:
    """Return an image of one camera ray per pixel, so that a layer's mean is the value of that ray."""
    return rptcam_cl.render(scene, spp=1, layers=layers, **options)


def in_camera(scene: dict[str, Any], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (..., 3) of the scene in the frame of its camera [m]."""
    matrix = load_scene(scene).camera.world_from_camera()
    return (points - matrix[:3, 3]) @ matrix[:3, :3]


def pixel_grid(image: rptcam_cl.Image) -> NDArray[np.float64]:
    """Return column and row of each pixel, (height, width, 2)."""
    return np.stack(np.meshgrid(np.arange(image.width), np.arange(image.height)), axis=-1).astype(np.float64)


def assert_seen_in_their_pixels(
    image: rptcam_cl.Image, seen: NDArray[np.float64], mask: NDArray[np.bool_], slack: float
) -> None:
    """Fail unless every place (height, width, 2) where a point was seen [pixels] lies in the pixel that shows it."""
    within = (seen - pixel_grid(image))[mask]
    assert len(within) > 100
    assert within.min() > -slack
    assert within.max() < 1 + slack
    assert within.min(axis=0).max() < 0.1  # and they are spread over the pixel, not in its middle
    assert within.max(axis=0).min() > 0.9
