"""The parallel view: what it shows is as large at any distance."""

import numpy as np
import pytest

from rptcam_cl import load_scene, render
from rptcam_cl.rendering.cameras.kinds import camera_of

CAMERA = {"kind": "orthographic", "eye": [1, 2, 3], "target": [1, 2, -7], "up": [1, 0, 0], "width_m": 4}
GLOW = {"kind": "emissive", "radiance": [1, 2, 3]}


def panel(left, right, low, high, z):
    """A lamp that shows these edges to the camera, in metres right and up of the middle, ``z`` ahead of the eye."""
    # up is +x, right is -y
    corner = [1 + low, 2 - left, 3 - z]
    return {"shape": "rectangle", "corner": corner, "edge_u": [0, left - right, 0], "edge_v": [high - low, 0, 0],
            "material": GLOW | {"two_sided": True}}  # fmt: skip


def scene_of(*objects, **camera):
    scene = {"film": {"resolution": [16, 8]}, "camera": CAMERA | camera, "objects": list(objects)}
    return load_scene(scene | {"render": {"spp": 4, "layers": ["distance"]}})


def test_things_are_as_large_at_any_distance():
    # a pixel is 0.25 m: columns 2 to 5 and rows 1 to 3; columns 9 to 12 and rows 5 to 6
    image = render(scene_of(panel(-1.5, -0.5, 0, 0.75, 1), panel(0.25, 1.25, -0.75, -0.25, 1000)))
    expected = np.zeros((8, 16))
    expected[1:4, 2:6] = expected[5:7, 9:13] = 1
    np.testing.assert_allclose(image.pixels, expected[..., None] * [1, 2, 3], rtol=1e-6)
    distance = image.layers["distance"]
    np.testing.assert_allclose(distance[1:4, 2:6], 1, rtol=1e-6)
    np.testing.assert_allclose(distance[5:7, 9:13], 1000, rtol=1e-6)


def test_nothing_is_seen_before_the_near_plane():
    image = render(scene_of(panel(-3, 3, -3, 3, 1), panel(-3, 3, -3, 3, 1.2), near_m=1.5))
    assert not image.pixels.any()


@pytest.mark.parametrize("flip", [True, False])
def test_chief_rays_are_parallel(flip):
    camera = camera_of(scene_of(flip=flip))
    origins, directions = camera.chief_rays().rays(np.array([[0, 0], [16, 8], [8, 4]]))
    sign = 1 if flip else -1
    np.testing.assert_allclose(origins, np.array([[-2, 1, 0], [2, -1, 0], [0, 0, 0]]) * sign, atol=1e-12)
    np.testing.assert_allclose(directions, np.tile([0, 0, -1], (3, 1)), atol=1e-12)
